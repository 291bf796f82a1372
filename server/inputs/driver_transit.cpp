#include "server/inputs/driver_transit.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::inputs {
namespace {

using base::TimeVerdict;

constexpr double kSqrt3 = 1.7320508075688772;

} // namespace

DriverTransit::DriverTransit() : envelope_({.hold_ppm = kDrift_ppm}) {}

void DriverTransit::reset() noexcept {
  envelope_.reset();
  started_ = false;
  measured_ = false;
  gap_ns_ = 0;
}

Transit DriverTransit::observe(const wire::WriteTime &write, std::int64_t arrival_ns, const HostClock &host) noexcept {
  if (write.boot_id != boot_id_) { // another host, or the same after a start
    reset();
    boot_id_ = write.boot_id;
  }
  if (write.boot_ns > 0 && write.boot_id != wire::BootIdentity{} && write.boot_id == host.boot_id) {
    const std::int64_t written_ns = write.boot_ns + host.utc_minus_boot_ns;
    return {.verdict = written_ns - arrival_ns > kSameClock_ns ? TimeVerdict::kInFuture : TimeVerdict::kInStep,
            .source = bregma_wire_TRANSIT_SAME_HOST,
            .written_ns = std::min(written_ns, arrival_ns)};
  }
  const std::int64_t clock_ns = clock_of(write);
  const TimeVerdict verdict = envelope_.observe(clock_ns, arrival_ns, 0);
  if (verdict != TimeVerdict::kInStep && verdict != TimeVerdict::kResynced) {
    return {.verdict = verdict};
  }
  const std::int64_t highest_ns = envelope_.to_host_ns(clock_ns) - clock_ns;
  depth_ns_ +=
      static_cast<double>(highest_ns - highest_ns_) + kDrift_ppm * 1e-6 * static_cast<double>(clock_ns - last_ns_);
  highest_ns_ = highest_ns;
  last_ns_ = clock_ns;
  if (!started_ || verdict == TimeVerdict::kResynced || depth_ns_ < 0.0) {
    started_ = true;
    measured_ = false;
    gap_ns_ = 0.0;
    depth_ns_ = kShortestTransit_ns;
  }
  const bool synchronised = synchronise(write, host);
  if (!synchronised) {
    half_ns_ = std::max(depth_ns_ - gap_ns_, gap_ns_);
  }
  return {.verdict = verdict,
          .source = synchronised ? bregma_wire_TRANSIT_SYNCHRONISED
                    : measured_  ? bregma_wire_TRANSIT_HELD
                                 : bregma_wire_TRANSIT_ENVELOPE,
          .written_ns = std::min<std::int64_t>(clock_ns + highest_ns - std::llround(gap_ns_), arrival_ns),
          .sigma_ns = std::llround(half_ns_ / kSqrt3)};
}

// Measures the offset by the wall clocks. False if they are not synchronised, or if they contradict what is known: one
// of them was stepped, or is wrong although its time service states otherwise.
bool DriverTransit::synchronise(const wire::WriteTime &write, const HostClock &host) noexcept {
  if (write.boot_ns <= 0 || write.wall_error_ns <= 0 || host.wall_error_ns <= 0) {
    return false;
  }
  const std::int64_t offset_ns = (write.wall_ns - write.boot_ns) - host.wall_minus_boot_ns + host.utc_minus_boot_ns;
  const auto below = static_cast<double>(highest_ns_ - offset_ns); // the measured offset, below the envelope
  const auto error = static_cast<double>(std::max(write.wall_error_ns + host.wall_error_ns, kLeastError_ns));
  if (below + error < 0.0 || (measured_ && below - error > depth_ns_)) {
    return false;
  }
  depth_ns_ = measured_ ? std::min(depth_ns_, below + error) : below + error;
  measured_ = true;
  const double least = std::max(0.0, below - error);
  gap_ns_ = std::clamp(below, least, depth_ns_);
  half_ns_ = std::max(depth_ns_ - gap_ns_, gap_ns_ - least);
  return true;
}

} // namespace bregma::inputs
