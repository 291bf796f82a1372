// The way of a driver's samples to the daemon in virtual time: the clocks of the driver's host, which complete a sample
// as the driver frame does, and a network that delays it and keeps the order. By default the driver runs on the
// daemon's host and nothing is delayed.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <utility>

#include "idl/host_clock.hpp"

namespace bregma::test {

inline constexpr wire::BootIdentity kDaemonBoot{1};
inline constexpr wire::BootIdentity kOtherBoot{2};

class VirtualLink {
public:
  // Times are those of the daemon's host; its CLOCK_BOOTTIME began at start_utc_ns.
  explicit VirtualLink(std::int64_t start_utc_ns) : start_utc_ns_(start_utc_ns) {}

  // The clocks of the driver's host.
  wire::BootIdentity boot_id = kDaemonBoot;
  std::int64_t boot_lead_ns = 0; // its CLOCK_BOOTTIME minus the daemon's, at the start; only with another boot id
  double drift_ppm = 0.0;        // of its clocks
  std::int64_t wall_lead_ns = 0; // its wall clock minus UTC, without drift: the steps
  std::int64_t wall_error_ns = 0;
  // Delay of a sample that is written at the given time.
  std::function<std::int64_t(std::int64_t utc_ns)> delay_ns = [](std::int64_t) { return std::int64_t{0}; };

  [[nodiscard]] wire::WriteTime write_time(std::int64_t utc_ns) const {
    const auto gained_ns = static_cast<std::int64_t>(drift_ppm * 1e-6 * static_cast<double>(utc_ns - start_utc_ns_));
    return {.boot_id = boot_id,
            .boot_ns = kBootAtStart_ns + utc_ns - start_utc_ns_ + boot_lead_ns + gained_ns,
            .wall_ns = utc_ns + wall_lead_ns + (wall_error_ns > 0 ? 0 : gained_ns),
            .wall_error_ns = wall_error_ns};
  }

  // States the time of the write.
  template <class Sample> void stamp(Sample &sample, std::int64_t utc_ns) const {
    const wire::WriteTime write = write_time(utc_ns);
    sample.sent_time_ns = write.wall_ns;
    sample.sent_boot_ns = write.boot_ns;
    sample.sent_clock_error_ns = write.wall_error_ns;
    std::copy(write.boot_id.begin(), write.boot_id.end(), sample.boot_id);
  }

  // deliver(sample) is called when it arrives: at once, or in arrive().
  template <class Sample, class Deliver> void send(const Sample &sample, std::int64_t utc_ns, const Deliver &deliver) {
    const std::int64_t arrival_ns = std::max(utc_ns + delay_ns(utc_ns), latest_ns_);
    latest_ns_ = arrival_ns;
    if (arrival_ns <= utc_ns) {
      deliver(sample);
    } else {
      on_the_way_.emplace_back(arrival_ns, [sample, deliver] { deliver(sample); });
    }
  }

  void arrive(std::int64_t utc_ns) {
    while (!on_the_way_.empty() && on_the_way_.front().first <= utc_ns) {
      on_the_way_.front().second();
      on_the_way_.pop_front();
    }
  }
  [[nodiscard]] std::int64_t next_arrival_ns() const {
    return on_the_way_.empty() ? std::numeric_limits<std::int64_t>::max() : on_the_way_.front().first;
  }

  // CLOCK_BOOTTIME of the daemon's host at the start: 0 means "not stated" on the wire.
  static constexpr std::int64_t kBootAtStart_ns = 1'000'000'000;

private:
  std::int64_t start_utc_ns_;
  std::int64_t latest_ns_ = 0; // arrival of the last sample
  std::deque<std::pair<std::int64_t, std::function<void()>>> on_the_way_;
};

} // namespace bregma::test
