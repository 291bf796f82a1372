// Smaller tetrahedra where a probe will press: a lattice whose edges are longer than the tip's width makes the tissue
// several times too stiff under it.
//
// Bisection at the longest edge [Rivara 1984]: a tetrahedron is halved through the middle of its longest edge, together
// with all others around that edge. Where one of those has a longer edge, that edge is halved first. The mesh stays
// conforming with a graded transition to the coarse part. After three bisections, a tetrahedron of the lattice is
// divided into similar ones of half the size.
#pragma once

#include <span>

#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

struct RefinementRegion {
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  double radius_mm = 0.0;
  double edge_mm = 0.0; // maximum edge in the region
};

// Existing nodes keep their numbers and places; new ones follow, those on the boundary on its flat triangles.
// Deterministic; safe from any thread. Throws std::invalid_argument for a centre, radius or edge that is not finite
// or not positive, or when more than kMaxTetrahedra (lattice_mesh.hpp) would be made.
[[nodiscard]] TetMesh refined(const TetMesh &mesh, std::span<const RefinementRegion> places);

} // namespace bregma::tissue
