// Pivot calibration on simulated tools with known tips, and on real recordings with published results.
#include <cmath>
#include <random>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "algorithms/calibration/pivot.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "casefile/poses.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma::calibration;
using bregma::geometry::Matrix3d;
using bregma::geometry::Vector3d;

constexpr unsigned kSeed = 20260301;
const double kChiSquare95 = bregma::uncertainty::chi_square_upper_quantile(0.05, 3);
const Vector3d kTip(-12.0, 150.0, 4.0);
const Vector3d kPivot(100.0, -50.0, -1500.0);

struct Motion {
  std::size_t poses = 600;
  double swing_rad = 0.5; // about two axes
  double second_swing_rad = 0.5;
  double noise_mm = 0.25;   // standard deviation per coordinate of the tip
  double correlation = 0.0; // correlation between the errors of neighbouring poses
  double outlier_share = 0.0;
  double outlier_mm = 30.0;
};

Vector3d normal_vector(std::mt19937 &rng) {
  std::normal_distribution<double> normal;
  return {normal(rng), normal(rng), normal(rng)};
}

// A hand rotates the tool back and forth about two axes and slowly about the third, at 20 poses per second.
std::vector<PivotPose> simulate(const Motion &motion, std::mt19937 &rng) {
  std::vector<PivotPose> poses;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const double phase = 6.28 * uniform(rng);
  Vector3d error = motion.noise_mm * normal_vector(rng);
  for (std::size_t i = 0; i < motion.poses; ++i) {
    const double t = 0.05 * static_cast<double>(i);
    const Vector3d turn(motion.swing_rad * std::sin(1.9 * t + phase), 0.2 * motion.second_swing_rad * std::sin(0.3 * t),
                        motion.second_swing_rad * std::sin(1.3 * t));
    const Eigen::Quaterniond q = bregma::geometry::rotation_exp(turn);
    error = motion.correlation * error +
            std::sqrt(1.0 - motion.correlation * motion.correlation) * motion.noise_mm * normal_vector(rng);
    Vector3d shown = kPivot + error;
    if (uniform(rng) < motion.outlier_share) {
      shown += motion.outlier_mm * normal_vector(rng);
    }
    poses.push_back({static_cast<std::int64_t>(50'000'000 * i), ToolPose(q, shown - q * kTip)});
  }
  return poses;
}

double mahalanobis_squared(const Vector3d &d, const Matrix3d &covariance) { return d.dot(covariance.inverse() * d); }

TEST(Pivot, WithoutErrorsTheTipIsExact) {
  std::mt19937 rng(kSeed);
  const auto poses = simulate({.noise_mm = 0.0}, rng);
  const PivotFit fit = fit_pivot_least_squares(poses);
  EXPECT_LT((fit.tip_mm - kTip).norm(), 1e-8);
  EXPECT_LT((fit.pivot_mm - kPivot).norm(), 1e-8);
  const PivotResult result = calibrate_pivot(poses, {.min_noise_ratio = 0.0});
  EXPECT_TRUE(result.accepted()) << result.text;
  EXPECT_LT((result.tip_mm - kTip).norm(), 1e-8);
  EXPECT_LT((result.pivot_mm - kPivot).norm(), 1e-8);
}

TEST(Pivot, AGoodRecordingIsAccepted) {
  std::mt19937 rng(kSeed);
  const PivotResult result = calibrate_pivot(simulate({}, rng));
  EXPECT_TRUE(result.accepted()) << result.text;
  EXPECT_EQ(result.text.rfind("accepted: tip 1", 0), 0U) << result.text;
  EXPECT_LT((result.tip_mm - kTip).norm(), 0.3);
  EXPECT_NEAR(result.rms_mm, 0.25 * std::sqrt(3.0), 0.03);
}

// The reported 95 % region contains the true tip in about 95 % of the recordings. This also holds for correlated errors
// of neighbouring poses, for which the covariance of independent residuals would be far too small.
TEST(Pivot, TheCovarianceIsHonest) {
  for (const double correlation : {0.0, 0.9}) {
    std::mt19937 rng(kSeed);
    constexpr int kRuns = 300;
    int inside = 0;
    for (int run = 0; run < kRuns; ++run) {
      const PivotResult result = calibrate_pivot(simulate({.correlation = correlation}, rng));
      ASSERT_TRUE(result.estimated);
      inside += mahalanobis_squared(result.tip_mm - kTip, result.covariance_mm2) < kChiSquare95 ? 1 : 0;
    }
    std::printf("correlation %.1f: the tip lies in the 95 %% region in %d of %d recordings (seed %u)\n", correlation,
                inside, kRuns, kSeed);
    EXPECT_GE(inside, kRuns * 92 / 100) << "correlation " << correlation;
    EXPECT_LE(inside, kRuns * 99 / 100) << "correlation " << correlation;
  }
}

TEST(Pivot, OutliersDoNotMoveTheTipAndAreCounted) {
  std::mt19937 rng(kSeed);
  const PivotResult result = calibrate_pivot(simulate({.outlier_share = 0.1}, rng));
  EXPECT_TRUE(result.accepted()) << result.text;
  EXPECT_LT((result.tip_mm - kTip).norm(), 0.3);
  EXPECT_GT((result.least_squares.tip_mm - kTip).norm(), 0.5) << "this test needs outliers that matter";
  EXPECT_NEAR(static_cast<double>(result.outliers), 60.0, 15.0);
}

TEST(Pivot, WhatCannotBeCalibratedIsRefusedWithTheReason) {
  std::mt19937 rng(kSeed);
  const auto refused = [&rng](const Motion &motion, PivotVerdict verdict) {
    const PivotResult result = calibrate_pivot(simulate(motion, rng));
    EXPECT_EQ(result.verdict, verdict) << result.text;
    EXPECT_FALSE(result.accepted());
    return result.text;
  };
  EXPECT_EQ(refused({.poses = 20}, PivotVerdict::kTooFewPoses), "refused: 20 poses, at least 50 are needed");
  EXPECT_EQ(refused({.poses = 0}, PivotVerdict::kTooFewPoses), "refused: 0 poses, at least 50 are needed");
  EXPECT_EQ(refused({.swing_rad = 0.0, .second_swing_rad = 0.0}, PivotVerdict::kStatic),
            "refused: the tool was not moved (it turned by 0.0 degrees)");
  EXPECT_EQ(
      refused({.second_swing_rad = 0.02}, PivotVerdict::kTooLittleRotation),
      "refused: the tool was turned by 57 degrees about one axis and by 2 about the other; at least 20 about both "
      "are needed");
  const std::string many = refused({.outlier_share = 0.35}, PivotVerdict::kTooManyOutliers);
  EXPECT_NE(many.find("do not fit: did the tip stay in its dimple?"), std::string::npos) << many;
  const std::string noisy = refused({.noise_mm = 2.0}, PivotVerdict::kResidualTooLarge);
  EXPECT_EQ(noisy.rfind("not fit for navigation: RMS 3.", 0), 0U) << noisy;
  EXPECT_NE(noisy.find("times the tracker's noise of 0.25 mm"), std::string::npos) << noisy;
}

// A tracker that sends its last pose again, here every pose 20 times, or the last one more often than all others.
TEST(Pivot, RepeatedPosesAreNoPoses) {
  std::mt19937 rng(kSeed);
  const auto poses = simulate({}, rng);
  std::vector<PivotPose> six;
  for (int i = 0; i < 120; ++i) {
    six.push_back(poses[static_cast<std::size_t>(i % 6) * 90]);
  }
  const PivotResult few = calibrate_pivot(six);
  EXPECT_EQ(few.verdict, PivotVerdict::kTooFewPoses);
  EXPECT_EQ(few.text, "refused: 6 different (114 repeat an earlier one) poses, at least 50 are needed");
  // Sent again by way of another program, which rounds them; and a tool that rests six times, with little noise.
  for (const auto &[jitter_mm, text] :
       {std::pair(1e-6, "refused: 6 different (114 repeat an earlier one) poses, at least 50 are needed"),
        {0.05, "refused: the tool rested in 6 places, at least 25 are needed: turn it all the time"}}) {
    auto near = six;
    for (PivotPose &pose : near) {
      const auto &T = pose.T_fixed_tool;
      pose.T_fixed_tool = ToolPose(T.rotation(), T.translation() + jitter_mm * normal_vector(rng));
    }
    const PivotResult refused = calibrate_pivot(near);
    EXPECT_EQ(refused.verdict, PivotVerdict::kTooFewPoses);
    EXPECT_EQ(refused.text, text);
  }
  std::vector<PivotPose> stuck(poses.begin(), poses.begin() + 60);
  stuck.insert(stuck.end(), 61, stuck.back());
  const PivotResult most = calibrate_pivot(stuck);
  EXPECT_EQ(most.poses, 60U);
  EXPECT_EQ(most.repeated, 61U);
  EXPECT_TRUE(most.tip_mm.allFinite());
}

TEST(Pivot, PosesInAnotherUnitAreRefused) {
  std::mt19937 rng(kSeed);
  for (const double factor : {0.001, 0.1, 1000.0}) {
    auto poses = simulate({}, rng);
    for (PivotPose &pose : poses) {
      pose.T_fixed_tool = ToolPose(pose.T_fixed_tool.rotation(), factor * pose.T_fixed_tool.translation());
    }
    const PivotResult result = calibrate_pivot(poses);
    EXPECT_FALSE(result.accepted());
    EXPECT_NE(result.text.find("are the poses in mm"), std::string::npos) << result.text;
  }
}

// An endoscope is a tool, a tip of 600 mm is not.
TEST(Pivot, ATipBeyondEveryToolIsRefused) {
  for (const double length_mm : {450.0, 600.0}) {
    std::mt19937 rng(kSeed);
    auto poses = simulate({}, rng);
    for (PivotPose &pose : poses) {
      const auto q = pose.T_fixed_tool.rotation();
      const Vector3d tip = length_mm * kTip.normalized();
      pose.T_fixed_tool = ToolPose(q, pose.T_fixed_tool * kTip - q * tip);
    }
    const PivotResult result = calibrate_pivot(poses);
    EXPECT_EQ(result.accepted(), length_mm < 500.0) << result.text;
    if (length_mm > 500.0) {
      EXPECT_EQ(result.verdict, PivotVerdict::kTipImplausible);
      EXPECT_EQ(result.text, "refused: the tip is 600 mm from the tool's origin, at most 500 mm are taken: "
                             "are the poses in mm?");
    }
  }
}

TEST(Pivot, AFixedToolHasNoLeastSquaresAnswer) {
  EXPECT_TRUE(std::isnan(fit_pivot_least_squares({}).rms_mm));
  const std::vector<PivotPose> fixed(100, PivotPose{0, ToolPose(Eigen::Quaterniond::Identity(), {1, 2, 3})});
  EXPECT_TRUE(std::isnan(fit_pivot_least_squares(fixed).rms_mm));
  EXPECT_EQ(calibrate_pivot(fixed).verdict, PivotVerdict::kStatic);
}

std::vector<PivotPose> real_poses(const std::filesystem::path &path) {
  const auto series = bregma::casefile::read_poses(path);
  EXPECT_TRUE(series) << (series ? "" : series.error().message);
  std::vector<PivotPose> poses;
  for (const auto &pose : series->poses) {
    poses.push_back({pose.time_ns, pose.pose.as<bregma::geometry::frame::Target, bregma::geometry::frame::Tool>()});
  }
  return poses;
}

std::string rounded(double value, int digits) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.*f", digits, value);
  return buffer;
}

void report(const char *name, const PivotResult &r) {
  const Vector3d sigma = r.covariance_mm2.diagonal().cwiseSqrt();
  std::printf("%s: least squares (%.3f, %.3f, %.3f), RMS %.4f mm (%.4f a component), worst %.2f; robust (%.3f, %.3f, "
              "%.3f) +- (%.2f, %.2f, %.2f)\n  %s\n",
              name, r.least_squares.tip_mm.x(), r.least_squares.tip_mm.y(), r.least_squares.tip_mm.z(),
              r.least_squares.rms_mm, r.least_squares.rms_component_mm, r.least_squares.worst_mm, r.tip_mm.x(),
              r.tip_mm.y(), r.tip_mm.z(), sigma.x(), sigma.y(), sigma.z(), r.text.c_str());
}

TEST(PivotRealRecordings, The1151PosesGiveThePublishedFiguresAndAreNotFitForNavigation) {
  BREGMA_SHARED_DATA(file, "tracker/pivot_optical/poses_1151.tgz");
  const auto poses = real_poses(file);
  ASSERT_EQ(poses.size(), 1151U);
  const PivotResult result = calibrate_pivot(poses);
  report("1,151 poses", result);
  EXPECT_EQ(rounded(result.least_squares.tip_mm.x(), 3), "-14.476");
  EXPECT_EQ(rounded(result.least_squares.tip_mm.y(), 3), "395.143");
  EXPECT_EQ(rounded(result.least_squares.tip_mm.z(), 3), "-7.558");
  EXPECT_EQ(rounded(result.least_squares.rms_mm, 3), "3.184");
  EXPECT_EQ(rounded(result.least_squares.worst_mm, 1), "12.3");
  EXPECT_EQ(result.verdict, PivotVerdict::kResidualTooLarge);
  EXPECT_EQ(result.text.rfind("not fit for navigation: RMS ", 0), 0U) << result.text;
}

TEST(PivotRealRecordings, TheHalvesOfThe1151PosesAgreeWithinTheReportedCovariance) {
  BREGMA_SHARED_DATA(file, "tracker/pivot_optical/poses_1151.tgz");
  const auto poses = real_poses(file);
  const std::size_t middle = poses.size() / 2;
  const PivotResult first = calibrate_pivot(std::span(poses).first(middle));
  const PivotResult second = calibrate_pivot(std::span(poses).subspan(middle));
  const PivotResult whole = calibrate_pivot(poses);
  report("first half", first);
  report("second half", second);
  const Vector3d apart = first.tip_mm - second.tip_mm;
  const double separately = mahalanobis_squared(apart, first.covariance_mm2 + second.covariance_mm2);
  // Covariance of the whole recording: each half has twice its variance, and the difference of two halves four times.
  const double of_whole =
      mahalanobis_squared(whole.half_tips_mm[0] - whole.half_tips_mm[1], 4.0 * whole.covariance_mm2);
  std::printf("halves %.2f mm apart (least squares %.2f): squared Mahalanobis distance %.2f by their own covariances, "
              "%.2f by that of the whole; 95 %% bound %.2f\n",
              apart.norm(), (first.least_squares.tip_mm - second.least_squares.tip_mm).norm(), separately, of_whole,
              kChiSquare95);
  EXPECT_GT(apart.norm(), 3.0);
  EXPECT_LT(separately, kChiSquare95);
  EXPECT_LT(of_whole, kChiSquare95);
  // A covariance must not be so large that it agrees with everything.
  EXPECT_LT(std::sqrt(whole.covariance_mm2.trace()), 2.5);
}

TEST(PivotRealRecordings, The57PosesGiveThePublishedFiguresAndAreNotFitForNavigation) {
  BREGMA_SHARED_DATA(folder, "tracker/pivot_optical/subset_57/tests/data/PivotCalibration");
  const auto poses = real_poses(folder);
  ASSERT_EQ(poses.size(), 57U);
  const PivotResult result = calibrate_pivot(poses);
  report("57 poses", result);
  EXPECT_EQ(rounded(result.least_squares.rms_mm, 4), "3.0496");
  EXPECT_EQ(rounded(result.least_squares.rms_component_mm, 4), "1.7607");
  EXPECT_EQ(rounded(result.least_squares.tip_mm.y(), 3), "394.634");
  EXPECT_EQ(result.verdict, PivotVerdict::kResidualTooLarge);
}

} // namespace
