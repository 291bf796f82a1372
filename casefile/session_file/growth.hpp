// How fast recordings grow.
#pragma once

namespace bregma::casefile {

// 252 MB in 105 s of the demo (250 frames/s, tissue model, simulated truth).
inline constexpr double kTypicalBytesPerSecond = 2.4e6;

} // namespace bregma::casefile
