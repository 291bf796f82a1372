// An egg of tissue for tests of the skull and of brain shift: longest from front to back, like a brain. A ball would
// rotate in its skull.
#pragma once

#include "algorithms/tissue/mesh/lattice_mesh.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::test {

inline const Eigen::Vector3d kEggHalf_mm(42.0, 55.0, 36.0);

[[nodiscard]] inline tissue::TetMesh make_egg(int tetrahedra) {
  surface::TriangleMesh surface = make_sphere(3, 1.0, Eigen::Vector3d::Zero());
  for (Eigen::Vector3d &vertex : surface.vertices_mm) {
    vertex = vertex.cwiseProduct(kEggHalf_mm);
  }
  tissue::LatticeMeshOptions options;
  options.tetrahedra = tetrahedra;
  return tissue::fill_surface(surface, options).mesh;
}

} // namespace bregma::test
