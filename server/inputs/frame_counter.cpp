#include "server/inputs/frame_counter.hpp"

#include <algorithm>
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
  if (started_ && frame > last_) {
    const std::uint64_t gap = frame - last_ - 1;
    lost_ += gap - refused_below(frame);
    // Newest first: those of the gap that are not among the rejected ones, then those before.
    std::uint64_t bits = gap + 1 >= kWindow ? 0 : lost_bits_ << (gap + 1);
    for (std::uint64_t i = 0; i < std::min(gap, kWindow); ++i) {
      bits |= was_refused(frame - 1 - i) ? 0 : std::uint64_t{1} << i;
    }
    lost_bits_ = bits;
  } else {
    lost_bits_ = 0;
  }
  started_ = true;
  last_ = frame;
  keep_refused_above(frame);
}

// Numbers above this one arrived too, and were rejected before it came.
void FrameCounter::keep_refused_above(std::uint64_t frame) noexcept {
  const std::uint64_t above = refused_ > 0 && highest_refused_ > frame ? highest_refused_ - frame : 0;
  refused_bits_ &= above >= kWindow ? ~std::uint64_t{0} : (std::uint64_t{1} << above) - 1;
  refused_ = static_cast<std::uint64_t>(std::popcount(refused_bits_));
}

bool FrameCounter::was_refused(std::uint64_t frame) const noexcept {
  return refused_ > 0 && frame <= highest_refused_ && highest_refused_ - frame < kWindow &&
         (refused_bits_ >> (highest_refused_ - frame) & 1) != 0;
}

std::uint64_t FrameCounter::refused_below(std::uint64_t frame) const noexcept {
  if (refused_ == 0 || highest_refused_ < frame) {
    return refused_;
  }
  const std::uint64_t beyond = highest_refused_ - frame + 1;
  const std::uint64_t mask = beyond >= kWindow ? ~std::uint64_t{0} : (std::uint64_t{1} << beyond) - 1;
  return refused_ - static_cast<std::uint64_t>(std::popcount(refused_bits_ & mask));
}

void FrameCounter::refuse(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) noexcept {
  if (started_ && frame < last_) {
    const std::uint64_t before = last_ - 1 - frame;
    if (before < kWindow && (lost_bits_ >> before & 1) != 0) {
      lost_bits_ &= ~(std::uint64_t{1} << before);
      --lost_;
    }
    return;
  }
  if (!goes_on(frame, elapsed_ns, period_ns)) {
    return;
  }
  if (refused_ == 0 || frame > highest_refused_) {
    const std::uint64_t by = refused_ == 0 ? 0 : frame - highest_refused_;
    refused_bits_ = (by >= kWindow ? 0 : refused_bits_ << by) | 1;
    highest_refused_ = frame;
    ++refused_;
    return;
  }
  if (highest_refused_ - frame < kWindow && !was_refused(frame)) {
    refused_bits_ |= std::uint64_t{1} << (highest_refused_ - frame);
    ++refused_;
  }
}

} // namespace bregma::inputs
