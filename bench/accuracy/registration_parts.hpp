// The parts of bench_registration, one source each.
#pragma once

#include <string>

#include "bench/record.hpp"

namespace bregma::bench {

struct RegistrationBenchOptions : Options {
  std::string case_folder = "out/cases/colin27"; // its scalp is the head
  std::string basin_file;                        // SVG of the convergence basin; none when empty
};

// registration_surface.cpp: local and global surface registration.
void surface_figures(Report &report, const RegistrationBenchOptions &options);
// registration_clouds.cpp: paired points, clouds, splines and curves.
void cloud_figures(Report &report, const RegistrationBenchOptions &options);

} // namespace bregma::bench
