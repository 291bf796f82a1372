// Checks that tetrahedra are connected as solver and contact search require. Private to this library.
#pragma once

#include <string>

#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

// Empty where the mesh is one piece, joined by faces, whose boundary is a closed 2-manifold: two triangles at every
// edge and one fan of them at every node. Otherwise the end of a sentence: "it falls into 3 pieces".
[[nodiscard]] std::string topology_problem(const TetMesh &mesh);

} // namespace bregma::tissue
