// How a number that is not known is stored, everywhere: as NaN, so that it cannot be taken for a measurement.
#pragma once

#include <limits>

namespace bregma::geometry {

inline constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

} // namespace bregma::geometry
