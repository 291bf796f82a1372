#include "server/stages/navigation/tip_filter.hpp"

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

namespace {

using bregma::geometry::Matrix3d;
using bregma::geometry::Vector3d;
using bregma::server::TipFilter;

constexpr unsigned kFilterSeed = 7;
constexpr std::int64_t kPeriod_ns = 4'000'000;
constexpr double kBandwidth_hz = 3.0;

Matrix3d marker_noise() { return Vector3d(0.3 * 0.3, 0.4 * 0.4, 0.7 * 0.7).asDiagonal(); }

struct Result {
  double rms_mm = 0.0;
  double raw_rms_mm = 0.0;
  double inside_95 = 0.0; // fraction of frames
};

// Runs the filter over a path given as a function of time, from settle_s on.
Result follow(const std::function<Vector3d(double)> &path, double seconds, double settle_s) {
  std::mt19937 rng(kFilterSeed);
  std::normal_distribution<double> normal;
  TipFilter filter;
  Result out;
  int count = 0;
  for (std::int64_t i = 0; 4e-3 * static_cast<double>(i) < seconds; ++i) {
    const double t = 4e-3 * static_cast<double>(i);
    const Vector3d truth = path(t);
    const Vector3d error = marker_noise().cwiseSqrt() * Vector3d(normal(rng), normal(rng), normal(rng));
    filter.add(truth + error, marker_noise(), (i + 1) * kPeriod_ns, kBandwidth_hz);
    if (t < settle_s) {
      continue;
    }
    const bregma::server::MovingPoint tip = filter.estimate();
    const Vector3d shown = tip.position_mm - truth;
    ++count;
    out.rms_mm += shown.squaredNorm();
    out.raw_rms_mm += error.squaredNorm();
    out.inside_95 += shown.dot(tip.P.inverse() * shown) < 7.815 ? 1.0 : 0.0;
  }
  out.rms_mm = std::sqrt(out.rms_mm / count);
  out.raw_rms_mm = std::sqrt(out.raw_rms_mm / count);
  out.inside_95 /= count;
  return out;
}

TEST(TipFilter, AtRestTheTipsScatterIsAThirdAndMatchesItsCovariance) {
  const Result held = follow([](double) { return Vector3d(1, 2, 3); }, 40.0, 1.0);
  EXPECT_LT(held.rms_mm, 0.4 * held.raw_rms_mm);
  EXPECT_GT(held.inside_95, 0.93);
}

TEST(TipFilter, AnInsertionAtConstantSpeedHasNoLag) {
  const Result pushed = follow([](double t) { return Vector3d(0, 0, 10.0 * t); }, 40.0, 1.0);
  EXPECT_LT(pushed.rms_mm, 0.4 * pushed.raw_rms_mm);
  EXPECT_GT(pushed.inside_95, 0.93);
}

TEST(TipFilter, TheCovarianceBoundsTheErrorOfAFastHand) {
  // From rest to 350 mm/s and back within 1 s, repeatedly.
  const Result quick =
      follow([](double t) { return Vector3d(100.0 * std::sin(2.0 * std::numbers::pi * 0.55 * t), 0, 0); }, 40.0, 1.0);
  EXPECT_LT(quick.rms_mm, 1.5 * quick.raw_rms_mm);
  EXPECT_GT(quick.inside_95, 0.90);
}

TEST(TipFilter, AGapResetsTheFilter) {
  TipFilter filter;
  for (int i = 1; i <= 100; ++i) {
    filter.add(Vector3d::Zero(), marker_noise(), i * kPeriod_ns, kBandwidth_hz);
  }
  EXPECT_LT(filter.estimate().V.trace(), 100.0 * 100.0);
  const Vector3d elsewhere(50, 0, 0);
  filter.add(elsewhere, marker_noise(), 101 * kPeriod_ns + 500'000'000, kBandwidth_hz);
  EXPECT_EQ(filter.estimate().position_mm, elsewhere);
  EXPECT_EQ(filter.estimate().P, marker_noise());
  EXPECT_EQ(filter.estimate().velocity_mm_s, Vector3d::Zero());
  EXPECT_GE(filter.estimate().V.trace(), 3.0 * 300.0 * 300.0) << "a velocity that is not known is stated as such";
}

TEST(TipFilter, ARepeatedFrameHasNoEffect) {
  TipFilter filter;
  filter.add(Vector3d(1, 0, 0), marker_noise(), kPeriod_ns, kBandwidth_hz);
  filter.add(Vector3d(9, 0, 0), marker_noise(), kPeriod_ns, kBandwidth_hz);
  EXPECT_EQ(filter.estimate().position_mm, Vector3d(1, 0, 0));
}

TEST(TipFilter, AFrameThatIsNotFiniteHasNoEffect) {
  TipFilter filter;
  const double nan = std::nan("");
  for (int i = 1; i <= 20; ++i) {
    const bool bad = i % 4 == 0;
    filter.add(bad ? Vector3d(nan, 0, 0) : Vector3d(1, 0, 0), marker_noise(), i * kPeriod_ns, kBandwidth_hz);
    filter.add(Vector3d(1, 0, 0), bad ? Matrix3d(marker_noise() * nan) : marker_noise(), i * kPeriod_ns, kBandwidth_hz);
  }
  EXPECT_TRUE(filter.estimate().position_mm.isApprox(Vector3d(1, 0, 0)));
  EXPECT_TRUE(filter.estimate().V.allFinite());
}

} // namespace
