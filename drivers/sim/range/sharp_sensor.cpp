#include "drivers/sim/range/sharp_sensor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bregma::sim {

namespace {

// Typical output over distance, read off the data sheet's diagram.
struct CurvePoint {
  double mm, volts;
};
constexpr std::array<CurvePoint, 17> kCurve{{{0.0, 0.2},
                                             {30.0, 1.9},
                                             {50.0, 2.9},
                                             {65.0, 3.13},
                                             {80.0, 2.74},
                                             {100.0, 2.32},
                                             {120.0, 1.98},
                                             {150.0, 1.64},
                                             {200.0, 1.31},
                                             {250.0, 1.08},
                                             {300.0, 0.92},
                                             {400.0, 0.74},
                                             {500.0, 0.61},
                                             {600.0, 0.52},
                                             {700.0, 0.45},
                                             {800.0, 0.41},
                                             {1500.0, 0.20}}};
constexpr std::int64_t kSamplesPerPeriod = 8;
constexpr double kNs = 1e6; // per ms

double secant(std::size_t i) { return (kCurve[i + 1].volts - kCurve[i].volts) / (kCurve[i + 1].mm - kCurve[i].mm); }

// Slopes that keep the cubic monotone: the harmonic mean of both sides, zero at a turn.
double slope(std::size_t i) {
  if (i == 0 || i + 1 == kCurve.size()) {
    return i == 0 ? secant(0) : secant(i - 1);
  }
  const double left = secant(i - 1);
  const double right = secant(i);
  return left * right > 0.0 ? 2.0 * left * right / (left + right) : 0.0;
}

} // namespace

double sharp_volts(double distance_mm) {
  if (!(distance_mm >= 0.0) || distance_mm >= kCurve.back().mm) {
    return 0.0;
  }
  std::size_t i = 0;
  while (distance_mm >= kCurve[i + 1].mm) {
    ++i;
  }
  const double width = kCurve[i + 1].mm - kCurve[i].mm;
  const double t = (distance_mm - kCurve[i].mm) / width;
  const double a = kCurve[i].volts;
  const double b = kCurve[i + 1].volts;
  const double t2 = t * t;
  const double t3 = t2 * t;
  return a * (2.0 * t3 - 3.0 * t2 + 1.0) + b * (3.0 * t2 - 2.0 * t3) +
         width * (slope(i) * (t3 - 2.0 * t2 + t) + slope(i + 1) * (t3 - t2));
}

SharpSensor::SharpSensor(const SharpOptions &options, BeamTargetAt target, std::uint64_t seed)
    : options_(options), target_(std::move(target)), random_(seed, "range sensor") {}

double SharpSensor::measure(std::int64_t from_ns, std::int64_t to_ns) {
  double volts = 0.0;
  for (std::int64_t i = 0; i < kSamplesPerPeriod; ++i) {
    const std::int64_t at = from_ns + (2 * i + 1) * (to_ns - from_ns) / (2 * kSamplesPerPeriod);
    const BeamTarget target = target_(at);
    const double uneven = 1.0 + options_.tilt_uneven * std::cos(target.azimuth_rad);
    const double biased = target.distance_mm + options_.tilt_bias_mm * uneven * std::pow(std::sin(target.tilt_rad), 2);
    double seen = sharp_volts(biased);
    if (std::isfinite(target.other_mm)) {
      seen += options_.edge_weight * (sharp_volts(target.other_mm) - seen);
    }
    volts += seen / static_cast<double>(kSamplesPerPeriod);
  }
  volts += 1e-3 * random_.normal(options_.noise_mV);
  if (random_.uniform(0.0, 1.0) < options_.spike_probability) {
    volts += 1e-3 * random_.uniform(-options_.spike_mV, options_.spike_mV);
  }
  return volts;
}

double SharpSensor::read_volts(std::int64_t time_ns, bool moving) {
  const auto next_period = [this] {
    return std::llround(kNs *
                        (options_.period_ms + random_.uniform(-options_.period_spread_ms, options_.period_spread_ms)));
  };
  if (!started_) {
    started_ = true;
    period_from_ns_ = time_ns - next_period();
    period_to_ns_ = time_ns;
  }
  while (time_ns >= period_to_ns_) {
    held_volts_ = measure(period_from_ns_, period_to_ns_);
    period_from_ns_ = period_to_ns_;
    period_to_ns_ += next_period();
  }
  const double noise_mV = options_.line_noise_mV + (moving ? options_.moving_noise_mV : 0.0);
  const double volts = held_volts_ + 1e-3 * random_.normal(noise_mV);
  const double step = 1e-3 * options_.step_mV;
  return std::max(0.0, step * std::round(volts / step));
}

} // namespace bregma::sim
