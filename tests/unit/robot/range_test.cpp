// Filters and calibration of a range sensor, on synthetic readings and on the simulated sensor.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "algorithms/range/range_filters.hpp"
#include "algorithms/range/surface_scan.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"
#include "drivers/sim/range/surface_under_beam.hpp"

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
  RangeChain chain(options, {{200.0, -1.0}, {}});
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

TEST(SurfacePoints, LieWhereTheSensorWasWhenTheDistanceHeld) {
  // A slope that is scanned at 5 mm/s: the delay of the chain would shift every point along the path.
  const PowerLaw curve{200.0, -1.0};
  ScanOptions options{.chain = {{WindowKind::kHampel, 200, 3.0, 38 * kMs}, 1, 100}, .curve = {curve, {}}};
  const auto distance_mm = [](double x_mm) { return 150.0 + 0.8 * x_mm; };
  std::vector<ScanRecord> records;
  for (int i = 0; i < 3000; ++i) {
    const double seen_x_mm = 5e-3 * (i - 38); // the sensor holds a value of 38 ms ago
    records.push_back({5e-3 * i, 7.0, i % 50 == 3 ? kMissing : curve.reading(distance_mm(seen_x_mm))});
  }
  records[1500].x_mm = kMissing;
  const SurfaceScan scan = surface_points(records, options);
  ASSERT_EQ(scan.points_mm.size(), 28U);
  EXPECT_EQ(scan.missing, 60U);
  EXPECT_NEAR(scan.delay_ms, 99.5 + 38.0, 0.5);
  for (const Eigen::Vector3d &p : scan.points_mm) {
    EXPECT_NEAR(p.z(), 200.0 - distance_mm(p.x()), 0.01);
    EXPECT_EQ(p.y(), 7.0);
  }
  options.at_newest = true;
  const SurfaceScan late = surface_points(records, options);
  EXPECT_GT(std::abs(late.points_mm.back().z() - (200.0 - distance_mm(late.points_mm.back().x()))), 0.5);
}

TEST(SurfacePoints, CountsWhatItLeavesOut) {
  ScanOptions options{.chain = {{WindowKind::kMean, 1, 1.0, 0}, 1, 1}, .curve = {{1.0, 1.0}, {}}};
  options.near_mm = 100.0;
  options.far_mm = 300.0;
  options.lowest_mm = 5.0;
  const std::vector<ScanRecord> records{{0, 0, 50.0},  {1, 0, 400.0}, {2, 0, 198.0},       {3, 0, 150.0},
                                        {4, 0, 150.0}, {5, 0, -1.0},  {kMissing, 0, 150.0}};
  const SurfaceScan scan = surface_points(records, options);
  EXPECT_EQ(scan.points_mm.size(), 2U);
  EXPECT_EQ(scan.too_near, 1U); // a reading below zero is no distance
  EXPECT_EQ(scan.too_far, 1U);
  EXPECT_EQ(scan.too_low, 1U);
  EXPECT_EQ(scan.without_position, 1U);
  EXPECT_TRUE(surface_points({}, options).points_mm.empty());
  options.period_ms = 0.0;
  EXPECT_THROW(static_cast<void>(surface_points(records, options)), std::invalid_argument);
}

TEST(SurfacePoints, SteepPlacesAreLeftOutWhereTheSlopeIsKnown) {
  ScanOptions options{.chain = {{WindowKind::kMean, 1, 1.0, 0}, 1, 1}, .curve = {{1.0, 1.0}, {}}};
  options.max_slope_rad = 0.7;
  std::vector<ScanRecord> records;
  for (int y = 0; y < 50; y += 5) {
    for (int x = 0; x < 100; x += 5) { // flat, then a slope of 63 degrees
      records.push_back({1.0 * x, 1.0 * y, x < 50 ? 150.0 : 150.0 - 2.0 * (x - 50)});
    }
  }
  records.push_back({500.0, 500.0, 150.0}); // alone
  const SurfaceScan scan = surface_points(records, options);
  EXPECT_GT(scan.too_steep, 80U);
  EXPECT_EQ(scan.points_mm.size() + scan.too_steep, records.size());
  EXPECT_EQ(scan.newest.size(), scan.points_mm.size());
  for (const Eigen::Vector3d &p : scan.points_mm) {
    EXPECT_TRUE(p.x() <= 55.0 || p.x() == 500.0) << p.transpose();
  }
  EXPECT_EQ(scan.points_mm.back().x(), 500.0);
}

TEST(SurfaceUnderBeam, MeetsTheUppermostTriangleItsTiltAndItsEdge) {
  surface::TriangleMesh mesh; // a slope of 45 degrees from x = 0 to 20, above a plate at z = 1
  mesh.vertices_mm = {{0, 0, 20}, {20, 0, 40}, {20, 20, 40}, {0, 20, 20},
                      {0, 0, 1},  {40, 0, 1},  {40, 20, 1},  {0, 20, 1}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
  const sim::SurfaceUnderBeam surface(mesh);
  EXPECT_NEAR(surface.top(10.0, 10.0)->z_mm, 30.0, 1e-9);
  EXPECT_NEAR(surface.top(30.0, 10.0)->z_mm, 1.0, 1e-9);
  EXPECT_FALSE(surface.top(-1.0, 10.0));
  const sim::BeamTarget slope = surface.target(10.0, 10.0, 200.0);
  EXPECT_NEAR(slope.distance_mm, 170.0, 1e-9);
  EXPECT_NEAR(slope.tilt_rad, std::numbers::pi / 4.0, 1e-9);
  EXPECT_TRUE(std::isnan(slope.other_mm));
  EXPECT_NEAR(surface.target(19.0, 10.0, 200.0).other_mm, 199.0, 1e-9); // its spot reaches the plate
  EXPECT_NEAR(surface.target(-10.0, 10.0, 200.0).distance_mm, 200.0, 1e-9);
  EXPECT_THROW(sim::SurfaceUnderBeam(surface::TriangleMesh{}), std::invalid_argument);
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

TEST(RangeCurve, CorrectsTheLawByTheMeanResidualsBetweenWhichItIsLinear) {
  std::vector<CalibrationPoint> points;
  for (double mm = 115.0; mm <= 205.0; mm += 2.5) {
    points.push_back({sim::sharp_volts(mm), mm});
  }
  const PowerLawFit fit = fit_power_law(points);
  ASSERT_TRUE(fit.accepted()) << fit.text;
  EXPECT_GT(fit.rms_mm, 0.5);
  EXPECT_LT(fit.corrected_rms_mm, 0.3);
  const RangeCurve curve = fit.corrected();
  ASSERT_EQ(curve.corrections.size(), 8U);
  double worst_mm = 0.0; // between the points as well
  for (double mm = 120.0; mm <= 200.0; mm += 0.7) {
    worst_mm = std::max(worst_mm, std::abs(curve.distance_mm(sim::sharp_volts(mm)) - mm));
  }
  EXPECT_LT(worst_mm, 0.6);

  const RangeCurve stated{{200.0, -1.0}, {{1.0, 2.0}, {2.0, 4.0}}};
  EXPECT_DOUBLE_EQ(stated.distance_mm(1.5), 200.0 / 1.5 + 3.0);
  EXPECT_DOUBLE_EQ(stated.distance_mm(0.5), 402.0);
  EXPECT_DOUBLE_EQ(stated.distance_mm(4.0), 54.0);
  EXPECT_TRUE(std::isnan(stated.distance_mm(0.0)));
  EXPECT_TRUE(std::isnan(stated.distance_mm(kMissing)));
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
