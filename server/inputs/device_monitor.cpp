#include "server/inputs/device_monitor.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "idl/names.hpp"

namespace bregma::inputs {
namespace {

using base::TimeVerdict;

constexpr std::int64_t kRateWindow_ns = 1'000'000'000;

// 1 sigma of a mapped exposure, from the jitter between exposure and write (tests/unit/base/device_clock_test.cpp).
constexpr double kMappingSigma_ns = 200'000.0;

// Times between 1970 and the year 2096. The difference of two such times does not overflow.
constexpr std::int64_t kMaxTime_ns = 4'000'000'000'000'000'000;

bool is_well_formed(const SampleHeader &header) noexcept {
  const auto is_time = [](std::int64_t time_ns) { return time_ns > 0 && time_ns <= kMaxTime_ns; };
  const auto is_stated = [](std::int64_t time_ns) { return time_ns >= 0 && time_ns <= kMaxTime_ns; };
  return is_time(header.device_time_ns) && is_time(header.write.wall_ns) && is_stated(header.write.boot_ns) &&
         is_stated(header.write.wall_error_ns) && header.period_ns >= kMinPeriod_ns &&
         header.period_ns <= kMaxPeriod_ns;
}

Rejection rejection_of(TimeVerdict verdict) noexcept {
  switch (verdict) {
  case TimeVerdict::kBackwards:
    return bregma_wire_REJECT_TIME_BACKWARDS;
  case TimeVerdict::kTooSoon:
    return bregma_wire_REJECT_DUPLICATE;
  case TimeVerdict::kInFuture:
    return bregma_wire_REJECT_TIME_IN_FUTURE;
  case TimeVerdict::kInStep:
  case TimeVerdict::kResynced:
    break;
  }
  return std::nullopt;
}

} // namespace

DeviceMonitor::DeviceMonitor(const wire::Name &name, wire::DeviceKind kind, const DeviceOptions &options) noexcept
    : options_(options), clock_(options.clock) {
  std::memcpy(health_.device, name, sizeof(wire::Name));
  health_.kind = kind;
}

Verdict DeviceMonitor::check(const SampleHeader &header, const Rejection &payload, std::uint64_t writer,
                             std::int64_t now_ns, const HostClock &host) noexcept {
  ++received_;
  if (is_other_writer(writer, now_ns)) {
    ++health_.rejected[bregma_wire_REJECT_DUPLICATE];
    return {.accepted = false, .reason = bregma_wire_REJECT_DUPLICATE};
  }
  if (const Rejection rejection = judge(header, payload, writer, now_ns, host)) {
    ++health_.rejected[*rejection];
    if (health_.taken > 0) {
      frames_.refuse(header.frame, elapsed_ns(header, now_ns), stated_period_ns_);
    }
    return {.accepted = false, .reason = *rejection};
  }
  const bool returned = health_.taken > 0 && (writer != writer_ || status(now_ns) == bregma_wire_DEVICE_LOST);
  if (health_.taken == 0 || returned) {
    ++health_.connections;
  }
  frames_.accept(header.frame);
  ++health_.taken;
  count_other_writer(writer);
  writer_ = writer;
  writers_gone_ = false;
  written_ns_ = clock_of(header.write);
  stated_period_ns_ = header.period_ns;
  period_ns_ = stated_period_.check(header.frame, written_ns_, header.period_ns);
  device_time_ns_ = header.device_time_ns;
  arrived_ns_ = now_ns;
  const double age_sigma_ns = std::hypot(static_cast<double>(transit_.sigma_ns), kMappingSigma_ns);
  health_.age_sigma_ms = age_sigma_ns * 1e-6;
  health_.transit_source = transit_.source;
  health_.transit_ms = static_cast<double>(now_ns - transit_.written_ns) * 1e-6;
  // A better estimate of the clocks may move the line back. Accepted times must still increase.
  const std::int64_t before_write_ns = written_ns_ - clock_.to_host_ns(header.device_time_ns);
  acquired_ns_ = std::max(transit_.written_ns - before_write_ns, acquired_ns_ + 1);
  latency_.add(now_ns - acquired_ns_);
  if (now_ns - acquired_ns_ - options_.clock.minimum_latency_ns > period_ns_) {
    ++health_.late;
  }
  count_rate(now_ns);
  return {.accepted = true,
          .written_time_ns = transit_.written_ns,
          .acquired_time_ns = acquired_ns_,
          .age_sigma_ns = std::llround(age_sigma_ns),
          .period_ns = period_ns_,
          .reconnected = returned};
}

Rejection DeviceMonitor::judge(const SampleHeader &header, const Rejection &payload, std::uint64_t writer,
                               std::int64_t now_ns, const HostClock &host) noexcept {
  if (payload == bregma_wire_REJECT_MALFORMED || !is_well_formed(header)) {
    return bregma_wire_REJECT_MALFORMED;
  }
  if (payload) {
    return payload;
  }
  if (health_.taken > 0 && writer != writer_) {
    take_over(header, now_ns);
  }
  const FrameVerdict number = frames_.judge(header.frame, elapsed_ns(header, now_ns), header.period_ns);
  if (number == FrameVerdict::kDuplicate) {
    return bregma_wire_REJECT_DUPLICATE;
  }
  transit_ = driver_transit_.observe(header.write, now_ns, host);
  if (const Rejection rejection = rejection_of(transit_.verdict)) {
    return rejection;
  }
  const TimeVerdict time = clock_.observe(header.device_time_ns, clock_of(header.write), header.period_ns);
  if (const Rejection rejection = rejection_of(time)) {
    return rejection;
  }
  if (number != FrameVerdict::kImplausible) {
    return std::nullopt;
  }
  if (time == TimeVerdict::kResynced) {
    frames_.reset(); // a restarted device counts anew
    return std::nullopt;
  }
  return bregma_wire_REJECT_MALFORMED;
}

// The first sample of another writer. A link that was down brings the same process back: its numbers and its clock go
// on. A restarted driver has its own count, and possibly its own time base.
void DeviceMonitor::take_over(const SampleHeader &header, std::int64_t now_ns) noexcept {
  if (!frames_.goes_on(header.frame, now_ns - arrived_ns_, header.period_ns)) {
    frames_.reset();
    stated_period_.reset();
  }
  if (!clock_.continues(header.device_time_ns, clock_of(header.write))) {
    clock_.reset();
  }
  if (header.write.boot_id == wire::BootIdentity{}) {
    driver_transit_.reset(); // it cannot be told whether the host is the same
  }
}

// The first writer stays in use until the device is lost.
bool DeviceMonitor::is_other_writer(std::uint64_t writer, std::int64_t now_ns) noexcept {
  if (health_.taken == 0 || writer == writer_ || status(now_ns) == bregma_wire_DEVICE_LOST) {
    return false;
  }
  other_confirmed_ = other_confirmed_ && writer == other_writer_;
  other_writer_ = writer;
  ++other_waiting_;
  return true;
}

// For an accepted sample. A driver that was restarted faster than its loss was noticed is no second one, so samples of
// another writer count only when the first has sent again.
void DeviceMonitor::count_other_writer(std::uint64_t writer) noexcept {
  if (health_.taken > 1 && writer == writer_ && other_waiting_ > 0) {
    health_.other_writer += other_waiting_;
    other_confirmed_ = true;
  } else if (writer != writer_ && other_confirmed_ && writer == other_writer_) {
    ++health_.takeovers;
    other_confirmed_ = false;
  }
  other_waiting_ = 0;
}

// Time since the latest accepted sample. Samples that were held up arrive at the same time, but were written one by
// one.
std::int64_t DeviceMonitor::elapsed_ns(const SampleHeader &header, std::int64_t now_ns) const noexcept {
  const std::int64_t arrival_ns = now_ns - arrived_ns_;
  return is_well_formed(header) ? std::max(arrival_ns, clock_of(header.write) - written_ns_) : arrival_ns;
}

void DeviceMonitor::count_rate(std::int64_t now_ns) noexcept {
  if (window_began_ns_ == 0) {
    window_began_ns_ = now_ns;
    return;
  }
  ++window_count_;
  if (const std::int64_t lasted_ns = now_ns - window_began_ns_; lasted_ns >= kRateWindow_ns) {
    rate_hz_ = static_cast<double>(window_count_) * 1e9 / static_cast<double>(lasted_ns);
    window_began_ns_ = now_ns;
    window_count_ = 0;
  }
}

wire::DeviceStatus DeviceMonitor::status(std::int64_t now_ns) const noexcept {
  if (health_.taken == 0) {
    return bregma_wire_DEVICE_NEVER_SEEN;
  }
  const std::int64_t live_limit_ns = wire::live_limit_ns(options_.live_limit_ms, period_ns_);
  if (writers_gone_ ||
      (options_.deadline_ns > 0 && now_ns - arrived_ns_ > std::max(options_.deadline_ns, live_limit_ns))) {
    return bregma_wire_DEVICE_LOST;
  }
  return now_ns - acquired_ns_ > live_limit_ns ? bregma_wire_DEVICE_STALE : bregma_wire_DEVICE_LIVE;
}

wire::DeviceHealth DeviceMonitor::health(std::int64_t now_ns) const noexcept {
  wire::DeviceHealth out = health_;
  out.status = status(now_ns);
  out.lost = frames_.lost();
  if (health_.taken == 0) {
    out.age_ms = out.latency_p50_ms = out.latency_p99_ms = out.clock_offset_ms = out.clock_drift_ppm = wire::kUnknown;
    out.transit_ms = wire::kUnknown;
    return out;
  }
  const auto latency = latency_.snapshot();
  out.rate_hz = out.status == bregma_wire_DEVICE_LIVE ? rate_hz_ : 0.0;
  out.age_ms = static_cast<double>(now_ns - acquired_ns_) * 1e-6;
  out.latency_p50_ms = latency.percentile_ns(0.50) * 1e-6;
  out.latency_p99_ms = latency.percentile_ns(0.99) * 1e-6;
  out.clock_offset_ms = static_cast<double>(acquired_ns_ - device_time_ns_) * 1e-6;
  out.clock_drift_ppm = clock_.drift_ppm();
  out.stated_rate_hz = 1e9 / static_cast<double>(stated_period_ns_);
  return out;
}

} // namespace bregma::inputs
