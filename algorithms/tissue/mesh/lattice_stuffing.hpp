// Isosurface stuffing [Labelle 2007]: uniform tetrahedra of a body-centred cubic lattice, cut to fit inside a closed
// surface. Private to this library: where the surface is finer than the lattice, the result may be in pieces or touch
// itself, see mesh_topology.hpp.
#pragma once

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

// edge_mm: the lattice's long edge, a. shift: of the lattice against the middle of the surface's box, in edges, each
// coordinate from -0.5 to 0.5. Nodes on the surface are the roots of its signed distance along lattice edges. Empty
// where no lattice point lies inside. Deterministic; allocates in proportion to the box.
[[nodiscard]] TetMesh stuff(const surface::SurfaceModel &surface, double edge_mm, const Eigen::Vector3d &shift);

// Number of lattice points that stuff() would evaluate.
[[nodiscard]] double lattice_points(const surface::SurfaceModel &surface, double edge_mm);

} // namespace bregma::tissue
