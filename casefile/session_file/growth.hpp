// How fast recordings grow, and how long a disk lasts for them.
#pragma once

#include <cstdint>

namespace bregma::casefile {

// 252 MB in 105 s of the demo (250 frames/s, tissue model, simulated truth).
inline constexpr double kTypicalBytesPerSecond = 2.4e6;

struct RecordingSpace {
  std::uint64_t free_bytes = 0; // for a program without privileges
  double bytes_per_s = 0.0;     // 0: nothing is recorded
  // Infinite or NaN if nothing is recorded.
  [[nodiscard]] double hours() const { return static_cast<double>(free_bytes) / bytes_per_s / 3600.0; }
};

} // namespace bregma::casefile
