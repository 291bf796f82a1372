// Private to casefile/volumes: fewer triangles for a closed surface that stays closed.
//
// Edges are collapsed in the order of the quadric error (Garland and Heckbert, "Surface simplification using quadric
// error metrics", SIGGRAPH 1997). An edge is collapsed only if its ends have exactly two common neighbours, which keeps
// a closed 2-manifold one (link condition: Dey et al., "Topology preserving edge contraction", 1999), and if no
// triangle turns over.
#pragma once

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::casefile {

// mesh: a closed 2-manifold. The result has at most `vertices` vertices, or more where no further edge can be collapsed
// (four per component at the least).
[[nodiscard]] surface::TriangleMesh decimated(const surface::TriangleMesh &mesh, int vertices);

} // namespace bregma::casefile
