#include <gtest/gtest.h>

#include <cmath>

#include "algorithms/registration/clouds/cloud_covariance.hpp"
#include "algorithms/registration/clouds/cpd.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::registration {
namespace {

using Eigen::Vector3d;

constexpr unsigned kCloudSeed = 20261128;
constexpr double kNoise_mm = 0.5;
constexpr double kOutliers = 0.1;

// Random points in a ball, like markers. The pose is the identity.
geometry::Points3 scattered(int count, double radius_mm, std::mt19937 &rng) {
  geometry::Points3 out(3, count);
  std::uniform_real_distribution<double> cube(-radius_mm, radius_mm);
  for (int i = 0; i < count; ++i) {
    out.col(i) = Vector3d(cube(rng), cube(rng), cube(rng));
  }
  return out;
}

geometry::Points3 noisy(const geometry::Points3 &points, std::mt19937 &rng) {
  geometry::Points3 out = points;
  for (Eigen::Index i = 0; i < out.cols(); ++i) {
    out.col(i) += test::normal_vector(rng, kNoise_mm);
  }
  return out;
}

// With distant neighbours the correspondences are unique: the covariance is that of paired points.
TEST(CloudCovariance, MatchesPairedPointsForDistinctPoints) {
  std::mt19937 rng(kCloudSeed);
  const geometry::Points3 source = scattered(40, 80.0, rng);
  const auto covariance = cloud_pose_covariance(source, source, kNoise_mm, 1e-9);
  ASSERT_TRUE(covariance);
  geometry::Matrix6d information = geometry::Matrix6d::Zero();
  for (Eigen::Index i = 0; i < source.cols(); ++i) {
    const auto J = geometry::point_jacobian(source.col(i));
    information += J.transpose() * J / (kNoise_mm * kNoise_mm);
  }
  EXPECT_LT((*covariance * information - geometry::Matrix6d::Identity()).cwiseAbs().maxCoeff(), 1e-3);
}

// Neighbours 4 sigma apart: correspondences are ambiguous, but the true target error still lies in the predicted 95 %.
TEST(CloudCovariance, CoversTheTruePoseAtTheStatedRate) {
  std::mt19937 rng(kCloudSeed);
  const Vector3d target(0, 0, -60);
  constexpr int kRuns = 300;
  int inside = 0;
  double squared_true = 0.0;
  double squared_predicted = 0.0;
  for (int run = 0; run < kRuns; ++run) {
    const geometry::Points3 source = scattered(300, 10.0, rng);
    const geometry::Points3 targets = noisy(source, rng);
    CpdOptions options;
    options.outlier_weight = kOutliers;
    options.start_sigma_mm = 1.0;
    const CpdTransform<3> start;
    const auto found = register_cpd<3>(source, targets, options, &start);
    ASSERT_EQ(found.outcome, CpdOutcome::kConverged);
    const auto covariance =
        cloud_pose_covariance(found.transform * source, targets, found.sigma_mm,
                              outlier_constant<3>(targets, found.sigma_mm, kOutliers, source.cols()));
    ASSERT_TRUE(covariance);
    const Vector3d error = found.transform.linear * target + found.transform.translation - target;
    const geometry::Matrix3d predicted = uncertainty::tre_covariance(*covariance, target);
    inside +=
        uncertainty::mahalanobis_squared(predicted, error) <= uncertainty::chi_square_upper_quantile(0.05, 3) ? 1 : 0;
    squared_true += error.squaredNorm() / kRuns;
    squared_predicted += predicted.trace() / kRuns;
  }
  RecordProperty("inside_percent", std::to_string(100.0 * inside / kRuns));
  RecordProperty("rms_true_mm", std::to_string(std::sqrt(squared_true)));
  RecordProperty("rms_predicted_mm", std::to_string(std::sqrt(squared_predicted)));
  EXPECT_GT(inside, 0.91 * kRuns) << std::sqrt(squared_true) << " mm, predicted " << std::sqrt(squared_predicted);
  EXPECT_LT(inside, 0.99 * kRuns);
}

TEST(CloudCovariance, ASymmetricBallHasNoDeterminedRotation) {
  std::mt19937 rng(kCloudSeed);
  geometry::Points3 source(3, 2000);
  geometry::Points3 targets(3, 2000);
  for (Eigen::Index i = 0; i < 2000; ++i) {
    source.col(i) = 40.0 * test::normal_vector(rng, 1.0).normalized();
    targets.col(i) = 40.0 * test::normal_vector(rng, 1.0).normalized();
  }
  const auto covariance = cloud_pose_covariance(source, targets, 3.0, 1e-9);
  // With known correspondences 2,000 points of 3 mm would give a rotation error of 3 / 40 / sqrt(2000 * 2 / 3) = 0.002
  // rad.
  EXPECT_TRUE(!covariance || covariance->diagonal().head<3>().minCoeff() > std::pow(0.008, 2));
}

} // namespace
} // namespace bregma::registration
