// The curve of a range sensor in a file, as `bregma calibrate range --json` prints it.
#pragma once

#include <filesystem>

#include "algorithms/range/power_law.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// Law, covariance (0 if the file has none), corrections and what they leave. A curve that was not accepted is refused.
[[nodiscard]] base::Result<range::PowerLawFit> read_range_curve(const std::filesystem::path &file);

} // namespace bregma::casefile
