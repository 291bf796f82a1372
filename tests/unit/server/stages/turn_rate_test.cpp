// The error of a rotation that is published some time after its exposure.
#include "server/stages/navigation/turn_rate.hpp"

#include <array>
#include <cstdio>
#include <random>

#include <gtest/gtest.h>

#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/unit/server/stages/strokes.hpp"

namespace bregma::server::tracking_test {
namespace {

constexpr double kNoise_rad = 0.002; // of a frame, about each axis

// Turns as strokes: 100 mm of the stroke are half a radian, so up to 2.5 rad/s with pauses.
Eigen::Quaterniond turned(const geometry::Vector3d &stroke_mm) {
  const geometry::Vector3d v = 0.005 * stroke_mm;
  return Eigen::Quaterniond(Eigen::AngleAxisd(v.norm(), v.stableNormalized()));
}

TEST(TurnRate, TheTrueRotationLiesInTheStatedRegionAtEveryAge) {
  constexpr std::array<double, 4> kAges_s{0.0, 0.025, 0.05, 0.1};
  const double limit = uncertainty::chi_square_upper_quantile(0.05, 3);
  for (const double rate_hz : {250.0, 60.0}) {
    std::array<int, 4> inside{};
    int count = 0;
    for (unsigned seed = 1; seed <= 20; ++seed) {
      std::mt19937 rng(seed);
      std::normal_distribution<double> noise(0.0, kNoise_rad);
      Strokes hand(seed);
      TurnRate rate;
      for (int i = 0; i < static_cast<int>(30.0 * rate_hz); ++i) {
        const double time_s = i / rate_hz;
        const geometry::Vector3d error(noise(rng), noise(rng), noise(rng));
        const Eigen::Quaterniond seen =
            Eigen::Quaterniond(Eigen::AngleAxisd(error.norm(), error.normalized())) * turned(hand.at(time_s));
        rate.add(seen, static_cast<std::int64_t>(1e9 * time_s));
        if (i % 13 != 0 || i == 0) {
          continue;
        }
        ++count;
        for (std::size_t k = 0; k < kAges_s.size(); ++k) {
          Strokes later = hand;
          const Eigen::AngleAxisd left(turned(later.at(time_s + kAges_s[k])) * seen.conjugate());
          const geometry::Matrix3d stated =
              rate.growth(kAges_s[k]) + kNoise_rad * kNoise_rad * geometry::Matrix3d::Identity();
          const geometry::Vector3d missed = left.angle() * left.axis();
          inside[k] += uncertainty::mahalanobis_squared(stated, missed) <= limit ? 1 : 0;
        }
      }
    }
    for (std::size_t k = 0; k < kAges_s.size(); ++k) {
      const double share = static_cast<double>(inside[k]) / count;
      std::printf("%.0f Hz, age %.0f ms: %.1f %% inside\n", rate_hz, 1e3 * kAges_s[k], 100.0 * share);
      EXPECT_GE(share, 0.93) << rate_hz << " Hz, age " << kAges_s[k] << " s";
    }
  }
}

TEST(TurnRate, OfAToolThatRestsOnlyTheUnknownAccelerationGrows) {
  TurnRate rate;
  for (int i = 0; i < 100; ++i) {
    rate.add(Eigen::Quaterniond::Identity(), 4'000'000LL * i);
  }
  const double unknown = 0.5 * TurnRate::kAcceleration_rad_s2 * 0.1 * 0.1;
  EXPECT_TRUE(rate.growth(0.1).isApprox(unknown * unknown * geometry::Matrix3d::Identity()));
  EXPECT_TRUE(rate.growth(0.0).isZero());
}

} // namespace
} // namespace bregma::server::tracking_test
