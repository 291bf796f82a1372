// The peer of image registration: elastix (Debian package), 3-D rigid with mutual information [Klein 2010].
#pragma once

#include "algorithms/intensity/rigid_image.hpp"
#include "base/result.hpp"

namespace bregma::bench {

struct ElastixResult {
  intensity::ReferenceFromFloating T_reference_floating;
  double time_s = 0.0; // its own figure: without reading and writing files
};
// Three levels, Mattes' measure with 32 bins, 2,048 random samples per step, 250 steps per level, started with centres
// of geometry aligned, on two threads. An error says that the program is missing, or what it printed.
[[nodiscard]] base::Result<ElastixResult> run_elastix(const intensity::Volume &fixed, const intensity::Volume &moving);

} // namespace bregma::bench
