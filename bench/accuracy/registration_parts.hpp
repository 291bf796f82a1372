// The parts of bench_registration, one source each.
#pragma once

#include <string>
#include <vector>

#include "algorithms/surface/surface_field.hpp"
#include "bench/accuracy/registration_head.hpp"
#include "bench/record.hpp"

namespace bregma::bench {

struct RegistrationBenchOptions : Options {
  std::string case_folder = "out/cases/colin27"; // its scalp is the head
  int runs = 100;                                // per cell of table 1
  int slow_runs = 0;                             // of its slow peers; 0: a part of runs
  std::string basin_file;                        // SVG of the convergence basin; none when empty
  std::string pictures;                          // folder for the figures of table 1; none when empty
  std::vector<std::string> heads;                // surfaces or images of other heads
};
inline const std::vector<std::string> kRegistrationParts{
    "local", "global", "table1", "degenerate", "coverage", "heads", "points", "clouds", "splines", "curves", "basin"};

constexpr double kWrong_mm = 10.0; // RMSE above which a pose that was "found" is wrong
constexpr int kThreads = 2;

// registration_surface.cpp: local and global surface registration.
void surface_figures(Report &report, const RegistrationBenchOptions &options);
// registration_table1.cpp: [NeuroGuide, table 1] with the methods that the paper used or tried.
void table1_figures(Report &report, const RegistrationBenchOptions &options, const Head &head,
                    const surface::SurfaceField &field);
// registration_heads.cpp: the verdict on heads that its thresholds were not set on.
void head_figures(Report &report, const RegistrationBenchOptions &options);
void point_figures(Report &report, const RegistrationBenchOptions &options);
void cloud_figures(Report &report, const RegistrationBenchOptions &options);
void spline_figures(Report &report, const RegistrationBenchOptions &options);
void curve_figures(Report &report);

} // namespace bregma::bench
