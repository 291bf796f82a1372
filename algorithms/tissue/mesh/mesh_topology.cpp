#include "algorithms/tissue/mesh/mesh_topology.hpp"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

namespace bregma::tissue {
namespace {

// Disjoint sets, with path halving.
class Sets {
public:
  explicit Sets(std::size_t size) : count_(size) {
    parent_.reserve(size);
    for (std::size_t i = 0; i < size; ++i) {
      parent_.push_back(i);
    }
  }

  void join(std::size_t a, std::size_t b) {
    a = root(a);
    b = root(b);
    if (a != b) {
      parent_[std::max(a, b)] = std::min(a, b);
      --count_;
    }
  }
  [[nodiscard]] std::size_t count() const { return count_; }

private:
  std::size_t root(std::size_t i) {
    while (parent_[i] != i) {
      i = parent_[i] = parent_[parent_[i]];
    }
    return i;
  }

  std::vector<std::size_t> parent_;
  std::size_t count_;
};

// Calls join(item, other item) for items with equal keys, which are adjacent after sorting.
template <class Key, class Join> void join_equal(std::vector<std::pair<Key, std::size_t>> &items, Join &&join) {
  std::sort(items.begin(), items.end());
  for (std::size_t i = 1; i < items.size(); ++i) {
    if (items[i].first == items[i - 1].first) {
      join(items[i - 1].second, items[i].second);
    }
  }
}

std::size_t pieces(const TetMesh &mesh) {
  std::vector<std::pair<std::array<int, 3>, std::size_t>> faces;
  faces.reserve(4 * mesh.tetrahedra.size());
  for (std::size_t e = 0; e < mesh.tetrahedra.size(); ++e) {
    Eigen::Vector4i t = mesh.tetrahedra[e];
    std::sort(t.begin(), t.end());
    for (const auto &face :
         {std::array{t[0], t[1], t[2]}, {t[0], t[1], t[3]}, {t[0], t[2], t[3]}, {t[1], t[2], t[3]}}) {
      faces.emplace_back(face, e);
    }
  }
  Sets sets(mesh.tetrahedra.size());
  join_equal(faces, [&](std::size_t a, std::size_t b) { sets.join(a, b); });
  return sets.count();
}

} // namespace

std::string topology_problem(const TetMesh &mesh) {
  if (mesh.tetrahedra.empty()) {
    return "no tetrahedron fits into it";
  }
  if (const std::size_t count = pieces(mesh); count > 1) {
    return "it falls into " + std::to_string(count) + " pieces";
  }
  const TetBoundary boundary = boundary_of(mesh);
  std::vector<std::array<int, 2>> edges;
  // The corners of triangles at a node and at its edges: those of one fan are joined.
  std::vector<std::pair<std::array<int, 2>, std::size_t>> corners;
  for (std::size_t i = 0; i < boundary.triangles.size(); ++i) {
    const Eigen::Vector3i &t = boundary.triangles[i];
    for (int k = 0; k < 3; ++k) {
      const auto corner = 3 * i + static_cast<std::size_t>(k);
      edges.push_back({std::min(t[k], t[(k + 1) % 3]), std::max(t[k], t[(k + 1) % 3])});
      corners.push_back({{t[k], t[(k + 1) % 3]}, corner});
      corners.push_back({{t[k], t[(k + 2) % 3]}, corner});
    }
  }
  std::sort(edges.begin(), edges.end());
  for (std::size_t i = 0; i < edges.size(); i += 2) {
    if (i + 2 < edges.size() && edges[i] == edges[i + 2]) {
      return "two parts of it touch along an edge";
    }
  }
  Sets fans(3 * boundary.triangles.size());
  join_equal(corners, [&](std::size_t a, std::size_t b) { fans.join(a, b); });
  return fans.count() == boundary.nodes.size() ? "" : "two parts of it touch at a point";
}

} // namespace bregma::tissue
