#include "algorithms/tissue/mesh/mesh_refinement.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/tissue/mesh/lattice_mesh.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4i;

using Edge = std::pair<int, int>; // the lower node first

constexpr std::array<std::array<int, 2>, 6> kEdges{{{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}}};

void check_places(std::span<const RefinementRegion> places) {
  for (const RefinementRegion &place : places) {
    if (!place.centre_mm.allFinite() || !std::isfinite(place.radius_mm) || !(place.radius_mm > 0.0) ||
        !std::isfinite(place.edge_mm) || !(place.edge_mm > 0.0)) {
      throw std::invalid_argument("mesh refinement: radius " + std::to_string(place.radius_mm) + " mm, edge " +
                                  std::to_string(place.edge_mm) +
                                  " mm: a place, a radius and an edge must be finite, "
                                  "the last two positive");
    }
  }
}

class Bisection {
public:
  explicit Bisection(const TetMesh &mesh) : mesh_(mesh) {
    for (std::size_t t = 0; t < mesh_.tetrahedra.size(); ++t) {
      for (const auto &[a, b] : kEdges) {
        around_[edge_of(mesh_.tetrahedra[t][a], mesh_.tetrahedra[t][b])].push_back(static_cast<int>(t));
      }
    }
  }

  void refine(const RefinementRegion &place) {
    for (std::size_t t = 0; t < mesh_.tetrahedra.size(); ++t) { // grows during the loop
      while (reaches(mesh_.tetrahedra[t], place) && length_of(longest_edge(t)) > place.edge_mm) {
        bisect(longest_edge(t));
      }
    }
  }

  [[nodiscard]] TetMesh take() { return std::move(mesh_); }

private:
  static Edge edge_of(int a, int b) { return {std::min(a, b), std::max(a, b)}; }
  [[nodiscard]] const Vector3d &node(int i) const { return mesh_.nodes_mm[static_cast<std::size_t>(i)]; }
  [[nodiscard]] double length_of(const Edge &edge) const { return (node(edge.first) - node(edge.second)).norm(); }

  [[nodiscard]] bool reaches(const Vector4i &t, const RefinementRegion &place) const {
    return std::any_of(t.begin(), t.end(), [&](int i) { return (node(i) - place.centre_mm).norm() < place.radius_mm; });
  }

  // A strict order, so that two tetrahedra with the same edges select the same one.
  [[nodiscard]] bool longer(const Edge &a, const Edge &b) const {
    const double length_a = length_of(a);
    const double length_b = length_of(b);
    return length_a != length_b ? length_a > length_b : a < b;
  }

  [[nodiscard]] Edge longest_edge(std::size_t t) const {
    const Vector4i &nodes = mesh_.tetrahedra[t];
    Edge longest = edge_of(nodes[0], nodes[1]);
    for (const auto &[a, b] : kEdges) {
      const Edge edge = edge_of(nodes[a], nodes[b]);
      longest = longer(edge, longest) ? edge : longest;
    }
    return longest;
  }

  // Each waiting edge is longer than the one before, so the loop ends.
  void bisect(const Edge &wanted) {
    std::vector<Edge> waiting{wanted};
    while (!waiting.empty()) {
      const Edge edge = waiting.back();
      const std::vector<int> &ring = around_.at(edge);
      const auto objects = std::find_if(ring.begin(), ring.end(),
                                        [&](int t) { return longest_edge(static_cast<std::size_t>(t)) != edge; });
      if (objects != ring.end()) {
        waiting.push_back(longest_edge(static_cast<std::size_t>(*objects)));
      } else {
        halve(edge);
        waiting.pop_back();
      }
    }
  }

  void halve(const Edge &edge) {
    const int middle = static_cast<int>(mesh_.nodes_mm.size());
    mesh_.nodes_mm.emplace_back(0.5 * (node(edge.first) + node(edge.second)));
    const std::vector<int> ring = std::move(around_.at(edge));
    around_.erase(edge);
    if (mesh_.tetrahedra.size() + ring.size() > static_cast<std::size_t>(kMaxTetrahedra)) {
      throw std::invalid_argument("mesh refinement: more than " + std::to_string(kMaxTetrahedra) + " tetrahedra");
    }
    for (const int t : ring) {
      const Vector4i whole = mesh_.tetrahedra[static_cast<std::size_t>(t)];
      const int other = static_cast<int>(mesh_.tetrahedra.size());
      Vector4i first = whole;
      Vector4i second = whole;
      std::replace(first.begin(), first.end(), edge.second, middle);
      std::replace(second.begin(), second.end(), edge.first, middle);
      mesh_.tetrahedra[static_cast<std::size_t>(t)] = first;
      mesh_.tetrahedra.push_back(second);
      for (const auto &[a, b] : kEdges) {
        const Edge of_second = edge_of(second[a], second[b]);
        const Edge of_whole = edge_of(whole[a], whole[b]);
        // Edges that belong to the second half only now refer to that tetrahedron.
        if (of_whole != edge && (of_whole.first == edge.second || of_whole.second == edge.second)) {
          std::vector<int> &list = around_.at(of_whole);
          std::replace(list.begin(), list.end(), t, other);
        } else {
          around_[of_second].push_back(other);
        }
        const Edge of_first = edge_of(first[a], first[b]);
        if (of_first.second == middle) {
          around_[of_first].push_back(t);
        }
      }
    }
  }

  TetMesh mesh_;
  std::map<Edge, std::vector<int>> around_; // tetrahedra around each edge
};

} // namespace

TetMesh refined(const TetMesh &mesh, std::span<const RefinementRegion> places) {
  check_places(places);
  check(mesh);
  Bisection bisection(mesh);
  for (const RefinementRegion &place : places) {
    bisection.refine(place);
  }
  return bisection.take();
}

} // namespace bregma::tissue
