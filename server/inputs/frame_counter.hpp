// What the frame numbers of one device tell: samples lost on the way, and samples seen twice.
//
// A frame that arrived but was refused is not lost: the numbers of refused samples are remembered until the next good
// one. Threads: one. No allocation, no exceptions.
#pragma once

#include <cstdint>

namespace bregma::inputs {

enum class FrameVerdict {
  kNext,
  kDuplicate,  // the number of the last accepted sample
  kImplausible // far beyond what the time between the two allows, or below the last one
};

class FrameCounter {
public:
  // Starts again with the next sample: the writer is another one, or its clock was set.
  void reset() noexcept;

  // Judges a number, and changes nothing but the run of implausible numbers: after kRenumbered of them in sequence the
  // device is taken to have begun to count anew. elapsed_ns: device time since the last accepted sample.
  [[nodiscard]] FrameVerdict judge(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) noexcept;
  void accept(std::uint64_t frame) noexcept;
  void refuse(std::uint64_t frame) noexcept; // it did arrive

  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }

private:
  static constexpr int kRenumbered = 5;
  bool started_ = false;
  std::uint64_t last_ = 0;
  std::uint64_t refused_ = 0; // bit i: number last_ + 1 + i arrived and was refused
  std::uint64_t lost_ = 0;
  int implausible_run_ = 0;
  std::uint64_t implausible_last_ = 0;
};

} // namespace bregma::inputs
