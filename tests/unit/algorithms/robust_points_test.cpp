// Paired points with outliers, and the error metrics of the seeds.
#include <cmath>

#include <gtest/gtest.h>

#include "algorithms/registration/points/robust_points.hpp"
#include "algorithms/uncertainty/error_metrics.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
constexpr unsigned kRobustSeed = 20260313;

PairedPose robust_pose(std::mt19937 &rng) {
  return test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
}

std::vector<PointPair> stated_pairs(std::mt19937 &rng, const PairedPose &T, int count) {
  std::vector<PointPair> out;
  for (int i = 0; i < count; ++i) {
    PointPair pair;
    const Vector3d p = test::normal_vector(rng, 60.0);
    pair.target_covariance = test::random_anisotropic(rng, 0.3, 0.9);
    pair.source_mm = p;
    pair.target_mm = T * p + test::draw(rng, pair.target_covariance);
    out.push_back(pair);
  }
  return out;
}

TEST(RobustPoints, IdentifiesTheWrongPairs) {
  std::mt19937 rng(kRobustSeed);
  int exact = 0;
  constexpr int kRuns = 200;
  for (int run = 0; run < kRuns; ++run) {
    const PairedPose T = robust_pose(rng);
    auto pairs = stated_pairs(rng, T, 9);
    pairs[2].target_mm += 15.0 * test::normal_vector(rng, 1.0).normalized();
    std::swap(pairs[5].target_mm, pairs[7].target_mm);
    const RobustFit fit = fit_paired_robust(pairs);
    ASSERT_TRUE(fit.found) << "run " << run << " seed " << kRobustSeed;
    bool right = true;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      right = right && fit.inlier[i] == (i != 2 && i != 5 && i != 7);
    }
    exact += right ? 1 : 0;
    EXPECT_LT(fit.p_value[5], 1e-6);
    EXPECT_GT(fit.fit.fiducials[2].leave_one_out_mm, 8.0);
    EXPECT_LT((fit.fit.T_target_source * Vector3d::Zero() - T * Vector3d::Zero()).norm(), 3.0);
  }
  EXPECT_GT(exact, 190); // of 200; a correct pair is rejected occasionally, by design
}

TEST(RobustPoints, FalseAlarmsOccurAtTheStatedRate) {
  std::mt19937 rng(kRobustSeed);
  int alarms = 0;
  constexpr int kRuns = 1500;
  for (int run = 0; run < kRuns; ++run) {
    RobustOptions options;
    options.false_alarm = 0.05;
    const RobustFit fit = fit_paired_robust(stated_pairs(rng, robust_pose(rng), 8), options);
    alarms += fit.outliers > 0 ? 1 : 0;
  }
  EXPECT_NEAR(100.0 * alarms / kRuns, 5.0, 1.8) << "seed " << kRobustSeed;
}

TEST(RobustPoints, WithoutOutliersItEqualsThePlainFit) {
  std::mt19937 rng(kRobustSeed);
  const auto pairs = stated_pairs(rng, robust_pose(rng), 8);
  const RobustFit robust = fit_paired_robust(pairs);
  const PairedFit plain = fit_paired(pairs);
  ASSERT_TRUE(robust.found && robust.outliers == 0);
  EXPECT_LT((robust.fit.T_target_source.matrix() - plain.T_target_source.matrix()).norm(), 1e-7);
  EXPECT_NEAR(robust.fit.chi_square, plain.chi_square, 1e-6);
}

TEST(RobustPoints, IsEquivariantOnBothSides) {
  std::mt19937 rng(kRobustSeed);
  auto pairs = stated_pairs(rng, robust_pose(rng), 7);
  pairs[3].target_mm.x() += 12.0;
  const RobustFit fit = fit_paired_robust(pairs);
  const PairedPose on_target = robust_pose(rng);
  const Matrix3d R = on_target.rotation_matrix();
  for (PointPair &pair : pairs) {
    pair.target_mm = on_target * pair.target_mm;
    pair.target_covariance = R * pair.target_covariance * R.transpose();
  }
  const RobustFit moved = fit_paired_robust(pairs);
  EXPECT_EQ(moved.inlier, fit.inlier);
  const auto expected = on_target.as<geometry::frame::Target, geometry::frame::Target>() * fit.fit.T_target_source;
  EXPECT_LT((moved.fit.T_target_source.matrix() - expected.matrix()).norm(), 1e-6);
}

TEST(RobustPoints, ClaimsNothingWhenMostPairsAreWrong) {
  std::mt19937 rng(kRobustSeed);
  int found = 0;
  for (int run = 0; run < 100; ++run) {
    auto pairs = stated_pairs(rng, robust_pose(rng), 6);
    for (std::size_t i = 0; i < 4; ++i) {
      pairs[i].target_mm += test::normal_vector(rng, 40.0);
    }
    found += fit_paired_robust(pairs).found ? 1 : 0;
  }
  EXPECT_EQ(found, 0) << "seed " << kRobustSeed;
  EXPECT_FALSE(fit_paired_robust({}).found);
  const auto three = stated_pairs(rng, robust_pose(rng), 3);
  EXPECT_FALSE(fit_paired_robust(three).found);
  EXPECT_FALSE(fit_paired_robust(std::vector<PointPair>(8, three[0])).found);
}

// Three of four points identify the wrong one only if no other three are consistent. The result is then correct.
TEST(RobustPoints, OfFourPairsThreeMayIdentifyTheWrongOne) {
  std::mt19937 rng(kRobustSeed);
  int named = 0;
  int misnamed = 0;
  constexpr int kRuns = 200;
  for (int run = 0; run < kRuns; ++run) {
    auto pairs = stated_pairs(rng, robust_pose(rng), 4);
    pairs[1].target_mm += 15.0 * test::normal_vector(rng, 1.0).normalized();
    const RobustFit fit = fit_paired_robust(pairs);
    if (fit.found) {
      const bool right = !fit.inlier[1] && fit.outliers == 1;
      named += right ? 1 : 0;
      misnamed += right ? 0 : 1;
    }
  }
  EXPECT_GT(named, kRuns / 2) << "seed " << kRobustSeed;
  EXPECT_LE(misnamed, kRuns / 50) << "seed " << kRobustSeed;
}

TEST(RobustPoints, DoesNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  std::mt19937 rng(kRobustSeed);
  const auto pairs = stated_pairs(rng, robust_pose(rng), 64);
  const test::AllocationScope scope;
  EXPECT_TRUE(fit_paired_robust(pairs).found);
  EXPECT_EQ(scope.count(), 0U);
}

// Distribution of the FRE: its p-value is uniform if the FLE is as stated.
TEST(FreTest, IsUniform) {
  std::mt19937 rng(kRobustSeed);
  int below = 0;
  constexpr int kRuns = 3000;
  for (int run = 0; run < kRuns; ++run) {
    const PairedPose T = robust_pose(rng);
    std::vector<Vector3d> source;
    std::vector<Vector3d> target;
    for (int i = 0; i < 6; ++i) {
      source.push_back(test::normal_vector(rng, 60.0));
      target.push_back(T * source.back() + test::normal_vector(rng, 0.5));
    }
    const double fre = uncertainty::rms_distance_mm(*fit_rigid(source, target), source, target);
    below += fre_p_value(6, fre, 0.5 * std::sqrt(3.0)) < 0.1 ? 1 : 0;
  }
  EXPECT_NEAR(100.0 * below / kRuns, 10.0, 1.8) << "seed " << kRobustSeed;
  EXPECT_TRUE(std::isnan(fre_p_value(2, 1.0, 1.0)));
  EXPECT_LT(fre_p_value(6, 3.0, 1.0), 1e-6);
}

TEST(ErrorMetrics, MatchesTheSeedsFormulas) {
  const uncertainty::AnyPose identity;
  const std::vector<Vector3d> source = {{0, 0, 0}, {10, 0, 0}};
  const std::vector<Vector3d> target = {{3, 0, 4}, {10, 0, -2}};
  EXPECT_NEAR(uncertainty::rms_distance_mm(identity, source, target), std::sqrt((25.0 + 4.0) / 2.0), 1e-12);
  EXPECT_NEAR(uncertainty::out_of_plane_mean_error_mm(identity, source, target, Vector3d::UnitZ()), 3.0, 1e-12);
  EXPECT_TRUE(std::isnan(uncertainty::rms_distance_mm(identity, source, {})));
}

TEST(ErrorMetrics, NoDirectionIsWorseThanTheWorstDirection) {
  std::mt19937 rng(kRobustSeed);
  for (int run = 0; run < 20; ++run) {
    const auto actual = robust_pose(rng);
    const PairedPose estimated(geometry::rotation_exp(test::normal_vector(rng, 0.05)) * actual.rotation(),
                               actual.translation());
    const auto e = uncertainty::ten_centimetre_error(actual, estimated);
    const auto off = [&](const Vector3d &u) {
      return 100.0 * (actual.rotation() * u - estimated.rotation() * u).norm();
    };
    EXPECT_NEAR(off(e.worst_direction), e.worst_mm, 1e-9);
    double squares = 0.0;
    constexpr int kDirections = 2000;
    for (int i = 0; i < kDirections; ++i) {
      const double here = off(test::normal_vector(rng, 1.0).normalized());
      EXPECT_LE(here, e.worst_mm + 1e-9);
      squares += here * here;
    }
    EXPECT_NEAR(std::sqrt(squares / kDirections), e.mean_mm, 0.03 * e.mean_mm);
    // Without a translation error the published figure is that of one direction, divided by the square root of three.
    EXPECT_NEAR(e.as_published_mm, off(Vector3d::UnitX()) / std::sqrt(3.0), 1e-9);
    // Invariant under a rigid motion of both sides, unlike the published one.
    const PairedPose move = robust_pose(rng);
    const auto on_target = move.as<geometry::frame::Target, geometry::frame::Target>();
    const auto moved = uncertainty::ten_centimetre_error(on_target * actual, on_target * estimated);
    EXPECT_NEAR(moved.worst_mm, e.worst_mm, 1e-9);
  }
  const uncertainty::AnyPose half(Eigen::Quaterniond(0.0, 0.0, 0.0, 1.0), Vector3d::Zero());
  EXPECT_NEAR(uncertainty::ten_centimetre_error({}, half).worst_mm, 200.0, 1e-9);
  EXPECT_EQ(uncertainty::ten_centimetre_error({}, {}).worst_mm, 0.0);
}

} // namespace
