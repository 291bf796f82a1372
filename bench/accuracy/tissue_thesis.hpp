// The set-up of [thesis, section 6.3] in the plane: docs/tissue_plane.md.
#pragma once

#include <string>

#include "bench/record.hpp"

namespace bregma::bench {

struct TissueBenchOptions : Options {
  std::string case_folder = "out/cases/colin27"; // the section is cut from its brain
  std::string thesis_picture;                    // SVG of the run; none when empty
};

// Throws std::runtime_error when the case has no brain.
void thesis_figures(Report &report, const TissueBenchOptions &options);

} // namespace bregma::bench
