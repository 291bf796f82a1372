// Finds the tetrahedron that contains a point, at rest or deformed, and the point's barycentric coordinates, so that a
// point of the tissue can be followed.
//
// It walks from a guess through the faces that the point lies beyond. Where the walk leaves the mesh (a concave
// surface), all tetrahedra are searched. Const and thread-safe after construction; queries do not allocate or throw.
#pragma once

#include <array>
#include <vector>

#include <Eigen/Core>
#include <Eigen/LU>

#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

struct MaterialPoint {
  int tetrahedron = -1;                                  // -1: outside the mesh
  Eigen::Vector4d barycentric = Eigen::Vector4d::Zero(); // weights of its nodes; they sum to one

  [[nodiscard]] bool inside() const noexcept { return tetrahedron >= 0; }
};

class TetLocator {
public:
  explicit TetLocator(const TetMesh &mesh);

  // position(node) gives a node's present place. guess: a tetrahedron near p. Frame and unit of p are those of
  // position.
  template <class Position>
  [[nodiscard]] MaterialPoint walk(const Eigen::Vector3d &p, int guess, const Position &position) const noexcept {
    int t = guess;
    for (int steps = 0; steps < kMaxWalkSteps && t >= 0; ++steps) {
      const Eigen::Vector4d barycentric = barycentric_of(t, p, position);
      int beyond = 0;
      if (barycentric.minCoeff(&beyond) >= -kOnFace) {
        return {t, barycentric};
      }
      t = neighbours_[static_cast<std::size_t>(t)][static_cast<std::size_t>(beyond)];
    }
    return {};
  }

  // The same without a guess, in mm.
  template <class Position>
  [[nodiscard]] MaterialPoint locate(const Eigen::Vector3d &p_mm, const Position &position_mm) const noexcept {
    const MaterialPoint found = walk(p_mm, 0, position_mm);
    return found.inside() ? found : search(p_mm, position_mm);
  }

  // At rest.
  [[nodiscard]] MaterialPoint locate(const Eigen::Vector3d &p_mm) const noexcept {
    return locate(p_mm, [this](int node) { return mesh_->nodes_mm[static_cast<std::size_t>(node)]; });
  }

  // Barycentric coordinates of p in the tetrahedron t; all in 0..1 inside.
  template <class Position>
  [[nodiscard]] Eigen::Vector4d barycentric_of(int t, const Eigen::Vector3d &p,
                                               const Position &position) const noexcept {
    const Eigen::Vector4i &nodes = mesh_->tetrahedra[static_cast<std::size_t>(t)];
    const Eigen::Vector3d base = position(nodes[0]);
    Eigen::Matrix3d edges;
    for (int i = 0; i < 3; ++i) {
      edges.col(i) = position(nodes[i + 1]) - base;
    }
    const Eigen::Vector3d rest = edges.inverse() * (p - base);
    return {1.0 - rest.sum(), rest.x(), rest.y(), rest.z()};
  }

  template <class Position>
  [[nodiscard]] Eigen::Vector3d place(const MaterialPoint &point, const Position &position) const noexcept {
    const Eigen::Vector4i &nodes = mesh_->tetrahedra[static_cast<std::size_t>(point.tetrahedron)];
    Eigen::Vector3d p = Eigen::Vector3d::Zero();
    for (int i = 0; i < 4; ++i) {
      p += point.barycentric[i] * position(nodes[i]);
    }
    return p;
  }

private:
  static constexpr int kMaxWalkSteps = 256;
  static constexpr double kOnFace = 1e-6;

  template <class Position>
  [[nodiscard]] MaterialPoint search(const Eigen::Vector3d &p, const Position &position) const noexcept {
    const int count = static_cast<int>(mesh_->tetrahedra.size());
    for (int t = 0; t < count; ++t) {
      // Cheaper than barycentric_of(): most are far away.
      const Eigen::Vector3d near = position(mesh_->tetrahedra[static_cast<std::size_t>(t)][0]);
      if ((p - near).squaredNorm() > kReach * longest_edge_squared_) {
        continue;
      }
      const Eigen::Vector4d barycentric = barycentric_of(t, p, position);
      if (barycentric.minCoeff() >= -kOnFace) {
        return {t, barycentric};
      }
    }
    return {};
  }
  static constexpr double kReach = 9.0; // squared: a tetrahedron stretched threefold is still found

  const TetMesh *mesh_;
  std::vector<std::array<int, 4>> neighbours_; // opposite each node; -1 on the surface
  double longest_edge_squared_ = 0.0;
};

} // namespace bregma::tissue
