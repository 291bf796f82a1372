// Boundary value problems with a known answer, run by the explicit solver: what tests assert and bench_tissue prints.
//
// Deterministic: seeds are constants. Thread-safe in that every call has its own solver.
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
// With the brain's E of the thesis, and Miller and Chinzei's alpha for Ogden.
[[nodiscard]] tissue::Material brain(tissue::Law law, double poisson);

// The surface of a block with disordered inner nodes is moved by a deformation gradient.
struct PatchAnswer {
  double displacement_error = 0.0; // largest of the inner nodes', by the largest displacement
  double stress_error = 0.0;       // largest of the tetrahedra's, by the largest component
  Eigen::Matrix3d nominal_Pa;      // first Piola-Kirchhoff stress from the forces on the surface alone
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

// A field problem: error of the displacements (RMS over the volume by the RMS displacement) and one value people know.
struct FieldAnswer {
  int elements = 0;
  double edge_mm = 0.0;
  double displacement_error = 0.0;
  double stress_error = 0.0; // RMS over the volume, by the RMS of the reference
  Compared known;
  tissue::RelaxationResult relaxation;
};

// Hooke's law; octant of a sphere 20 to 40 mm under a pressure inside. Known: the inner radius' growth (mm).
[[nodiscard]] FieldAnswer pressurised_sphere(double poisson, int layers, const tissue::SolverOptions &options = {});

// Neo-Hookean, nearly incompressible: the inner radius is made 1.5 times as large. Known: the pressure (Pa).
[[nodiscard]] Compared blown_sphere(double poisson, int layers, const tissue::SolverOptions &options = {});

// PlaneStrainBeam, 80 by 20 mm, rows cells over its height. Known: the deflection of the end (mm).
[[nodiscard]] FieldAnswer plane_strain_beam(tissue::Law law, double poisson, int rows,
                                            const tissue::SolverOptions &options = {});

// A bar 100 x 10 x 10 mm with free sides. The deflection of the end (mm) beside Timoshenko's.
[[nodiscard]] Compared slender_cantilever(double poisson, int rows, const tissue::SolverOptions &options = {});

// A viscoelastic bar stretched by 0.2 % at once. Nominal stress (Pa) at each time.
[[nodiscard]] std::vector<Compared> relaxing_bar(const tissue::Material &material, const std::vector<double> &times_s,
                                                 const tissue::SolverOptions &options = {});

} // namespace bregma::test
