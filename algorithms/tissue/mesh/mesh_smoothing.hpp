// Moves the nodes of a mesh so that its worst tetrahedra allow a longer time step. A single flat tetrahedron at the
// surface shortens the step of an explicit solver for all others (stable_step_s in mesh_quality.hpp). Private to this
// library.
#pragma once

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

// Every node of a bad tetrahedron moves to the place where the minimum stable length around it is largest
// (optimisation-based smoothing [Freitag 1997], by a compass search, since the objective has kinks).
// Nodes of the mesh's boundary move on the surface. A node only moves where the smallest stable length of its
// tetrahedra grows, so that the minimum of the mesh never decreases and no tetrahedron is inverted. edge_mm: the long
// edge of the mesh's lattice. Ends after `sweeps` over all nodes, or when no node has moved. Deterministic; all
// tetrahedra must be positive.
void smooth(TetMesh &mesh, const surface::SurfaceModel &surface, double edge_mm, int sweeps);

} // namespace bregma::tissue
