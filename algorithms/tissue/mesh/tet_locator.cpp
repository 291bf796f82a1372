#include "algorithms/tissue/mesh/tet_locator.hpp"

#include <algorithm>

namespace bregma::tissue {

TetLocator::TetLocator(const TetMesh &mesh) : mesh_(&mesh), neighbours_(mesh.tetrahedra.size(), {-1, -1, -1, -1}) {
  struct Face {
    std::array<int, 3> nodes;
    int tetrahedron, opposite;
  };
  std::vector<Face> faces;
  faces.reserve(4 * mesh.tetrahedra.size());
  for (std::size_t e = 0; e < mesh.tetrahedra.size(); ++e) {
    const Eigen::Vector4i &t = mesh.tetrahedra[e];
    for (int i = 0; i < 4; ++i) {
      Face face{{t[(i + 1) % 4], t[(i + 2) % 4], t[(i + 3) % 4]}, static_cast<int>(e), i};
      std::sort(face.nodes.begin(), face.nodes.end());
      faces.push_back(face);
      for (int j = 0; j < i; ++j) {
        const auto node = [&](int k) { return mesh.nodes_mm[static_cast<std::size_t>(t[k])]; };
        longest_edge_squared_ = std::max(longest_edge_squared_, (node(i) - node(j)).squaredNorm());
      }
    }
  }
  std::sort(faces.begin(), faces.end(), [](const Face &a, const Face &b) { return a.nodes < b.nodes; });
  for (std::size_t i = 0; i + 1 < faces.size(); ++i) {
    const Face &a = faces[i];
    const Face &b = faces[i + 1];
    if (a.nodes == b.nodes) {
      neighbours_[static_cast<std::size_t>(a.tetrahedron)][static_cast<std::size_t>(a.opposite)] = b.tetrahedron;
      neighbours_[static_cast<std::size_t>(b.tetrahedron)][static_cast<std::size_t>(b.opposite)] = a.tetrahedron;
    }
  }
}

} // namespace bregma::tissue
