// A triangle surface that answers "where is the closest point" and "does this line hit" quickly.
//
// Built once: a binary tree of axis-aligned boxes in flat arrays, split at the median of the longest side (after
// Ericson, "Real-Time Collision Detection", 2005, ch. 6). Queries are exact, const, thread-safe, and do not allocate or
// throw. Frame: that of the mesh (usually Image), mm.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "algorithms/geometry/triangle_mesh.hpp"

namespace bregma::registration {

struct SurfacePoint {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();
  // Outward unit pseudonormal there, weighted by angle at edges and vertices: its side tells inside from outside
  // exactly on a closed surface (Baerentzen & Aanaes 2005).
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double distance_mm = 0.0; // never negative
  double signed_mm = 0.0;   // negative inside
  int triangle = -1;        // of the mesh as given
};

class SurfaceModel {
public:
  // Throws std::invalid_argument with the index and the value of what is wrong: no triangles, a vertex that is not
  // finite, a triangle that names a vertex that is not there, or a mesh whose triangles all have no area.
  explicit SurfaceModel(const geometry::TriangleMesh &mesh);

  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &point_mm) const noexcept;
  // Warm: start_triangle is a guess (the last answer for a neighbouring point); a wrong one costs time, not
  // correctness.
  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &point_mm, int start_triangle) const noexcept;

  // True when the segment touches the surface.
  [[nodiscard]] bool segment_hits(const Eigen::Vector3d &from_mm, const Eigen::Vector3d &to_mm) const noexcept;

  // Every edge is shared by exactly two triangles, in opposite directions.
  [[nodiscard]] bool is_closed() const noexcept { return closed_; }
  [[nodiscard]] const Eigen::Vector3d &low_mm() const noexcept { return low_; }
  [[nodiscard]] const Eigen::Vector3d &high_mm() const noexcept { return high_; }
  [[nodiscard]] Eigen::Vector3d centre_mm() const noexcept { return 0.5 * (low_ + high_); }
  [[nodiscard]] std::size_t triangle_count() const noexcept { return corners_.size(); }

private:
  struct Node {
    Eigen::Vector3d low, high;
    std::uint32_t first; // leaf: first triangle; inner: right child (the left one follows its parent)
    std::uint32_t count; // triangles of a leaf; 0 for an inner node
  };
  struct Corners {
    Eigen::Vector3d a, b, c;
  };
  enum Feature : std::uint32_t { kFace, kEdgeAB, kEdgeBC, kEdgeCA, kVertexA, kVertexB, kVertexC, kFeatures };
  struct Closest {
    Eigen::Vector3d point;
    Feature feature;
  };

  [[nodiscard]] static Closest closest_on_triangle(const Corners &t, const Eigen::Vector3d &p) noexcept;
  void build(std::vector<std::uint32_t> &order, const geometry::TriangleMesh &mesh);
  void build_normals(const geometry::TriangleMesh &mesh);

  // Triangles stand in the order of the tree ("slots").
  std::vector<Node> nodes_;
  std::vector<Corners> corners_;
  std::vector<int> mesh_index_;          // slot to triangle of the mesh
  std::vector<std::uint32_t> slot_;      // and back
  std::vector<Eigen::Vector3d> normals_; // kFeatures a slot
  Eigen::Vector3d low_, high_;
  bool closed_ = false;
};

} // namespace bregma::registration
