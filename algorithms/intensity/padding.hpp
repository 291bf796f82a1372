// Padding: one value below the scan's own range that a scanner or an export writes where nothing was measured, as
// -2000 outside the circle of a CT.
#pragma once

#include <cstddef>

#include "algorithms/intensity/features.hpp"

namespace bregma::intensity {

struct Padding {
  float value = 0.0F;
  std::size_t voxels = 0; // 0: there is none
};

// Marks padding as missing (NaN), with what interpolation has left between it and the scan's values. Padding is the
// smallest value if it is negative, that of many voxels, and apart from all others; air and a masked background are
// not.
Padding leave_out_padding(Volume &image);

} // namespace bregma::intensity
