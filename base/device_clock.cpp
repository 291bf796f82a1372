#include "base/device_clock.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::base {
namespace {

// Minimal number of blocks: with fewer, the slope reflects the latency's scatter more than the drift.
constexpr std::size_t kBlocksForDrift = 4;

// The line may fall by this fraction of the elapsed time, and by the tolerance at once. Without the limit a device that
// sends too fast would pull the line down with it.
constexpr double kPressRate = 0.002;

double difference(std::int64_t a, std::int64_t b) { return static_cast<double>(a - b); }

} // namespace

void DeviceClock::reset() noexcept {
  block_count_ = 0;
  candidate_count_ = 0;
  drift_ = 0.0;
}

std::int64_t DeviceClock::to_host_ns(std::int64_t device_time_ns) const noexcept {
  return device_time_ns + predicted_offset_ns(device_time_ns) - options_.minimum_latency_ns;
}

bool DeviceClock::continues(std::int64_t device_time_ns, std::int64_t arrival_ns) const noexcept {
  const std::int64_t height = arrival_ns - device_time_ns - predicted_offset_ns(device_time_ns);
  return is_synchronised() && device_time_ns > last_ns_ && height >= -options_.future_tolerance_ns &&
         height <= options_.agreement_ns;
}

std::int64_t DeviceClock::predicted_offset_ns(std::int64_t device_time_ns) const noexcept {
  return anchor_.offset_ns + std::llround(drift_ * difference(device_time_ns, anchor_.device_ns));
}

TimeVerdict DeviceClock::observe(std::int64_t device_time_ns, std::int64_t arrival_ns,
                                 std::int64_t period_ns) noexcept {
  const Point point{device_time_ns, arrival_ns - device_time_ns};
  if (!is_synchronised()) {
    start(point);
    return TimeVerdict::kInStep;
  }
  const bool settling = device_time_ns - started_ns_ < options_.settling_ns;
  const std::int64_t tolerance = settling ? options_.settling_tolerance_ns : options_.future_tolerance_ns;
  const std::int64_t step = device_time_ns - last_ns_;
  const std::int64_t height = point.offset_ns - predicted_offset_ns(device_time_ns); // above the line
  const std::int64_t recovered = std::llround(kPressRate * difference(arrival_ns, arrived_ns_));
  const std::int64_t pressed = settling ? 0 : std::max<std::int64_t>(pressed_ns_ - recovered, 0);
  const bool in_future = height - pressed < -tolerance;
  // A clock that was set back reaches its old time again after a while. Samples then only appear late, but they still
  // agree with those rejected before.
  const bool goes_on = candidate_count_ > 0 && 2 * std::abs(point.offset_ns - candidate_first_.offset_ns) < height;
  const bool backwards = period_ns > 0 ? step <= 0 : step < 0;
  if (backwards || in_future || goes_on) {
    if (is_candidate_accepted(point, period_ns)) {
      ++resyncs_;
      return TimeVerdict::kResynced;
    }
    return in_future ? TimeVerdict::kInFuture : TimeVerdict::kBackwards;
  }
  if (2 * step < period_ns) {
    return TimeVerdict::kTooSoon;
  }
  candidate_count_ = 0;
  last_ns_ = device_time_ns;
  arrived_ns_ = arrival_ns;
  pressed_ns_ = pressed + std::max<std::int64_t>(-height, 0);
  learn(point);
  return TimeVerdict::kInStep;
}

// The run must last for resync_ns of the host's time at the device's own rate. So neither a burst of old samples nor a
// flood with arbitrary times is accepted as a clock.
bool DeviceClock::is_candidate_accepted(const Point &point, std::int64_t period_ns) noexcept {
  const bool agrees = candidate_count_ > 0 && 2 * (point.device_ns - candidate_last_ns_) >= period_ns &&
                      std::abs(point.offset_ns - candidate_first_.offset_ns) <= options_.agreement_ns;
  if (!agrees) {
    candidate_count_ = 0;
    candidate_first_ = point;
    candidate_lowest_ = point;
  }
  ++candidate_count_;
  candidate_last_ns_ = point.device_ns;
  if (point.offset_ns < candidate_lowest_.offset_ns) {
    candidate_lowest_ = point;
  }
  const std::int64_t lasted =
      point.device_ns + point.offset_ns - (candidate_first_.device_ns + candidate_first_.offset_ns);
  if (candidate_count_ < options_.resync_samples || lasted < options_.resync_ns) {
    return false;
  }
  start(candidate_lowest_);
  last_ns_ = point.device_ns;
  return true;
}

void DeviceClock::start(const Point &point) noexcept {
  blocks_[0] = point;
  block_count_ = 1;
  block_began_ns_ = point.device_ns;
  started_ns_ = point.device_ns;
  last_ns_ = point.device_ns;
  arrived_ns_ = point.device_ns + point.offset_ns;
  pressed_ns_ = 0;
  anchor_ = point;
  drift_ = options_.hold_ppm * 1e-6;
  candidate_count_ = 0;
}

void DeviceClock::learn(const Point &point) noexcept {
  const auto height = [&](const Point &p) { return p.offset_ns - predicted_offset_ns(p.device_ns); };
  if (options_.hold_ppm > 0.0) {
    if (height(point) < 0) {
      anchor_ = point;
    }
    return;
  }
  if (point.device_ns - block_began_ns_ >= options_.block_ns) {
    if (block_count_ == kBlocks) {
      std::copy(blocks_.begin() + 1, blocks_.end(), blocks_.begin());
      --block_count_;
    }
    blocks_[block_count_++] = point;
    block_began_ns_ = point.device_ns;
    fit();
    return;
  }
  Point &lowest = blocks_[block_count_ - 1];
  if (height(point) < height(lowest)) {
    lowest = point;
    fit();
  }
}

// The line below the points that is nearest to them on average contains the edge of the lower convex hull at their mean
// time. Its slope is the drift.
void DeviceClock::fit() noexcept {
  const Point origin = blocks_[0];
  struct Relative {
    double t;
    double y;
  };
  std::array<Relative, kBlocks> hull{};
  std::size_t size = 0;
  double mean = 0.0;
  for (std::size_t i = 0; i < block_count_; ++i) {
    const Relative p{difference(blocks_[i].device_ns, origin.device_ns),
                     difference(blocks_[i].offset_ns, origin.offset_ns)};
    mean += p.t / static_cast<double>(block_count_);
    while (size >= 2 && (hull[size - 1].y - hull[size - 2].y) * (p.t - hull[size - 2].t) >=
                            (p.y - hull[size - 2].y) * (hull[size - 1].t - hull[size - 2].t)) {
      --size;
    }
    hull[size++] = p;
  }
  drift_ = 0.0;
  if (block_count_ >= kBlocksForDrift) {
    std::size_t right = 1;
    while (right + 1 < size && hull[right].t < mean) {
      ++right;
    }
    const double slope = (hull[right].y - hull[right - 1].y) / (hull[right].t - hull[right - 1].t);
    drift_ = std::clamp(slope, -options_.max_drift_ppm * 1e-6, options_.max_drift_ppm * 1e-6);
  }
  // The line supports the points from below for every limited slope.
  const auto lowest =
      std::min_element(hull.begin(), hull.begin() + static_cast<std::ptrdiff_t>(size),
                       [&](const Relative &a, const Relative &b) { return a.y - drift_ * a.t < b.y - drift_ * b.t; });
  anchor_ = {origin.device_ns + std::llround(lowest->t), origin.offset_ns + std::llround(lowest->y)};
}

} // namespace bregma::base
