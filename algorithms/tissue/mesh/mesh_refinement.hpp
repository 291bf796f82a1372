// Smaller tetrahedra where a probe will press: a lattice whose edges are longer than a tip is wide makes the tissue
// several times too stiff under it.
//
// Bisection at the longest edge (Rivara, Int J Numer Methods Eng 20 (1984) 745): a tetrahedron is halved through the
// middle of its longest edge together with all others around that edge; where one of those has a longer edge, that is
// halved before. The mesh stays conforming, the transition to the coarse part comes by itself, and the lattice's own
// tetrahedra come back in half the size after three bisections of each.
#pragma once

#include <span>

#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

struct RefinementRegion {
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  double radius_mm = 0.0;
  double edge_mm = 0.0; // the longest that is left there
};

// Nodes that are there keep their numbers and places; new ones follow, those on the boundary on its flat triangles.
// Deterministic; safe from any thread. Throws std::invalid_argument for a place, radius or edge that is not finite or
// not positive, or when more than kMaxTetrahedra (lattice_mesh.hpp) would be made.
[[nodiscard]] TetMesh refined(const TetMesh &mesh, std::span<const RefinementRegion> places);

} // namespace bregma::tissue
