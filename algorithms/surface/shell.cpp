#include "algorithms/surface/shell.hpp"

#include <algorithm>
#include <cstddef>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include <Eigen/Geometry>

namespace bregma::surface {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;
using Edge = std::pair<int, int>;

// Sets of vertices that are joined by triangles.
class Pieces {
public:
  explicit Pieces(std::size_t vertices) : parent_(vertices) { std::iota(parent_.begin(), parent_.end(), 0); }
  int root(int vertex) {
    int &parent = parent_[static_cast<std::size_t>(vertex)];
    return parent == vertex ? vertex : parent = root(parent);
  }
  void join(int a, int b) { parent_[static_cast<std::size_t>(root(a))] = root(b); }

private:
  std::vector<int> parent_;
};

std::vector<Vector3i> largest_piece(const std::vector<Vector3i> &triangles, std::size_t vertices) {
  Pieces pieces(vertices);
  for (const Vector3i &t : triangles) {
    pieces.join(t[0], t[1]);
    pieces.join(t[1], t[2]);
  }
  std::map<int, std::size_t> sizes;
  for (const Vector3i &t : triangles) {
    ++sizes[pieces.root(t[0])];
  }
  const auto largest =
      std::max_element(sizes.begin(), sizes.end(), [](const auto &a, const auto &b) { return a.second < b.second; });
  std::vector<Vector3i> out;
  std::copy_if(triangles.begin(), triangles.end(), std::back_inserter(out),
               [&](const Vector3i &t) { return pieces.root(t[0]) == largest->first; });
  return out;
}

// Weighted by the triangles' areas.
std::vector<Vector3d> normals_of(const TriangleMesh &mesh) {
  std::vector<Vector3d> out(mesh.vertices_mm.size(), Vector3d::Zero());
  const auto at = [&mesh](int vertex) { return mesh.vertices_mm[static_cast<std::size_t>(vertex)]; };
  for (const Vector3i &t : mesh.triangles) {
    const Vector3d normal = (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0]));
    for (const int corner : t) {
      out[static_cast<std::size_t>(corner)] += normal;
    }
  }
  for (Vector3d &normal : out) {
    normal.normalize();
  }
  return out;
}

} // namespace

TriangleMesh shell_of(const TriangleMesh &mesh, const std::function<bool(const Vector3d &)> &wanted,
                      double thickness_mm) {
  std::vector<Vector3i> outer;
  const auto has = [&](int vertex) { return wanted(mesh.vertices_mm[static_cast<std::size_t>(vertex)]); };
  std::copy_if(mesh.triangles.begin(), mesh.triangles.end(), std::back_inserter(outer),
               [&](const Vector3i &t) { return has(t[0]) && has(t[1]) && has(t[2]); });
  TriangleMesh out;
  if (outer.empty()) {
    return out;
  }
  outer = largest_piece(outer, mesh.vertices_mm.size());
  const std::vector<Vector3d> normals = normals_of(mesh);
  std::map<int, int> number; // of an outer vertex in the shell; its inner one follows
  const auto place = [&](int vertex) {
    const auto [entry, fresh] = number.try_emplace(vertex, static_cast<int>(out.vertices_mm.size()));
    if (fresh) {
      const auto at = static_cast<std::size_t>(vertex);
      out.vertices_mm.push_back(mesh.vertices_mm[at]);
      out.vertices_mm.push_back(mesh.vertices_mm[at] - thickness_mm * normals[at]);
    }
    return entry->second;
  };
  std::set<Edge> edges;
  for (const Vector3i &t : outer) {
    const Vector3i o(place(t[0]), place(t[1]), place(t[2]));
    out.triangles.push_back(o);
    out.triangles.emplace_back(o[0] + 1, o[2] + 1, o[1] + 1);
    for (int i = 0; i < 3; ++i) {
      edges.emplace(o[i], o[(i + 1) % 3]);
    }
  }
  for (const auto &[from, to] : edges) {
    if (!edges.contains({to, from})) { // the rim
      out.triangles.emplace_back(to, from, from + 1);
      out.triangles.emplace_back(to, from + 1, to + 1);
    }
  }
  return out;
}

TriangleMesh face_shell(const TriangleMesh &scalp, double thickness_mm) {
  Eigen::AlignedBox3d box;
  for (const Vector3d &vertex : scalp.vertices_mm) {
    box.extend(vertex);
  }
  const double front_mm = box.center().y() + 0.15 * box.sizes().y();
  const double top_mm = box.max().z() - 0.2 * box.sizes().z();
  return shell_of(
      scalp, [=](const Vector3d &p) { return p.y() > front_mm && p.z() < top_mm; }, thickness_mm);
}

} // namespace bregma::surface
