// Hertz' problem for the contact between probe and tissue: a rigid sphere is pressed into an elastic half space without
// friction. F = 4/3 E / (1 - nu^2) sqrt(R) d^(3/2) [Johnson 1985, section 4.2].
//
// Deterministic. Every call uses its own solver.
#pragma once

#include "tests/support/tissue_problems.hpp"

namespace bregma::test {

// The half space is a block whose cells grow away from the contact. By symmetry a quarter of it is sufficient.
struct HertzMesh {
  double cell_mm = 0.5; // at the contact
  int even_cells = 6;   // number of equal cells, from the axis outwards and from the surface down
  int growing_cells = 10;
  double growth = 1.5;
};

struct HertzAnswer {
  int elements = 0;
  double contact_radius_mm = 0.0; // sqrt(R d)
  double size_mm = 0.0;           // size of the quarter in each direction
  Compared contact_N;             // force from SurfaceContact
  Compared support_N;             // reaction force at the block's bottom
  double unsettled = 0.0;         // relative change of support_N over the last third of the steps
};

[[nodiscard]] HertzAnswer hertz(double sphere_mm, double depth_mm, double poisson, const HertzMesh &mesh,
                                int steps = 3000, const tissue::SolverOptions &options = {});

} // namespace bregma::test
