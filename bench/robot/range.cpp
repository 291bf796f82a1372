// The simulated infrared sensor: calibration by a power law, error and delay of the filters over windows of 1 to 400
// readings, and the chain of [NeuroGuide] beside a robust one.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "algorithms/range/range_filters.hpp"
#include "base/plots.hpp"
#include "base/write_file.hpp"
#include "bench/robot/face_scan.hpp"
#include "bench/robot/robot_parts.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"

namespace bregma::bench {

namespace {

using range::FilteredReading;
using range::TimedReading;
using range::WindowKind;

constexpr std::int64_t kReading_ns = 1'000'000; // one reading per ms
constexpr double kSpeed_mm_s = 5.0;             // the faster scan of [NeuroGuide]
constexpr std::array<std::size_t, 12> kWindows{1, 2, 5, 10, 20, 50, 75, 100, 150, 200, 300, 400};

// Distance while the beam stands still, or passes over a face-like relief at kSpeed_mm_s.
double true_distance_mm(std::int64_t time_ns, bool moving) {
  const double x_mm = moving ? 1e-9 * static_cast<double>(time_ns) * kSpeed_mm_s : 0.0;
  return 170.0 + 12.0 * std::sin(2.0 * std::numbers::pi * x_mm / 60.0) +
         3.0 * std::sin(2.0 * std::numbers::pi * x_mm / 17.0);
}

sim::SharpSensor sensor_over(bool moving, std::uint64_t seed) {
  return {{},
          [moving](std::int64_t t) {
            return sim::BeamTarget{true_distance_mm(t, moving), 0.0, std::nan("")};
          },
          seed};
}

std::vector<TimedReading> record(bool moving, double seconds, std::uint64_t seed) {
  sim::SharpSensor sensor = sensor_over(moving, seed);
  std::vector<TimedReading> out;
  const auto count = static_cast<std::int64_t>(1000.0 * seconds);
  for (std::int64_t i = 0; i < count; ++i) {
    // Every 50th reading is missing, as on a serial line that is polled.
    const double volts = sensor.read_volts(i * kReading_ns, moving);
    out.push_back({i * kReading_ns, i % 50 == 17 ? std::nan("") : volts});
  }
  return out;
}

range::PowerLaw calibrate(Report &report) {
  std::vector<range::CalibrationPoint> whole = calibration_readings(100.0, 295.0, 5.0, kRobotSeed);
  for (const range::CalibrationPoint &point : calibration_readings(300.0, 800.0, 25.0, kRobotSeed)) {
    whole.push_back(point);
  }
  std::vector<range::CalibrationPoint> near;
  std::copy_if(whole.begin(), whole.end(), std::back_inserter(near),
               [](const auto &point) { return point.distance_mm >= 120.0 && point.distance_mm <= 250.0; });
  const auto all = range::fit_power_law(whole);
  const auto fit = range::fit_power_law(near);
  report.note("power law over 100 to 800 mm: " + all.text);
  report.note("power law over 120 to 250 mm: " + fit.text);
  report.add(figure("robot.range.power_law.whole.rms", all.rms_mm, "mm"));
  report.add(figure("robot.range.power_law.whole.misfits", static_cast<double>(all.misfits.size()), "of 8 stretches"));
  report.add(figure("robot.range.power_law.near.rms", fit.rms_mm, "mm"));
  return fit.law;
}

struct FilterError {
  double rms_mm = 0.0;        // at the times that the filter states
  double rms_newest_mm = 0.0; // taken as the distance of the newest reading
  double stated_delay_ms = 0.0;
  double measured_delay_ms = 0.0; // shift of the truth that fits best
};

double rms_at(const std::vector<FilteredReading> &values, bool moving, std::int64_t shift_ns) {
  double squares = 0.0;
  for (const FilteredReading &v : values) {
    squares += std::pow(v.value - true_distance_mm(v.time_ns + v.delay_ns - shift_ns, moving), 2);
  }
  return std::sqrt(squares / static_cast<double>(values.size()));
}

FilterError error_of(const std::vector<FilteredReading> &values, bool moving) {
  FilterError out;
  double squares = 0.0;
  for (const FilteredReading &v : values) {
    squares += std::pow(v.value - true_distance_mm(v.time_ns, moving), 2);
    out.stated_delay_ms += 1e-6 * static_cast<double>(v.delay_ns) / static_cast<double>(values.size());
  }
  out.rms_mm = std::sqrt(squares / static_cast<double>(values.size()));
  out.rms_newest_mm = rms_at(values, moving, 0);
  if (moving) {
    double best = std::numeric_limits<double>::infinity();
    for (std::int64_t shift = 0; shift < 400 * kReading_ns; shift += 2 * kReading_ns) {
      if (const double rms = rms_at(values, moving, shift); rms < best) {
        best = rms;
        out.measured_delay_ms = 1e-6 * static_cast<double>(shift);
      }
    }
  }
  return out;
}

std::vector<FilteredReading> filtered(const std::vector<TimedReading> &readings, const range::WindowOptions &options,
                                      const range::PowerLaw &law) {
  range::WindowFilter filter(options);
  std::vector<FilteredReading> out;
  for (const TimedReading &r : readings) {
    if (auto value = filter.push(r)) {
      value->value = law.distance_mm(value->value);
      out.push_back(*value);
    }
  }
  return out;
}

struct Kind {
  const char *name;
  WindowKind kind;
  double sigmas;
  const char *colour;
};
constexpr std::array<Kind, 4> kKinds{{{"mean", WindowKind::kMean, 1.0, base::colour::kGrey},
                                      {"rejecting", WindowKind::kRejectingMean, 1.0, base::colour::kOrange},
                                      {"median", WindowKind::kMedian, 1.0, base::colour::kGreen},
                                      {"hampel", WindowKind::kHampel, 3.0, base::colour::kBlue}}};

void window_figures(Report &report, const RobotBenchOptions &options, const range::PowerLaw &law) {
  const double seconds = options.quick ? 30.0 : 120.0;
  report.note(
      "filters: readings every ms, RMS error in mm at the stated time (standing | moving at 5 mm/s), then taken "
      "as of the newest reading, then delay stated and measured, ms");
  base::Plot plot;
  plot.title = "RMS error of range filters over their window";
  plot.x = {"window, readings of 1 ms", true, 1.0, 400.0};
  plot.y = {"RMS error, mm", false, 0.0, std::nullopt};
  const auto standing = record(false, seconds, kRobotSeed);
  const auto moving = record(true, seconds, kRobotSeed);
  for (const Kind &kind : kKinds) {
    base::Series still{std::string(kind.name) + ", standing", kind.colour, base::Mark::kLine, {}, 1.5, true, 1.0};
    base::Series moves{std::string(kind.name) + ", moving", kind.colour, base::Mark::kLine, {}, 2.0, false, 1.0};
    for (const std::size_t window : kWindows) {
      const range::WindowOptions filter{kind.kind, window, kind.sigmas, kSensorDelay_ns};
      const FilterError s = error_of(filtered(standing, filter, law), false);
      const FilterError m = error_of(filtered(moving, filter, law), true);
      still.points.push_back({static_cast<double>(window), s.rms_mm});
      moves.points.push_back({static_cast<double>(window), m.rms_mm});
      std::array<char, 160> line{};
      std::snprintf(line.data(), line.size(), "%-9s %3zu | %5.2f | %5.2f | %5.2f | %5.1f %5.1f", kind.name, window,
                    s.rms_mm, m.rms_mm, m.rms_newest_mm, m.stated_delay_ms, m.measured_delay_ms);
      report.note(line.data());
      if (window == 100) {
        const std::string name = std::string("robot.range.") + kind.name + ".window100.";
        report.add(figure(name + "standing.rms", s.rms_mm, "mm"));
        report.add(figure(name + "moving.rms", m.rms_mm, "mm"));
        report.add(figure(name + "moving.rms_without_compensation", m.rms_newest_mm, "mm"));
        report.add(figure(name + "delay.stated", m.stated_delay_ms, "ms"));
        report.add(at_most(name + "delay.measured_minus_stated", std::abs(m.measured_delay_ms - m.stated_delay_ms),
                           "ms", 15.0));
      }
    }
    plot.series.push_back(std::move(moves));
    plot.series.push_back(std::move(still));
  }
  if (!options.pictures.empty()) {
    const auto file = std::filesystem::path(options.pictures) / "range_filters.svg";
    if (auto written = base::write_file(file, base::plot_svg(plot, {900, 380})); !written) {
      throw std::runtime_error(written.error().message);
    }
  }
}

void chain_figures(Report &report, const RobotBenchOptions &options, const range::PowerLaw &law) {
  const auto readings = record(true, options.quick ? 60.0 : 600.0, kRobotSeed + 1);
  range::ChainOptions seed;
  range::ChainOptions robust = range::robust_chain();
  // Every 20th reading instead of every 1000th, for enough values.
  seed.every = robust.every = 20;
  seed.raw.sensor_delay_ns = robust.raw.sensor_delay_ns = kSensorDelay_ns;
  const auto run = [&](const range::ChainOptions &chain_options) {
    range::RangeChain chain(chain_options, {law, {}});
    std::vector<FilteredReading> out;
    for (const TimedReading &r : readings) {
      if (const auto value = chain.push(r)) {
        out.push_back(*value);
      }
    }
    return error_of(out, true);
  };
  const FilterError of_seed = run(seed);
  const FilterError of_robust = run(robust);
  report.add(figure("robot.range.chain.seed.rms", of_seed.rms_mm, "mm"));
  report.add(figure("robot.range.chain.seed.rms_without_compensation", of_seed.rms_newest_mm, "mm"));
  report.add(figure("robot.range.chain.seed.delay", of_seed.stated_delay_ms, "ms"));
  report.add(at_most("robot.range.chain.robust.rms", of_robust.rms_mm, "mm", of_seed.rms_mm));
  report.add(figure("robot.range.chain.robust.delay", of_robust.stated_delay_ms, "ms"));
}

} // namespace

void range_figures(Report &report, const RobotBenchOptions &options) {
  const range::PowerLaw law = calibrate(report);
  window_figures(report, options, law);
  chain_figures(report, options, law);
}

} // namespace bregma::bench
