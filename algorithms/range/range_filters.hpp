// Streaming filters for a range sensor's readings, whose delay is known and removed from the times.
//
// The sensor delivers readings at the rate of its line, some of them missing (NaN). A window filter gives one value per
// reading once its window is full: the mean, the mean without what lies more than some sigmas off, the median, or
// Hampel's: the mean of what lies within some robust sigmas of the median [Hampel 1974]. Its value belongs to the mean
// time of the readings that it used, which is also the time that it states: a filter that averages 100 readings of 1 ms
// lags by 49.5 ms, and its times lie that much in the past. sensor_delay_ns is taken off in addition: the age of a
// value that the sensor holds (for a sensor that integrates for one period and holds for one, one period).
//
// No allocation after construction. One thread at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "algorithms/range/power_law.hpp"

namespace bregma::range {

struct TimedReading {
  std::int64_t time_ns = 0;
  double value = 0.0; // in any unit; NaN: missing
};

enum class WindowKind : std::uint8_t { kMean, kRejectingMean, kMedian, kHampel };

struct WindowOptions {
  WindowKind kind = WindowKind::kHampel;
  std::size_t window = 100;         // readings, missing ones included
  double reject_sigmas = 3.0;       // of kRejectingMean (standard deviations) and kHampel (robust sigmas)
  std::int64_t sensor_delay_ns = 0; // age of the sensor's value when it is read
};

struct FilteredReading {
  std::int64_t time_ns = 0;  // at which the value held
  std::int64_t delay_ns = 0; // from there to the newest reading
  double value = 0.0;
  std::size_t used = 0; // readings
};

class WindowFilter {
public:
  // Throws std::invalid_argument for a window of zero readings, or sigmas that are not positive.
  explicit WindowFilter(const WindowOptions &options);
  // Takes a reading without computing a value.
  void add(const TimedReading &reading);
  // The value of the last `window` readings. nullopt: the window is not full yet, or all of its readings are missing.
  [[nodiscard]] std::optional<FilteredReading> value();
  [[nodiscard]] std::optional<FilteredReading> push(const TimedReading &reading) {
    add(reading);
    return value();
  }
  void reset();

private:
  // Which of the present readings count, by their values: from low to high, inclusive.
  struct Bounds {
    double low, high;
  };
  [[nodiscard]] Bounds bounds();

  WindowOptions options_;
  std::vector<TimedReading> ring_;
  std::size_t next_ = 0, count_ = 0;
  std::vector<double> scratch_;
};

// The chain of [NeuroGuide]: a moving average of the raw readings that leaves out what lies more than one standard
// deviation off, the power law, a moving average of three, and every n-th value. The document's "modulo of 1000" is
// read as n: at 1 ms per reading and 1 mm/s that gives the 1,000 points that it states for its scan.
struct ChainOptions {
  WindowOptions raw{WindowKind::kRejectingMean, 100, 1.0, 0};
  std::size_t smoothing = 3;
  std::size_t every = 1000;
};
// A chain with the same output rate that is more exact. A spike lasts for a whole period of the sensor (38 ms), so the
// window holds five of them.
[[nodiscard]] inline ChainOptions robust_chain() { return {{WindowKind::kHampel, 200, 3.0, 0}, 1, 1000}; }

class RangeChain {
public:
  RangeChain(const ChainOptions &options, RangeCurve calibration);
  // A distance in mm, with the time at which it held; nullopt for all readings but every n-th, and while a window
  // fills. The first filter computes only those values that the second one needs.
  [[nodiscard]] std::optional<FilteredReading> push(const TimedReading &reading);

private:
  ChainOptions options_;
  RangeCurve calibration_;
  WindowFilter raw_;
  WindowFilter smooth_;
  std::size_t index_ = 0;
};

} // namespace bregma::range
