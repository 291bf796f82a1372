// Checks that a triangle mesh bounds a body, from its half-edges and independent of the library that made it.
#include <algorithm>
#include <cstdint>
#include <numeric>

#include <Eigen/Geometry>

#include "casefile/volumes/surface.hpp"

namespace bregma::casefile {
namespace {

struct HalfEdge {
  int from = 0;
  int to = 0;
  [[nodiscard]] std::pair<int, int> edge() const { return std::minmax({from, to}); }
};

std::vector<HalfEdge> half_edges_of(const surface::TriangleMesh &mesh) {
  std::vector<HalfEdge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const Eigen::Vector3i &t : mesh.triangles) {
    for (int corner = 0; corner < 3; ++corner) {
      edges.push_back({t[corner], t[(corner + 1) % 3]});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge &a, const HalfEdge &b) { return a.edge() < b.edge(); });
  return edges;
}

// `closed`: each edge has two triangles. `oriented`: the two run along the edge in opposite directions.
void check_edges(const surface::TriangleMesh &mesh, MeshCheck &check) {
  const std::vector<HalfEdge> edges = half_edges_of(mesh);
  check.closed = !edges.empty();
  check.oriented = !edges.empty();
  for (std::size_t at = 0; at < edges.size();) {
    std::size_t end = at + 1;
    while (end < edges.size() && edges[end].edge() == edges[at].edge()) {
      ++end;
    }
    check.closed = check.closed && end - at == 2;
    check.oriented = check.oriented && end - at == 2 && edges[at].from == edges[at + 1].to;
    at = end;
  }
}

// The triangles around a vertex lead from one neighbour to the next. One cycle over all of them is a fan.
bool has_single_fans(const surface::TriangleMesh &mesh) {
  struct Link {
    int vertex, from, to;
  };
  std::vector<Link> links;
  links.reserve(3 * mesh.triangles.size());
  for (const Eigen::Vector3i &t : mesh.triangles) {
    for (int corner = 0; corner < 3; ++corner) {
      links.push_back({t[corner], t[(corner + 1) % 3], t[(corner + 2) % 3]});
    }
  }
  std::sort(links.begin(), links.end(),
            [](const Link &a, const Link &b) { return std::tie(a.vertex, a.from) < std::tie(b.vertex, b.from); });
  for (auto first = links.begin(); first != links.end();) {
    const auto last = std::find_if(first, links.end(), [&](const Link &link) { return link.vertex != first->vertex; });
    auto at = first;
    std::ptrdiff_t walked = 0;
    do {
      const int next = at->to;
      at = std::find_if(first, last, [next](const Link &link) { return link.from == next; });
      ++walked;
    } while (at != last && at != first && walked <= last - first);
    if (at != first || walked != last - first) {
      return false;
    }
    first = last;
  }
  return true;
}

int count_components(const surface::TriangleMesh &mesh) {
  std::vector<int> parent(mesh.vertices_mm.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&parent](int v) {
    while (parent[static_cast<std::size_t>(v)] != v) {
      int &up = parent[static_cast<std::size_t>(v)];
      up = parent[static_cast<std::size_t>(up)];
      v = up;
    }
    return v;
  };
  auto components = static_cast<int>(parent.size());
  for (const Eigen::Vector3i &t : mesh.triangles) {
    for (const int other : {t[1], t[2]}) {
      const int a = root(t[0]);
      const int b = root(other);
      if (a != b) {
        parent[static_cast<std::size_t>(a)] = b;
        --components;
      }
    }
  }
  return components;
}

} // namespace

MeshCheck check_mesh(const surface::TriangleMesh &mesh) {
  MeshCheck check;
  const auto count = static_cast<int>(mesh.vertices_mm.size());
  const bool valid = std::all_of(mesh.triangles.begin(), mesh.triangles.end(), [count](const Eigen::Vector3i &t) {
    return t.minCoeff() >= 0 && t.maxCoeff() < count && t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
  });
  if (!valid || mesh.triangles.empty()) {
    return check;
  }
  double volume_mm3 = 0.0;
  double area_mm2 = 0.0;
  const Eigen::Vector3d origin = mesh.vertices_mm.front(); // near the mesh, where the products cancel least
  for (const Eigen::Vector3i &t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices_mm[static_cast<std::size_t>(t[0])] - origin;
    const Eigen::Vector3d b = mesh.vertices_mm[static_cast<std::size_t>(t[1])] - origin;
    const Eigen::Vector3d c = mesh.vertices_mm[static_cast<std::size_t>(t[2])] - origin;
    volume_mm3 += a.dot(b.cross(c)) / 6.0;
    area_mm2 += 0.5 * (b - a).cross(c - a).norm();
  }
  check_edges(mesh, check);
  check.oriented = check.oriented && volume_mm3 > 0.0;
  check.manifold = check.closed && has_single_fans(mesh);
  check.components = count_components(mesh);
  check.volume_ml = volume_mm3 / 1000.0;
  check.area_cm2 = area_mm2 / 100.0;
  return check;
}

} // namespace bregma::casefile
