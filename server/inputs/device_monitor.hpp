// One device as the daemon sees it: is each sample to be believed, is the device there, and in figures how well it
// does.
//
// Every sample is accounted for: received = taken + sum of rejected; what never arrived is in `lost`, by its number.
//
// One device has one writer at a time. Another writer takes over when the present one has been silent for three periods
// (a restarted driver), which counts as a connection; before that its samples are refused as duplicates, so that two
// drivers of the same name cannot alternate.
//
// Threads: one. No allocation, no exceptions; time is passed in.
#pragma once

#include <cstdint>

#include "base/device_clock.hpp"
#include "idl/topics.hpp"
#include "server/inputs/frame_counter.hpp"
#include "server/inputs/payload_check.hpp"
#include "server/runtime/histogram.hpp"

namespace bregma::inputs {

struct DeviceOptions {
  base::DeviceClockOptions clock;
  std::int64_t deadline_ns = 0;                 // silent for longer: lost. 0: the deadline of the stream's topic
  std::int64_t sent_tolerance_ns = 100'000'000; // the driver's host clock may be ahead of ours by so much
};

// The fields that all streams share.
struct SampleHeader {
  std::uint64_t frame;
  std::int64_t device_time_ns;
  std::int64_t sent_time_ns;
  std::int64_t period_ns;
};

struct Verdict {
  bool accepted = false;
  wire::RejectReason reason = bregma_wire_REJECT_MALFORMED; // when not accepted
  std::int64_t acquired_time_ns = 0;                        // when accepted: exposure on the host's clock
  int device = -1;                                          // index in the stream's list; -1: unknown
  bool reconnected = false; // the first sample of a new connection; false for the very first
};

class DeviceMonitor {
public:
  DeviceMonitor(const wire::Name &name, wire::DeviceKind kind, const DeviceOptions &options) noexcept;

  // payload: what check_payload said. writer: SampleInfo::writer. now_ns: the host's clock at arrival.
  [[nodiscard]] Verdict check(const SampleHeader &header, const Rejection &payload, std::uint64_t writer,
                              std::int64_t now_ns) noexcept;

  // The stream has no writer any more: lost at once, without waiting for the deadline.
  void writers_gone() noexcept { writers_gone_ = true; }

  // stale: the latest exposure is more than three periods ago, the stated minimum latency aside.
  [[nodiscard]] wire::DeviceStatus status(std::int64_t now_ns) const noexcept;
  [[nodiscard]] std::int64_t acquired_time_ns() const noexcept { return acquired_ns_; } // of the latest accepted
  [[nodiscard]] std::int64_t period_ns() const noexcept { return period_ns_; }          // as the device states it
  [[nodiscard]] std::uint64_t received() const noexcept { return received_; }
  [[nodiscard]] std::uint64_t resyncs() const noexcept { return clock_.resyncs(); }
  [[nodiscard]] const wire::Name &name() const noexcept { return health_.device; }

  // Percentiles are over all samples so far. Costs some µs: for a slow rate, not for every sample.
  [[nodiscard]] wire::DeviceHealth health(std::int64_t now_ns) const noexcept;

private:
  [[nodiscard]] Rejection judge(const SampleHeader &header, const Rejection &payload, std::uint64_t writer,
                                std::int64_t now_ns) noexcept;
  void count_rate(std::int64_t now_ns) noexcept;

  DeviceOptions options_;
  wire::DeviceHealth health_{}; // the counts live here
  base::DeviceClock clock_;
  FrameCounter frames_;
  runtime::Histogram latency_;
  bool writers_gone_ = false;
  std::uint64_t received_ = 0;
  std::uint64_t writer_ = 0;
  std::int64_t period_ns_ = 0;
  std::int64_t device_time_ns_ = 0; // of the latest accepted, like the next two
  std::int64_t acquired_ns_ = 0;
  std::int64_t arrived_ns_ = 0;
  std::int64_t window_began_ns_ = 0; // of the rate
  std::uint64_t window_count_ = 0;
  double rate_hz_ = 0.0;
};

} // namespace bregma::inputs
