// From a device's own clock to the host's UTC.
//
// A sample arrives at  host = device + offset + drift * device + latency,  latency >= the path's minimum. Latency only
// ever adds, so the line that supports the points (device, host - device) from below is the clocks' relation plus the
// minimum latency [Moon 1999]. Its linear programme is solved here on the lowest point of each block of time, so that
// work and memory are bounded. The minimum itself cannot be observed: it is a parameter of the device, and subtracted.
//
// A latency that rises and stays is not told from a clock that was set back: the age is then overstated for the length
// of the window, never understated.
//
// Threads: one. No allocation, no exceptions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace bregma::base {

struct DeviceClockOptions {
  std::int64_t minimum_latency_ns = 0;           // exposure to arrival at best, from the device's data sheet
  std::int64_t block_ns = 500'000'000;           // one lowest point is kept a block
  double max_drift_ppm = 300.0;                  // crystals are within 100
  std::int64_t future_tolerance_ns = 10'000'000; // an arrival earlier than the line by more is not believed
  std::int64_t settling_ns = 1'000'000'000; // so long after a start the first samples may have been held up, and the
  std::int64_t settling_tolerance_ns = 500'000'000; // tolerance is this
  std::int64_t resync_ns = 200'000'000;   // a new time base is taken when samples have agreed on it for so long
  int resync_samples = 8;                 // and at least so many
  std::int64_t agreement_ns = 20'000'000; // agreeing: offsets within this of each other
};

enum class TimeVerdict {
  kInStep,
  kResynced,  // in step with a new time base: the device's clock was set
  kBackwards, // not after the last accepted sample
  kTooSoon,   // less than half a period after it: more samples than the device says that it makes
  kInFuture   // exposed after it arrived
};

class DeviceClock {
public:
  explicit DeviceClock(const DeviceClockOptions &options = {}) : options_(options) {}

  // Forgets everything but the count of resyncs: the device was restarted.
  void reset() noexcept;

  // Judges a sample and, when it is in step, learns from it.
  TimeVerdict observe(std::int64_t device_time_ns, std::int64_t arrival_ns, std::int64_t period_ns) noexcept;

  // Of the time of exposure on the host's clock. Only after a first observe().
  [[nodiscard]] std::int64_t to_host_ns(std::int64_t device_time_ns) const noexcept;
  [[nodiscard]] bool is_synchronised() const noexcept { return block_count_ > 0; }
  [[nodiscard]] double drift_ppm() const noexcept { return drift_ * 1e6; }
  [[nodiscard]] std::uint64_t resyncs() const noexcept { return resyncs_; }

private:
  struct Point {
    std::int64_t device_ns;
    std::int64_t offset_ns; // host - device
  };
  static constexpr std::size_t kBlocks = 32; // 16 s at half a second each

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
  std::int64_t arrived_ns_ = 0;     // host time of the same
  std::int64_t pressed_ns_ = 0;     // how far early samples have lowered the line of late
  Point anchor_{};                  // on the line
  double drift_ = 0.0;              // d(host - device)/d(device)
  std::uint64_t resyncs_ = 0;

  // A run of refused samples that agree with each other on another time base.
  int candidate_count_ = 0;
  Point candidate_first_{};
  Point candidate_lowest_{};
  std::int64_t candidate_last_ns_ = 0; // device time
};

} // namespace bregma::base
