// State and counts of a driver, written by the loop and read by the reporting thread.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "algorithms/geometry/unknown.hpp"
#include "idl/topics.hpp"

namespace bregma::driver {

enum class State : wire::DriverState {
  kConnecting = bregma_wire_DRIVER_CONNECTING,
  kConnected = bregma_wire_DRIVER_CONNECTED,
  kWaiting = bregma_wire_DRIVER_WAITING, // before the next attempt
  kStopped = bregma_wire_DRIVER_STOPPED
};

struct StatusValues {
  State state = State::kConnecting;
  std::uint64_t connections = 0; // number of connections made
  std::uint64_t failures = 0;    // failed attempts and lost connections
  std::uint64_t published = 0;
  std::uint64_t refused = 0;                   // samples that DDS refused
  std::uint64_t out_of_step = 0;               // samples whose device time contradicts the device's clock
  std::uint64_t skipped = 0;                   // parts of the input that the protocol could not read
  std::string skip_reason;                     // reason of the latest skip
  std::string failure;                         // the latest failure; empty if there was none
  double clock_offset_ms = geometry::kUnknown; // host minus device
  double clock_drift_ppm = geometry::kUnknown;
  std::uint64_t clock_resyncs = 0; // how often the device's clock was set
  std::int64_t last_sample_ns = 0;
  std::int64_t last_return_ns = 0; // when the device last returned to the frame
};

// Threads: any. The lock is held only for a copy.
class Status {
public:
  template <class Change> void update(Change &&change) {
    const std::lock_guard lock(mutex_);
    change(values_);
  }
  [[nodiscard]] StatusValues values() const {
    const std::lock_guard lock(mutex_);
    return values_;
  }

private:
  mutable std::mutex mutex_;
  StatusValues values_;
};

// Log line about samples dropped between two readings; empty if there were none.
[[nodiscard]] std::optional<std::string> dropped_text(const StatusValues &before, const StatusValues &now);

// For the topic DriverHealth.
[[nodiscard]] wire::DriverHealth to_wire(const StatusValues &values, const std::string &device, std::int64_t now_ns,
                                         std::int64_t started_ns);

} // namespace bregma::driver
