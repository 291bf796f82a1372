// Compares the period that a device states with the time between its frame numbers, which losses do not change. A
// device that states a longer period than it keeps would be shown as live for too long. Threads: one. No allocation, no
// exceptions.
#pragma once

#include <cstdint>

namespace bregma::inputs {

class StatedPeriod {
public:
  void reset() noexcept { began_ = false; }

  // An accepted sample. time_ns: the driver's clock at the write. Returns the period to use: the stated one, or the
  // measured one if that is shorter by more than the tolerance.
  [[nodiscard]] std::int64_t check(std::uint64_t frame, std::int64_t time_ns, std::int64_t stated_ns) noexcept {
    // A driver's clock may show any time: the difference is never negative, and may be larger than the type of both.
    const std::uint64_t elapsed_ns = static_cast<std::uint64_t>(time_ns) - static_cast<std::uint64_t>(time_ns_);
    if (!began_ || frame <= frame_ || time_ns < time_ns_) {
      began_ = true;
      frame_ = frame;
      time_ns_ = time_ns;
      measured_ns_ = 0;
    } else if (frame - frame_ >= kFrames && elapsed_ns >= kWindow_ns) {
      measured_ns_ = static_cast<std::int64_t>(elapsed_ns / (frame - frame_));
      frame_ = frame;
      time_ns_ = time_ns;
    }
    return measured_ns_ > 0 && stated_ns - stated_ns / kTolerance > measured_ns_ ? measured_ns_ : stated_ns;
  }

private:
  static constexpr std::uint64_t kWindow_ns = 1'000'000'000;
  static constexpr std::uint64_t kFrames = 8;
  static constexpr std::int64_t kTolerance = 5; // a fifth of the stated period

  bool began_ = false;
  std::uint64_t frame_ = 0; // at the start of the window
  std::int64_t time_ns_ = 0;
  std::int64_t measured_ns_ = 0; // 0: not yet
};

} // namespace bregma::inputs
