// The transit of a driver's samples, from its write to the arrival here, and the uncertainty of that time
// (docs/time.md).
//
// A driver states its CLOCK_BOOTTIME at the write, the boot id, its wall clock and the error of that. Our clock minus
// the driver's, the offset, is
//
// - the same clock on the same boot: the transit is exact;
// - measured by the wall clocks where both are synchronised, to the sum of their stated errors. A step of one of them
//   contradicts the offset before it: that is held, with an uncertainty that grows by the drift of two crystals;
// - otherwise only bounded: a transit is not negative, so the offset is at most the lower envelope of arrival minus
//   write. The envelope is held for as long as drift allows (base/device_clock.hpp), so that a latency that rises and
//   stays remains visible. The shortest transit is then part of the uncertainty.
//
// Threads: one. No allocation, no exceptions.
#pragma once

#include <cstdint>

#include "base/device_clock.hpp"
#include "idl/host_clock.hpp"
#include "idl/topics.hpp"

namespace bregma::inputs {

// The driver's clock that its times are related to. Without a stated boot time it is the wall clock, of unknown steps.
[[nodiscard]] inline std::int64_t clock_of(const wire::WriteTime &write) noexcept {
  return write.boot_ns > 0 ? write.boot_ns : write.wall_ns;
}

// Of this host. By default nothing is stated: no boot id, not synchronised.
struct HostClock {
  wire::BootIdentity boot_id{};
  std::int64_t utc_minus_boot_ns = 0;  // constant: steady UTC, the scale of arrival times, minus CLOCK_BOOTTIME
  std::int64_t wall_minus_boot_ns = 0; // changes by steps of the wall clock
  std::int64_t wall_error_ns = 0;      // 0: not synchronised
};

struct Transit {
  base::TimeVerdict verdict = base::TimeVerdict::kInStep; // the next fields are valid if in step or resynced
  wire::TransitSource source = bregma_wire_TRANSIT_UNKNOWN;
  std::int64_t written_ns = 0; // the write on the scale of the arrival
  std::int64_t sigma_ns = 0;   // 1 sigma of that, from its bounds as those of a uniform distribution
};

class DriverTransit {
public:
  // Drift between two hosts' clocks: crystals without a common time service.
  static constexpr double kDrift_ppm = 100.0;
  // Bound of the shortest transit of a path without synchronised clocks.
  static constexpr std::int64_t kShortestTransit_ns = 10'000'000;
  // A boot clock that is ahead of ours by more is not the same one. The arrival is the time at which the stage's step
  // began. A step that is preempted takes samples that were written after that; their transit is 0.
  static constexpr std::int64_t kSameClock_ns = 100'000'000;
  // Differences of synchronised clocks below this are not significant: two clocks are not read at the same instant.
  static constexpr std::int64_t kLeastError_ns = 1'000'000;

  DriverTransit();

  void reset() noexcept;
  [[nodiscard]] Transit observe(const wire::WriteTime &write, std::int64_t arrival_ns, const HostClock &host) noexcept;

private:
  [[nodiscard]] bool synchronise(const wire::WriteTime &write, const HostClock &host) noexcept;

  base::DeviceClock envelope_;
  wire::BootIdentity boot_id_{};
  // Bounds of the offset, below the envelope, which is the highest one.
  bool started_ = false;
  bool measured_ = false; // the depth was measured; else it is assumed
  double depth_ns_ = 0.0; // of the lowest possible offset; grows by the drift
  double gap_ns_ = 0.0;   // of the estimate: the shortest transit where it was measured
  double half_ns_ = 0.0;  // half width of the bounds of the latest estimate
  std::int64_t highest_ns_ = 0;
  std::int64_t last_ns_ = 0;
};

} // namespace bregma::inputs
