// Detects lost and duplicate samples of one device from its frame numbers.
//
// A frame that arrived but was rejected is not lost: the numbers of rejected samples are kept until the next accepted
// one. Threads: one. No allocation, no exceptions.
#pragma once

#include <cstdint>

namespace bregma::inputs {

enum class FrameVerdict {
  kNext,
  kDuplicate,  // the number of the last accepted sample
  kImplausible // far more than the elapsed time allows, or below the last one
};

class FrameCounter {
public:
  // Restarts with the next sample: the device counts anew.
  void reset() noexcept;

  // Checks a number and updates only the run of implausible numbers. After kRenumbered of them in sequence the device
  // is assumed to have restarted its count. elapsed_ns: since the last accepted sample.
  [[nodiscard]] FrameVerdict judge(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) noexcept;
  // True if the number can follow the last accepted one. Another writer whose numbers go on is the same device.
  [[nodiscard]] bool goes_on(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) const noexcept;
  void accept(std::uint64_t frame) noexcept;
  // The frame arrived and was rejected. It is not lost, also if it is late and was counted so: one of the 64 before the
  // last accepted one.
  void refuse(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) noexcept;

  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }

private:
  [[nodiscard]] bool was_refused(std::uint64_t frame) const noexcept;
  [[nodiscard]] std::uint64_t refused_below(std::uint64_t frame) const noexcept;
  void keep_refused_above(std::uint64_t frame) noexcept;

  static constexpr int kRenumbered = 5;
  bool started_ = false;
  std::uint64_t last_ = 0;
  // Numbers after last_ that arrived and were rejected: how many, the highest, and which of the 64 up to that (bit i:
  // highest_refused_ - i). One below these is not known.
  std::uint64_t refused_ = 0;
  std::uint64_t highest_refused_ = 0;
  std::uint64_t refused_bits_ = 0;
  std::uint64_t lost_ = 0;
  std::uint64_t lost_bits_ = 0; // bit i: number last_ - 1 - i was counted as lost
  int implausible_run_ = 0;
  std::uint64_t implausible_last_ = 0;
};

} // namespace bregma::inputs
