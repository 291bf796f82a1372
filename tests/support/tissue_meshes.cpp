#include "tests/support/tissue_meshes.hpp"

#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <random>

namespace bregma::test {
namespace {

constexpr double kSame_mm = 1e-6;

template <class Distance> std::vector<int> nodes_where(const tissue::TetMesh &mesh, const Distance &distance_mm) {
  std::vector<int> out;
  for (std::size_t i = 0; i < mesh.nodes_mm.size(); ++i) {
    if (std::abs(distance_mm(mesh.nodes_mm[i])) < kSame_mm) {
      out.push_back(static_cast<int>(i));
    }
  }
  return out;
}

// Integer keys that are equal for equal positions.
std::array<long, 3> key(const Eigen::Vector3d &p) {
  return {std::lround(p.x() / kSame_mm), std::lround(p.y() / kSame_mm), std::lround(p.z() / kSame_mm)};
}

} // namespace

tissue::TetMesh jittered_block(const Eigen::Vector3i &cells, const Eigen::Vector3d &size_mm, double share,
                               unsigned seed) {
  tissue::TetMesh mesh = tissue::block_mesh(cells, size_mm);
  const Eigen::Vector3d edge = size_mm.cwiseQuotient(cells.cast<double>());
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> way(-share, share);
  for (Eigen::Vector3d &node : mesh.nodes_mm) {
    const Eigen::Vector3d by = Eigen::Vector3d(way(rng), way(rng), way(rng)).cwiseProduct(edge);
    if ((node.array() > kSame_mm).all() && (node.array() < size_mm.array() - kSame_mm).all()) {
      node += by;
    }
  }
  return mesh;
}

tissue::TetMesh sphere_octant(double inner_mm, double outer_mm, int layers, int along) {
  const tissue::TetMesh block = tissue::block_mesh({layers, along, along}, Eigen::Vector3d::Ones());
  tissue::TetMesh mesh;
  std::map<std::array<long, 3>, int> known;
  // Cyclic permutations of the axes: the faces of the three blocks meet with equal diagonals and no element is
  // inverted.
  for (int third = 0; third < 3; ++third) {
    std::vector<int> number;
    for (const Eigen::Vector3d &p : block.nodes_mm) {
      const double radius = inner_mm * std::pow(outer_mm / inner_mm, p.x());
      const Eigen::Vector3d direction =
          Eigen::Vector3d(1.0, std::tan(p.y() * std::numbers::pi / 4.0), std::tan(p.z() * std::numbers::pi / 4.0))
              .normalized();
      Eigen::Vector3d place;
      for (int axis = 0; axis < 3; ++axis) {
        place[(axis + third) % 3] = radius * direction[axis];
      }
      const auto [at, is_new] = known.try_emplace(key(place), static_cast<int>(mesh.nodes_mm.size()));
      if (is_new) {
        mesh.nodes_mm.push_back(place);
      }
      number.push_back(at->second);
    }
    for (const Eigen::Vector4i &t : block.tetrahedra) {
      mesh.tetrahedra.emplace_back(t.unaryExpr([&](int i) { return number[static_cast<std::size_t>(i)]; }));
    }
  }
  return mesh;
}

std::vector<int> nodes_at(const tissue::TetMesh &mesh, int axis, double mm) {
  return nodes_where(mesh, [&](const Eigen::Vector3d &p) { return p[axis] - mm; });
}

std::vector<int> nodes_at_radius(const tissue::TetMesh &mesh, double mm) {
  return nodes_where(mesh, [&](const Eigen::Vector3d &p) { return p.norm() - mm; });
}

} // namespace bregma::test
