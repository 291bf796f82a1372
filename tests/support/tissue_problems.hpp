// Boundary value problems with known solutions, run with the explicit solver for tests and bench_tissue.
//
// Deterministic: seeds are constants. Thread-safe: every call uses its own solver.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::test {

struct Compared {
  double value = 0.0;
  double reference = 0.0;
  [[nodiscard]] double error() const; // relative
};

[[nodiscard]] tissue::Material elastic(tissue::Law law, double young_Pa, double poisson);
// With the thesis' E of the brain, and Miller and Chinzei's alpha for Ogden.
[[nodiscard]] tissue::Material brain(tissue::Law law, double poisson);

// A patch test: a deformation gradient displaces the surface of a block with disordered inner nodes.
struct PatchAnswer {
  double displacement_error = 0.0; // maximum over the inner nodes, relative to the largest displacement
  double stress_error = 0.0;       // maximum over the tetrahedra, relative to the largest component
  Eigen::Matrix3d nominal_Pa;      // first Piola-Kirchhoff stress from the surface forces only
  Eigen::Matrix3d reference_Pa;    // the same from principal_cauchy_Pa
};
[[nodiscard]] PatchAnswer patch(const tissue::Material &material, const Eigen::Matrix3d &gradient,
                                const tissue::SolverOptions &options = {});

// A block pressed or pulled along z between frictionless plates.
struct UniaxialAnswer {
  Compared force_N, across_mm;
};
[[nodiscard]] UniaxialAnswer uniaxial(const tissue::Material &material, double stretch,
                                      const tissue::SolverOptions &options = {});

// A field problem: relative RMS error of the displacements over the volume, and one scalar with a known value.
struct FieldAnswer {
  int elements = 0;
  double edge_mm = 0.0;
  double displacement_error = 0.0;
  double stress_error = 0.0; // RMS over the volume, relative to the RMS of the reference
  Compared known;
  tissue::RelaxationResult relaxation;
};

// Hooke's law: octant of a sphere with radii 20 and 40 mm under inner pressure. Scalar: increase of the inner radius
// (mm).
[[nodiscard]] FieldAnswer pressurised_sphere(double poisson, int layers, const tissue::SolverOptions &options = {});

// Neo-Hookean, nearly incompressible: the inner radius is increased by a factor of 1.5. Scalar: the pressure (Pa).
[[nodiscard]] Compared blown_sphere(double poisson, int layers, const tissue::SolverOptions &options = {});

// PlaneStrainBeam, 80 by 20 mm, with `rows` cells over its height. Scalar: the deflection of the end (mm).
[[nodiscard]] FieldAnswer plane_strain_beam(tissue::Law law, double poisson, int rows,
                                            const tissue::SolverOptions &options = {});

// A bar of 100 x 10 x 10 mm with free sides. The deflection of the end (mm) compared with Timoshenko's.
[[nodiscard]] Compared slender_cantilever(double poisson, int rows, const tissue::SolverOptions &options = {});

// A viscoelastic bar after a step strain of 0.2 %. Nominal stress (Pa) at each time.
[[nodiscard]] std::vector<Compared> relaxing_bar(const tissue::Material &material, const std::vector<double> &times_s,
                                                 const tissue::SolverOptions &options = {});

} // namespace bregma::test
