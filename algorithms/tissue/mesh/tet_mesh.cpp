#include "algorithms/tissue/mesh/tet_mesh.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>

namespace bregma::tissue {
namespace {

// The face opposite each node, counter-clockwise seen from outside.
constexpr int kFaces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

double six_volumes(const TetMesh &mesh, const Eigen::Vector4i &t) {
  const auto node = [&](int i) -> const Eigen::Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
  return (node(1) - node(0)).cross(node(2) - node(0)).dot(node(3) - node(0));
}

} // namespace

TetBoundary boundary_of(const TetMesh &mesh) {
  struct Face {
    std::array<int, 3> sorted;
    Eigen::Vector3i triangle;
    int tetrahedron;
  };
  std::vector<Face> faces;
  faces.reserve(4 * mesh.tetrahedra.size());
  for (std::size_t e = 0; e < mesh.tetrahedra.size(); ++e) {
    for (const auto &corner : kFaces) {
      const Eigen::Vector4i &t = mesh.tetrahedra[e];
      Face face{
          {t[corner[0]], t[corner[1]], t[corner[2]]}, {t[corner[0]], t[corner[1]], t[corner[2]]}, static_cast<int>(e)};
      std::sort(face.sorted.begin(), face.sorted.end());
      faces.push_back(face);
    }
  }
  std::sort(faces.begin(), faces.end(), [](const Face &a, const Face &b) { return a.sorted < b.sorted; });

  TetBoundary out;
  for (std::size_t i = 0; i < faces.size();) {
    std::size_t j = i + 1;
    while (j < faces.size() && faces[j].sorted == faces[i].sorted) {
      ++j;
    }
    if (j == i + 1) {
      out.triangles.push_back(faces[i].triangle);
      out.tetrahedron.push_back(faces[i].tetrahedron);
      out.nodes.insert(out.nodes.end(), faces[i].sorted.begin(), faces[i].sorted.end());
    }
    i = j;
  }
  std::sort(out.nodes.begin(), out.nodes.end());
  out.nodes.erase(std::unique(out.nodes.begin(), out.nodes.end()), out.nodes.end());
  return out;
}

double volume_mm3(const TetMesh &mesh) {
  double sum = 0.0;
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    sum += six_volumes(mesh, t) / 6.0;
  }
  return sum;
}

double mean_edge_mm(const TetMesh &mesh) {
  double sum = 0.0;
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    const auto node = [&](int i) -> const Eigen::Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
    for (int i = 1; i < 4; ++i) {
      for (int j = 0; j < i; ++j) {
        sum += (node(i) - node(j)).norm();
      }
    }
  }
  return sum / (6.0 * static_cast<double>(mesh.tetrahedra.size()));
}

void check(const TetMesh &mesh) {
  if (mesh.tetrahedra.empty()) {
    throw std::invalid_argument("mesh without tetrahedra");
  }
  const int nodes = static_cast<int>(mesh.nodes_mm.size());
  std::vector<bool> used(mesh.nodes_mm.size(), false);
  for (int i = 0; i < nodes; ++i) {
    if (!mesh.nodes_mm[static_cast<std::size_t>(i)].allFinite()) {
      throw std::invalid_argument("node " + std::to_string(i) + " is not finite");
    }
  }
  for (std::size_t e = 0; e < mesh.tetrahedra.size(); ++e) {
    for (const int node : mesh.tetrahedra[e]) {
      if (node < 0 || node >= nodes) {
        throw std::invalid_argument("tetrahedron " + std::to_string(e) + " names node " + std::to_string(node) +
                                    " of " + std::to_string(nodes));
      }
      used[static_cast<std::size_t>(node)] = true;
    }
    if (const double volume = six_volumes(mesh, mesh.tetrahedra[e]) / 6.0; !(volume > 0.0)) {
      throw std::invalid_argument("tetrahedron " + std::to_string(e) + " has a volume of " + std::to_string(volume) +
                                  " mm^3, must be positive");
    }
  }
  if (const auto idle = std::find(used.begin(), used.end(), false); idle != used.end()) {
    throw std::invalid_argument("node " + std::to_string(idle - used.begin()) + " belongs to no tetrahedron");
  }
}

TetMesh block_mesh(const Eigen::Vector3i &cells, const Eigen::Vector3d &size_mm) {
  TetMesh mesh;
  const Eigen::Vector3i count = cells.array() + 1;
  for (int z = 0; z < count.z(); ++z) {
    for (int y = 0; y < count.y(); ++y) {
      for (int x = 0; x < count.x(); ++x) {
        mesh.nodes_mm.emplace_back(size_mm.cwiseProduct(Eigen::Vector3d(x, y, z)).cwiseQuotient(cells.cast<double>()));
      }
    }
  }
  const auto at = [&](const Eigen::Vector3i &p) { return p.x() + count.x() * (p.y() + count.y() * p.z()); };
  // Six paths from corner 000 to corner 111; odd permutations of the axes are reordered for positive volume.
  constexpr int kOrders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
  for (int z = 0; z < cells.z(); ++z) {
    for (int y = 0; y < cells.y(); ++y) {
      for (int x = 0; x < cells.x(); ++x) {
        for (int order = 0; order < 6; ++order) {
          Eigen::Vector3i p(x, y, z);
          Eigen::Vector4i t;
          t[0] = at(p);
          for (int i = 0; i < 3; ++i) {
            ++p[kOrders[order][i]];
            t[i + 1] = at(p);
          }
          if (order >= 3) {
            std::swap(t[1], t[2]);
          }
          mesh.tetrahedra.push_back(t);
        }
      }
    }
  }
  return mesh;
}

} // namespace bregma::tissue
