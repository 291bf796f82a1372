// A triangle surface with fast queries for the closest point and for intersections with a line.
//
// Built once: a binary tree of axis-aligned boxes in flat arrays, split at the median of the longest side
// [Ericson 2005, chapter 6]. Queries are exact, const, thread-safe, and do not allocate or
// throw. Frame: that of the mesh (usually Image), mm.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::surface {

struct SurfacePoint {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();
  // Outward unit pseudonormal there, weighted by angle at edges and vertices: on a closed surface its side
  // separates inside from outside exactly [Baerentzen 2005].
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double distance_mm = 0.0; // never negative
  double signed_mm = 0.0;   // negative inside
  int triangle = -1;        // index in the given mesh
};

class SurfaceModel {
public:
  // Throws std::invalid_argument with the index and the value of what is wrong: no triangles, a vertex that is not
  // finite, a triangle with an invalid vertex index, or a mesh whose triangles all have no area.
  explicit SurfaceModel(const TriangleMesh &mesh);

  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &point_mm) const noexcept;
  // start_triangle is a guess, such as the previous result for a neighbouring point. A wrong guess costs time, not
  // correctness.
  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &point_mm, int start_triangle) const noexcept;

  // The closest point of one triangle of the mesh; the sign of signed_mm is the side of this triangle alone.
  [[nodiscard]] SurfacePoint closest_on(int triangle, const Eigen::Vector3d &point_mm) const noexcept;
  // The closest point among candidate triangles, which are sorted by their distance from a point offset_mm away. The
  // search ends where the rest cannot be nearer by secure_mm. At least one candidate. others_mm, if given, receives a
  // lower bound of the distance of all other triangles, provided that only candidates can be closest.
  struct Candidate {
    float from_place_mm;
    int triangle;
  };
  [[nodiscard]] SurfacePoint closest_among(std::span<const Candidate> candidates, double offset_mm,
                                           const Eigen::Vector3d &point_mm, double *others_mm = nullptr,
                                           double secure_mm = 0.0) const noexcept;
  // Prefetches a triangle that will be evaluated soon.
  void prefetch(int triangle) const noexcept {
    const Corners *corners = &corners_[slot_[static_cast<std::size_t>(triangle)]];
    __builtin_prefetch(corners);
    __builtin_prefetch(&corners->c);
  }
  struct Box {
    Eigen::Vector3d low_mm, high_mm;
  };
  [[nodiscard]] Box box(int triangle) const noexcept {
    const Corners &c = corners_[slot_[static_cast<std::size_t>(triangle)]];
    return {c.a.cwiseMin(c.b).cwiseMin(c.c), c.a.cwiseMax(c.b).cwiseMax(c.c)};
  }
  // Calls visit(triangle, squared distance) for every triangle within radius_mm of the point, in no order.
  template <class Visit> void each_within(const Eigen::Vector3d &point_mm, double radius_mm, Visit &&visit) const;

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

  // Maximum depth of median splits of up to 2^32 triangles.
  static constexpr int kMaxDepth = 64;

  [[nodiscard]] SurfacePoint describe(std::uint32_t slot, const Closest &found,
                                      const Eigen::Vector3d &p) const noexcept;
  [[nodiscard]] static double squared_distance_to_box(const Node &node, const Eigen::Vector3d &p) noexcept {
    return (node.low - p).cwiseMax(p - node.high).cwiseMax(0.0).squaredNorm();
  }
  [[nodiscard]] static Closest closest_on_triangle(const Corners &t, const Eigen::Vector3d &p) noexcept;
  void build(std::vector<std::uint32_t> &order, const TriangleMesh &mesh);
  void build_normals(const TriangleMesh &mesh);

  // Triangles are stored in the order of the tree ("slots").
  std::vector<Node> nodes_;
  std::vector<Corners> corners_;
  std::vector<int> mesh_index_;          // slot to triangle of the mesh
  std::vector<std::uint32_t> slot_;      // and back
  std::vector<Eigen::Vector3d> normals_; // kFeatures a slot
  Eigen::Vector3d low_, high_;
  bool closed_ = false;
};

template <class Visit>
void SurfaceModel::each_within(const Eigen::Vector3d &point_mm, double radius_mm, Visit &&visit) const {
  const double limit = radius_mm * radius_mm;
  std::array<std::uint32_t, kMaxDepth> stack;
  int top = 0;
  stack[0] = 0;
  while (top >= 0) {
    const std::uint32_t index = stack[static_cast<std::size_t>(top--)];
    const Node &node = nodes_[index];
    if (squared_distance_to_box(node, point_mm) > limit) {
      continue;
    }
    if (node.count == 0) {
      stack[static_cast<std::size_t>(++top)] = node.first;
      stack[static_cast<std::size_t>(++top)] = index + 1;
      continue;
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
      const double squared = (closest_on_triangle(corners_[i], point_mm).point - point_mm).squaredNorm();
      if (squared <= limit) {
        visit(mesh_index_[i], squared);
      }
    }
  }
}

} // namespace bregma::surface
