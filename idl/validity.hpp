// The one rule for live poses, the same in the daemon and in every client (docs/live.md):
//
//   A pose is live while the time since its exposure is at most max(live_limit_ms, three frame periods), and never
//   above 300 ms.
//
// The daemon states in valid_for_ns how much of that time is left when it publishes. A client counts down from there by
// its own CLOCK_BOOTTIME, less the time that the sample was under way. No wall clock takes part.
//
// Threads: an object is used by one thread at a time. Nothing here allocates, locks or throws.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>

#include "idl/topics.hpp"

namespace bregma::wire {

inline constexpr double kLiveLimit_ms = 100.0; // default of live_limit_ms
inline constexpr double kMinLiveLimit_ms = 20.0;
inline constexpr double kMaxLiveLimit_ms = 200.0;
inline constexpr std::int64_t kMaxLiveAge_ns = 300 * kMillisecond_ns;

// Maximum age of a live pose. period_ns: period of the source's frames; 0: not known.
[[nodiscard]] constexpr std::int64_t live_limit_ns(double live_limit_ms, std::int64_t period_ns) noexcept {
  const double limit_ms = std::clamp(live_limit_ms, kMinLiveLimit_ms, kMaxLiveLimit_ms);
  const std::int64_t three_periods_ns = 3 * std::clamp<std::int64_t>(period_ns, 0, kMaxLiveAge_ns);
  return std::min(std::max(static_cast<std::int64_t>(limit_ms * 1e6), three_periods_ns), kMaxLiveAge_ns);
}

// Time that the samples of one publisher were under way, from CLOCK_BOOTTIME at both ends.
//
// On one boot it is exact. From another host it is the height above the lower envelope of arrival minus publication, so
// the shortest delay of the path is not seen. The envelope is valid once samples have arrived without a pause of
// kSettling_ns for that time: what is received when a client joins, or wakes after it was stopped, can be old. It may
// rise by the largest difference of two quartz clocks, 100 ppm; delays that grow faster are seen.
class TransitClock {
public:
  static constexpr std::int64_t kSettling_ns = 250 * kMillisecond_ns;
  static constexpr std::int64_t kForgotten_ns = 10'000 * kMillisecond_ns; // pause after which it begins again
  static constexpr double kMaxDrift = 100e-6;

  explicit TransitClock(const std::array<std::uint8_t, 16> &own_boot_id) noexcept : own_(own_boot_id) {}

  // For every sample as it arrives. Empty while the transit is not known, and for a sample without a publication time
  // or published in the future of the same boot's clock.
  std::optional<std::int64_t> arrived(const BootId &boot_id, std::int64_t published_boot_ns,
                                      std::int64_t arrival_boot_ns) noexcept;

private:
  std::array<std::uint8_t, 16> own_;
  std::array<std::uint8_t, 16> publisher_{};
  std::optional<std::int64_t> offset_ns_; // envelope of arrival - published, at offset_at_ns_
  std::int64_t offset_at_ns_ = 0;
  std::int64_t flowing_since_ns_ = 0;
  std::int64_t last_arrival_ns_ = 0;
  bool settled_ = false;
};

// False for a status without a pose, for implausible data, and for a pose or error that is not finite.
[[nodiscard]] bool has_pose(const NavigationState &state) noexcept;

// When a client received a sample, on its own CLOCK_BOOTTIME.
struct Arrival {
  std::int64_t boot_ns = 0;
  std::optional<std::int64_t> transit_ns; // as TransitClock::arrived() stated it
};

// Time since publication; empty while the transit is not known, and for a `now` before the arrival.
[[nodiscard]] std::optional<std::int64_t> since_published_ns(const Arrival &arrival, std::int64_t now_boot_ns) noexcept;

// Age of the pose now; empty if it is not known. A negative age is no age.
[[nodiscard]] std::optional<std::int64_t> age_ns(const NavigationState &state, const Arrival &arrival,
                                                 std::int64_t now_boot_ns) noexcept;

// Time for which the pose may still be shown; 0: it must not be shown. 0 also for a status without a pose, for a pose
// or error that is not finite, for implausible data, and while the age is not known. A daemon of wire 2.0 states no
// valid_for_ns: the default limit counts for it.
[[nodiscard]] std::int64_t remaining_ns(const NavigationState &state, const Arrival &arrival,
                                        std::int64_t now_boot_ns) noexcept;

// Error of the tip at a time after publication: the published one, with the growth that the state carries (state.idl).
// Unchanged if the state carries none.
struct TipError {
  Ellipsoid region_95;
  double rms_mm;
};
[[nodiscard]] TipError tip_error(const NavigationState &state, std::int64_t since_published_ns) noexcept;

} // namespace bregma::wire
