// Filters and calibration of a range sensor, on synthetic readings and on the simulated sensor.
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "algorithms/range/range_filters.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"

namespace bregma::range {
namespace {

constexpr std::int64_t kMs = 1'000'000;
const double kMissing = std::nan("");

TEST(WindowFilter, StatesTheTimeAtWhichItsValueHeld) {
  // A ramp: whatever the filter, its value is the ramp's at the time that it states.
  for (const WindowKind kind : {WindowKind::kMean, WindowKind::kMedian, WindowKind::kHampel}) {
    WindowFilter filter({kind, 100, 3.0, 0});
    std::optional<FilteredReading> value;
    for (int i = 0; i < 250; ++i) {
      value = filter.push({i * kMs, 0.5 * i});
      EXPECT_EQ(value.has_value(), i >= 99);
    }
    ASSERT_TRUE(value);
    EXPECT_EQ(value->delay_ns, 49'500'000);
    EXPECT_NEAR(value->value, 0.5e-6 * static_cast<double>(value->time_ns), 1e-9);
    EXPECT_EQ(value->used, 100U);
  }
  WindowFilter held({WindowKind::kMean, 1, 1.0, 38 * kMs});
  EXPECT_EQ(held.push({100 * kMs, 1.0})->time_ns, 62 * kMs);
}

TEST(WindowFilter, RejectsAtOneSigmaLikeTheSeed) {
  WindowFilter filter({WindowKind::kRejectingMean, 5, 1.0, 0});
  std::optional<FilteredReading> value;
  // Mean 2.8, standard deviation 3.6: 10 is left out, the others are kept.
  for (const double v : {1.0, 1.0, 1.0, 1.0, 10.0}) {
    value = filter.push({0, v});
  }
  ASSERT_TRUE(value);
  EXPECT_DOUBLE_EQ(value->value, 1.0);
  EXPECT_EQ(value->used, 4U);
}

TEST(WindowFilter, IgnoresMissingReadingsAndSpikes) {
  for (const WindowKind kind : {WindowKind::kMedian, WindowKind::kHampel}) {
    WindowFilter filter({kind, 11, 3.0, 0});
    std::optional<FilteredReading> value;
    for (int i = 0; i < 11; ++i) {
      value = filter.push({i * kMs, i % 5 == 1 ? kMissing : i % 5 == 3 ? 900.0 : 7.0});
    }
    ASSERT_TRUE(value);
    EXPECT_DOUBLE_EQ(value->value, 7.0);
  }
  WindowFilter filter({WindowKind::kMean, 2, 1.0, 0});
  EXPECT_FALSE(filter.push({0, kMissing}));
  EXPECT_FALSE(filter.push({kMs, kMissing}));
  EXPECT_EQ(filter.push({2 * kMs, 3.0})->used, 1U);
  EXPECT_THROW(WindowFilter({WindowKind::kMean, 0, 1.0, 0}), std::invalid_argument);
  EXPECT_THROW(WindowFilter({WindowKind::kHampel, 3, 0.0, 0}), std::invalid_argument);
}

TEST(RangeChain, GivesEveryNthValueInMillimetres) {
  ChainOptions options; // those of [NeuroGuide]
  RangeChain chain(options, {200.0, -1.0});
  int values = 0;
  std::optional<FilteredReading> last;
  for (int i = 0; i < 5000; ++i) {
    if (const auto value = chain.push({i * kMs, 2.0})) {
      ++values;
      last = value;
    }
  }
  EXPECT_EQ(values, 4); // readings 1000, 2000, 3000, 4000; at 0 the window is not full
  ASSERT_TRUE(last);
  EXPECT_DOUBLE_EQ(last->value, 100.0);
  EXPECT_EQ(last->delay_ns, 50'500'000); // 49.5 ms of the window and 1 ms of the smoothing
}

TEST(PowerLaw, RecoversItsParametersWithinTheirCovariance) {
  const PowerLaw truth{270.0, -1.2};
  std::mt19937 rng(3);
  std::normal_distribution<double> noise(0.0, 0.8);
  int within = 0;
  constexpr int kRuns = 200;
  for (int run = 0; run < kRuns; ++run) {
    std::vector<CalibrationPoint> points;
    for (double mm = 100.0; mm <= 400.0; mm += 2.0) {
      points.push_back({truth.reading(mm), mm + noise(rng)});
    }
    const PowerLawFit fit = fit_power_law(points);
    ASSERT_TRUE(fit.accepted()) << fit.text;
    const Eigen::Vector2d error(fit.law.scale_mm - truth.scale_mm, fit.law.exponent - truth.exponent);
    within += error.dot(fit.covariance.inverse() * error) < 5.99 ? 1 : 0;
  }
  EXPECT_GE(within, 0.88 * kRuns);
  EXPECT_LE(within, 0.99 * kRuns);
}

TEST(PowerLaw, StatesWhereItDoesNotFit) {
  std::vector<CalibrationPoint> points;
  for (double mm = 100.0; mm <= 800.0; mm += 10.0) {
    points.push_back({sim::sharp_volts(mm), mm});
  }
  PowerLawFit fit = fit_power_law(points);
  EXPECT_EQ(fit.verdict, PowerLawVerdict::kDoesNotFit);
  EXPECT_NE(fit.text.find("does not fit at"), std::string::npos) << fit.text;
  ASSERT_FALSE(fit.misfits.empty());
  // Below 65 mm the voltage falls again.
  points.clear();
  for (double mm = 20.0; mm <= 200.0; mm += 2.0) {
    points.push_back({sim::sharp_volts(mm), mm});
  }
  EXPECT_EQ(fit_power_law(points).verdict, PowerLawVerdict::kNotMonotone);
}

TEST(PowerLaw, RefusesWhatCannotBeFitted) {
  std::vector<CalibrationPoint> points(30, {1.0, 200.0});
  EXPECT_EQ(fit_power_law(points).verdict, PowerLawVerdict::kTooNarrow);
  points[4].reading = -1.0;
  const PowerLawFit fit = fit_power_law(points);
  EXPECT_EQ(fit.verdict, PowerLawVerdict::kInvalidPoint);
  EXPECT_EQ(fit.text, "refused: point 5: reading -1 at 200 mm: both must be positive");
  points.resize(3);
  EXPECT_EQ(fit_power_law(points).verdict, PowerLawVerdict::kTooFewPoints);
  EXPECT_TRUE(std::isnan(PowerLaw({200.0, -1.0}).distance_mm(-0.1)));
}

TEST(SharpSensor, HoldsItsValueForAboutAPeriod) {
  sim::SharpOptions options;
  options.line_noise_mV = 0.0;
  sim::SharpSensor sensor(
      options,
      [](std::int64_t) {
        return sim::BeamTarget{200.0, 0.0, std::nan("")};
      },
      1);
  int changes = 0;
  double before = sensor.read_volts(0, false);
  for (std::int64_t i = 1; i < 60'000; ++i) {
    const double now = sensor.read_volts(i * kMs, false);
    changes += now != before ? 1 : 0;
    before = now;
  }
  // 60 s / 38.3 ms = 1,567 periods; some values repeat the step before.
  EXPECT_GT(changes, 900);
  EXPECT_LE(changes, 1620);
}

TEST(SharpSensor, IsAmbiguousBelowItsRange) {
  EXPECT_LT(sim::sharp_volts(30.0), sim::sharp_volts(65.0));
  EXPECT_GT(sim::sharp_volts(65.0), sim::sharp_volts(100.0));
  for (double mm = 66.0; mm < 1490.0; mm += 1.0) {
    EXPECT_GT(sim::sharp_volts(mm), sim::sharp_volts(mm + 1.0)) << mm;
  }
  EXPECT_EQ(sim::sharp_volts(std::nan("")), 0.0);
}

} // namespace
} // namespace bregma::range
