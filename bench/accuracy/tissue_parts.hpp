// The parts of bench_tissue that verify and time the explicit solver, one source each: docs/tissue_verification.md.
#pragma once

#include <string>
#include <vector>

#include "bench/accuracy/tissue_thesis.hpp"
#include "bench/record.hpp"

namespace bregma::bench {

constexpr double kPercent = 100.0;

// tissue_analytic.cpp: analytic solutions (tests/support/tissue_problems.hpp), and the order of convergence. Writes its
// picture (SVG) if a file is given; throws std::runtime_error when that cannot be written.
void analytic_figures(Report &report, const TissueBenchOptions &options, const std::string &convergence_picture);

// tissue_speed.cpp: cost of one step by elements, threads, kernels and laws.
void speed_figures(Report &report, const TissueBenchOptions &options);

// tissue_calculix.cpp: static indentation compared with CalculiX, if installed.
void calculix_figures(Report &report, const TissueBenchOptions &options);

// tissue_shift.cpp: brain shift on the case's brain. Writes its picture (SVG) if a file is given; throws
// std::runtime_error when that cannot be written, or the case has no trajectory.
void shift_figures(Report &report, const TissueBenchOptions &options, const std::string &picture);

// tissue_probe.cpp: a sphere on a half space compared with Hertz, and random insertions into a block of 20,000
// tetrahedra.
void hertz_figures(Report &report, const TissueBenchOptions &options);
void robustness_figures(Report &report, const TissueBenchOptions &options);

// Errors of a problem over the edges of its meshes, both axes logarithmic.
struct ErrorCurve {
  std::string name;
  std::vector<double> edge_mm, error;
  [[nodiscard]] double order() const; // slope between the two finest
};
// Throws std::runtime_error when it cannot be written.
void draw_convergence(const std::vector<ErrorCurve> &curves, const std::string &file);

} // namespace bregma::bench
