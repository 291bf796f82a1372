// Converts times of a device's clock to the host's UTC.
//
// A sample arrives at  host = device + offset + drift * device + latency,  with latency >= the path's minimum. The line
// that supports the points (device, host - device) from below is therefore the clocks' relation plus the minimum
// latency [Moon 1999]. Its linear programme is solved on the lowest point of each block of time, which bounds work and
// memory. The minimum latency is not observable. It is a parameter of the device and is subtracted.
//
// A permanent rise of the latency cannot be distinguished from a clock that was set back. The age is then overstated
// for the length of the window, never understated. With hold_ppm the line keeps its lowest point instead of the
// window's and rises at that rate only: a rise of the latency that is faster stays visible for as long as it can be
// told from drift.
//
// Threads: one. No allocation, no exceptions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace bregma::base {

struct DeviceClockOptions {
  std::int64_t minimum_latency_ns = 0;              // minimum from exposure to arrival, from the device's data sheet
  std::int64_t block_ns = 500'000'000;              // one lowest point is kept per block
  double max_drift_ppm = 300.0;                     // crystal oscillators are within 100
  double hold_ppm = 0.0;                            // above 0: the line rises at this rate from its lowest point
  std::int64_t future_tolerance_ns = 10'000'000;    // a sample that is earlier than the line by more is rejected
  std::int64_t settling_ns = 1'000'000'000;         // after a start, because the first samples may be delayed
  std::int64_t settling_tolerance_ns = 500'000'000; // future tolerance during that time
  std::int64_t resync_ns = 200'000'000;   // a new time base is accepted after samples have agreed for this time
  int resync_samples = 8;                 // and after at least this number of samples
  std::int64_t agreement_ns = 20'000'000; // maximal difference of agreeing offsets
};

enum class TimeVerdict {
  kInStep,
  kResynced,  // consistent with a new time base: the device's clock was set
  kBackwards, // not after the last accepted sample
  kTooSoon,   // less than half a period after it: a higher rate than the device states
  kInFuture   // time of exposure after arrival
};

class DeviceClock {
public:
  explicit DeviceClock(const DeviceClockOptions &options = {}) : options_(options) {}

  // For a restarted device. Clears everything except the count of resyncs.
  void reset() noexcept;

  // Checks a sample. A consistent sample updates the estimate. period_ns 0: the times have no rate and may be equal.
  TimeVerdict observe(std::int64_t device_time_ns, std::int64_t arrival_ns, std::int64_t period_ns) noexcept;

  // Time of exposure on the host's clock. Precondition: observe() was called.
  [[nodiscard]] std::int64_t to_host_ns(std::int64_t device_time_ns) const noexcept;
  [[nodiscard]] bool is_synchronised() const noexcept { return block_count_ > 0; }
  // True if observe() would find the sample in step, and not later than the latest ones by more than the agreement.
  [[nodiscard]] bool continues(std::int64_t device_time_ns, std::int64_t arrival_ns) const noexcept;
  [[nodiscard]] double drift_ppm() const noexcept { return drift_ * 1e6; }
  [[nodiscard]] std::uint64_t resyncs() const noexcept { return resyncs_; }

private:
  struct Point {
    std::int64_t device_ns;
    std::int64_t offset_ns; // host - device
  };
  static constexpr std::size_t kBlocks = 32; // 16 s, at 0.5 s per block

  [[nodiscard]] std::int64_t predicted_offset_ns(std::int64_t device_time_ns) const noexcept;
  [[nodiscard]] bool is_candidate_accepted(const Point &point, std::int64_t period_ns) noexcept;
  void start(const Point &point) noexcept;
  void learn(const Point &point) noexcept;
  void fit() noexcept;

  DeviceClockOptions options_;
  std::array<Point, kBlocks> blocks_{}; // lowest point of each block, oldest first
  std::size_t block_count_ = 0;
  std::int64_t block_began_ns_ = 0; // device time
  std::int64_t started_ns_ = 0;     // device time
  std::int64_t last_ns_ = 0;        // device time of the last accepted sample
  std::int64_t arrived_ns_ = 0;     // host time of its arrival
  std::int64_t pressed_ns_ = 0;     // recent lowering of the line by early samples
  Point anchor_{};                  // a point on the line
  double drift_ = 0.0;              // d(host - device)/d(device)
  std::uint64_t resyncs_ = 0;

  // A run of rejected samples that agree on another time base.
  int candidate_count_ = 0;
  Point candidate_first_{};
  Point candidate_lowest_{};
  std::int64_t candidate_last_ns_ = 0; // device time
};

} // namespace bregma::base
