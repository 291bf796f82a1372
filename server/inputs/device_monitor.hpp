// Monitors one device: accepts or rejects each sample, detects loss of the device and computes its health figures.
//
// Every sample is counted: received = taken + sum of rejected. `lost` counts the frame numbers that never arrived, also
// those of a link that was down: a returning writer whose numbers go on is the same device.
//
// One device has one writer at a time: the first, until the device is lost. Then another writer takes over (a restarted
// driver), which counts as a connection. Before that its samples are rejected as duplicates and counted as those of
// another writer, so that two drivers of the same name never alternate.
//
// The time of exposure has two parts: from the device's clock to the driver's write, by the lower envelope of write
// minus exposure (base/device_clock.hpp), and the transit from the write to here (driver_transit.hpp). A delay before
// the driver's write that lasts cannot be seen.
//
// Threads: one. No allocation, no exceptions. The caller passes the time.
#pragma once

#include <cstdint>

#include "base/device_clock.hpp"
#include "idl/topics.hpp"
#include "idl/validity.hpp"
#include "server/inputs/driver_transit.hpp"
#include "server/inputs/frame_counter.hpp"
#include "server/inputs/payload_check.hpp"
#include "server/inputs/stated_period.hpp"
#include "server/runtime/histogram.hpp"

namespace bregma::inputs {

struct DeviceOptions {
  base::DeviceClockOptions clock;
  double live_limit_ms = wire::kLiveLimit_ms;
  std::int64_t deadline_ns = 0; // a longer silence means lost; 0: the deadline of the stream's topic
};

// The fields common to all streams.
struct SampleHeader {
  std::uint64_t frame;
  std::int64_t device_time_ns;
  std::int64_t period_ns;
  wire::WriteTime write;
};

struct Verdict {
  bool accepted = false;
  wire::RejectReason reason = bregma_wire_REJECT_MALFORMED; // valid if not accepted
  // The next four are valid if accepted.
  std::int64_t written_time_ns = 0;  // the driver's write, on the host's clock
  std::int64_t acquired_time_ns = 0; // exposure on the host's clock
  std::int64_t age_sigma_ns = 0;     // 1-sigma uncertainty of that time, and so of every age derived from it
  std::int64_t period_ns = 0;        // as stated, or shorter where the measured rate contradicts it
  int device = -1;                   // index in the stream's list; -1: unknown
  bool reconnected = false;          // the first sample of a new connection; false for the very first
};

class DeviceMonitor {
public:
  DeviceMonitor(const wire::Name &name, wire::DeviceKind kind, const DeviceOptions &options) noexcept;

  // payload: result of check_payload. writer: SampleInfo::writer. now_ns: arrival, steady UTC.
  [[nodiscard]] Verdict check(const SampleHeader &header, const Rejection &payload, std::uint64_t writer,
                              std::int64_t now_ns, const HostClock &host) noexcept;

  // The stream has no writer any more: the device is lost at once, without waiting for the deadline.
  void writers_gone() noexcept { writers_gone_ = true; }

  // stale: the latest exposure is older than the limit of a live pose (idl/validity.hpp). lost: no sample until the
  // deadline, which is never before that.
  [[nodiscard]] wire::DeviceStatus status(std::int64_t now_ns) const noexcept;
  // Time of exposure of the latest accepted sample.
  [[nodiscard]] std::int64_t acquired_time_ns() const noexcept { return acquired_ns_; }
  [[nodiscard]] std::int64_t period_ns() const noexcept { return period_ns_; } // see Verdict
  [[nodiscard]] std::uint64_t received() const noexcept { return received_; }
  [[nodiscard]] std::uint64_t resyncs() const noexcept { return clock_.resyncs(); }
  [[nodiscard]] const wire::Name &name() const noexcept { return health_.device; }

  // Percentiles cover all samples so far. Takes a few µs: call it at a low rate, not for every sample.
  [[nodiscard]] wire::DeviceHealth health(std::int64_t now_ns) const noexcept;

private:
  [[nodiscard]] Rejection judge(const SampleHeader &header, const Rejection &payload, std::uint64_t writer,
                                std::int64_t now_ns, const HostClock &host) noexcept;
  [[nodiscard]] std::int64_t elapsed_ns(const SampleHeader &header, std::int64_t now_ns) const noexcept;
  void take_over(const SampleHeader &header, std::int64_t now_ns) noexcept;
  void count_rate(std::int64_t now_ns) noexcept;
  [[nodiscard]] bool is_other_writer(std::uint64_t writer, std::int64_t now_ns) noexcept;
  void count_other_writer(std::uint64_t writer) noexcept;

  DeviceOptions options_;
  wire::DeviceHealth health_{}; // contains the counts, and what is known of the latest accepted sample
  base::DeviceClock clock_;     // the device's against the driver's
  DriverTransit driver_transit_;
  Transit transit_; // of the latest judged sample
  FrameCounter frames_;
  StatedPeriod stated_period_;
  runtime::Histogram latency_;
  bool writers_gone_ = false;
  std::uint64_t received_ = 0;
  std::uint64_t writer_ = 0;
  std::uint64_t other_writer_ = 0;  // sent last while writer_ was in use
  std::uint64_t other_waiting_ = 0; // its samples since the last one of writer_
  bool other_confirmed_ = false;    // writer_ has sent after it: they are two, not one that was restarted
  std::int64_t period_ns_ = 0;
  std::int64_t stated_period_ns_ = 0;
  std::int64_t device_time_ns_ = 0; // latest accepted sample, like the next three
  std::int64_t acquired_ns_ = 0;
  std::int64_t arrived_ns_ = 0;
  std::int64_t written_ns_ = 0;      // the driver's clock
  std::int64_t window_began_ns_ = 0; // start of the rate's window
  std::uint64_t window_count_ = 0;
  double rate_hz_ = 0.0;
};

} // namespace bregma::inputs
