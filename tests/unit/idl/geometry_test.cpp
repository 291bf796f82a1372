#include <random>

#include <gtest/gtest.h>

#include "algorithms/geometry/pose_covariance.hpp"

namespace {

using namespace bregma::geometry;
using Pose = Rigid3<frame::Target, frame::Source>;
constexpr unsigned kSeed = 20260101;

Vector3d random_vector(std::mt19937 &rng, double scale) {
  std::normal_distribution<double> normal(0.0, scale);
  return {normal(rng), normal(rng), normal(rng)};
}

Pose random_pose(std::mt19937 &rng) { return {rotation_exp(random_vector(rng, 1.5)), random_vector(rng, 100.0)}; }

TEST(Rigid3, InverseAndCompositionAgreeWithMatrices) {
  std::mt19937 rng(kSeed);
  for (int i = 0; i < 100; ++i) {
    const Pose T = random_pose(rng);
    const auto U = random_pose(rng).as<frame::Source, frame::Tool>();
    EXPECT_TRUE((T * T.inverse()).matrix().isIdentity(1e-12));
    EXPECT_TRUE((T * U).matrix().isApprox(T.matrix() * U.matrix(), 1e-12));
    const Vector3d p = random_vector(rng, 100.0);
    EXPECT_TRUE(((T * U) * p).isApprox(T * (U * p), 1e-12));
  }
}

TEST(Rigid3, RotationVectorRoundTripsFromTinyToHalfATurn) {
  std::mt19937 rng(kSeed);
  for (const double angle : {0.0, 1e-12, 1e-8, 1e-5, 0.1, 1.0, 3.0, 3.14159}) {
    const Vector3d w = angle * random_vector(rng, 1.0).normalized();
    EXPECT_TRUE(rotation_log(rotation_exp(w)).isApprox(w, 1e-9) || (angle < 1e-9 && w.norm() < 1e-9)) << angle;
  }
}

// First-order propagation compared with the sampled covariance of the same perturbations.
TEST(UncertainPose, CompositionInverseAndPointsAgreeWithSampling) {
  std::mt19937 rng(kSeed);
  const Pose T = random_pose(rng);
  const auto U = random_pose(rng).as<frame::Source, frame::Tool>();
  Vector6d sigma;
  sigma << 1e-3, 2e-3, 1.5e-3, 0.2, 0.1, 0.3;
  const Matrix6d cov = sigma.cwiseAbs2().asDiagonal();
  const UncertainPose<frame::Target, frame::Source> A{T, cov};
  const UncertainPose<frame::Source, frame::Tool> B{U, 0.5 * cov};
  const Vector3d point(10.0, -20.0, 30.0);

  const auto perturbed = [&](const auto &pose, double scale) {
    std::normal_distribution<double> normal;
    Vector6d d;
    for (int i = 0; i < 6; ++i) {
      d[i] = scale * sigma[i] * normal(rng);
    }
    using P = std::decay_t<decltype(pose)>;
    const Eigen::Quaterniond q = rotation_exp(d.head<3>());
    return P(q * pose.rotation(), q * pose.translation() + d.tail<3>());
  };
  Matrix3d composed = Matrix3d::Zero();
  Matrix3d inverted = Matrix3d::Zero();
  constexpr int kRuns = 40'000;
  for (int i = 0; i < kRuns; ++i) {
    const Pose Ti = perturbed(T, 1.0);
    const Vector3d e = (Ti * perturbed(U, std::sqrt(0.5))) * point - (T * U) * point;
    const Vector3d f = Ti.inverse() * point - T.inverse() * point;
    composed += e * e.transpose() / kRuns;
    inverted += f * f.transpose() / kRuns;
  }
  const Matrix3d predicted = point_covariance(A * B, point);
  const Matrix3d predicted_inverse = point_covariance(inverse(A), point);
  EXPECT_LT((composed - predicted).norm(), 0.04 * predicted.norm());
  EXPECT_LT((inverted - predicted_inverse).norm(), 0.04 * predicted_inverse.norm());
}

} // namespace
