#include "server/inputs/frame_counter.hpp"

#include <bit>

namespace bregma::inputs {
namespace {

constexpr std::uint64_t kWindow = 64;

// Tolerance for a device that was delayed, or whose clock and count disagree slightly.
constexpr std::uint64_t kSlack = 16;

} // namespace

void FrameCounter::reset() noexcept {
  started_ = false;
  refused_ = 0;
  refused_bits_ = 0;
  implausible_run_ = 0;
}

bool FrameCounter::goes_on(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) const noexcept {
  const std::uint64_t periods = static_cast<std::uint64_t>(elapsed_ns > 0 ? elapsed_ns / period_ns : 0);
  return started_ && frame > last_ && frame - last_ <= 2 * periods + kSlack;
}

FrameVerdict FrameCounter::judge(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) noexcept {
  if (!started_) {
    return FrameVerdict::kNext;
  }
  if (frame == last_) {
    return FrameVerdict::kDuplicate;
  }
  if (goes_on(frame, elapsed_ns, period_ns)) {
    implausible_run_ = 0;
    return FrameVerdict::kNext;
  }
  const bool in_sequence = implausible_run_ > 0 && frame > implausible_last_ && frame - implausible_last_ <= kSlack;
  implausible_run_ = in_sequence ? implausible_run_ + 1 : 1;
  implausible_last_ = frame;
  if (implausible_run_ < kRenumbered) {
    return FrameVerdict::kImplausible;
  }
  reset();
  return FrameVerdict::kNext;
}

void FrameCounter::accept(std::uint64_t frame) noexcept {
  if (started_) {
    std::uint64_t in_gap = refused_;
    if (refused_ > 0 && highest_refused_ >= frame) { // some are not below this one
      const std::uint64_t beyond = highest_refused_ - frame + 1;
      in_gap -= static_cast<std::uint64_t>(
          std::popcount(beyond >= kWindow ? refused_bits_ : refused_bits_ & ((std::uint64_t{1} << beyond) - 1)));
    }
    lost_ += frame - last_ - 1 - in_gap;
  }
  started_ = true;
  last_ = frame;
  refused_ = 0;
  refused_bits_ = 0;
}

void FrameCounter::refuse(std::uint64_t frame) noexcept {
  if (refused_ == 0 || frame > highest_refused_) {
    const std::uint64_t by = refused_ == 0 ? 0 : frame - highest_refused_;
    refused_bits_ = (by >= kWindow ? 0 : refused_bits_ << by) | 1;
    highest_refused_ = frame;
    ++refused_;
    return;
  }
  const std::uint64_t below = highest_refused_ - frame;
  if (below < kWindow && (refused_bits_ >> below & 1) == 0) {
    refused_bits_ |= std::uint64_t{1} << below;
    ++refused_;
  }
}

} // namespace bregma::inputs
