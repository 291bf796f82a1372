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
  implausible_run_ = 0;
}

FrameVerdict FrameCounter::judge(std::uint64_t frame, std::int64_t elapsed_ns, std::int64_t period_ns) noexcept {
  if (!started_) {
    return FrameVerdict::kNext;
  }
  if (frame == last_) {
    return FrameVerdict::kDuplicate;
  }
  const std::uint64_t periods = static_cast<std::uint64_t>(elapsed_ns > 0 ? elapsed_ns / period_ns : 0);
  if (frame > last_ && frame - last_ <= 2 * periods + kSlack) {
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
    const std::uint64_t gap = frame - last_ - 1;
    const std::uint64_t in_gap = gap >= kWindow ? ~std::uint64_t{0} : (std::uint64_t{1} << gap) - 1;
    lost_ += gap - static_cast<std::uint64_t>(std::popcount(refused_ & in_gap));
  }
  started_ = true;
  last_ = frame;
  refused_ = 0;
}

void FrameCounter::refuse(std::uint64_t frame) noexcept {
  if (started_ && frame > last_ && frame - last_ <= kWindow) {
    refused_ |= std::uint64_t{1} << (frame - last_ - 1);
  }
}

} // namespace bregma::inputs
