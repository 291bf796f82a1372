// The optimisers on a function whose maximum is known.
#include <cmath>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "algorithms/intensity/pose_optimiser.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"

namespace bregma::intensity {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

const Vector3d kCentre(10.0, -20.0, 30.0);

// Minus the mean squared distance between places under the map and under the true one, stretched along an axis.
class Distance final : public SimilarityMeasure {
public:
  explicit Distance(const Matrix4d &truth) : truth_(truth) {}
  double value(const Matrix4d &T) noexcept override {
    AffineGradient unused;
    return value_and_gradient(T, unused);
  }
  [[nodiscard]] bool has_gradient() const noexcept override { return true; }
  double value_and_gradient(const Matrix4d &T, AffineGradient &gradient) noexcept override {
    gradient.setZero();
    double sum = 0.0;
    for (unsigned corner = 0; corner < 8; ++corner) {
      const Vector3d p = kCentre + Vector3d((corner & 1U) != 0 ? 50 : -50, (corner & 2U) != 0 ? 40 : -40,
                                            (corner & 4U) != 0 ? 30 : -30);
      const Vector3d weight(1.0, 20.0, 5.0);
      const Vector3d apart = ((T - truth_) * p.homogeneous()).head<3>();
      sum -= apart.dot(weight.cwiseProduct(apart));
      gradient -= 2.0 * weight.cwiseProduct(apart) * p.homogeneous().transpose();
    }
    return sum;
  }
  [[nodiscard]] std::size_t samples() const noexcept override { return 8; }

private:
  Matrix4d truth_;
};

TEST(PoseOptimiser, BothMethodsFindAKnownRigidPose) {
  const Matrix4d truth = test::pose({8, -5, 12}, {7, -3, 11});
  Distance measure(truth);
  OptimiserOptions options;
  options.centre_mm = kCentre;
  options.tolerance_mm = 1e-4;
  const Optimum by_gradient = maximise_by_gradient(measure, Matrix4d::Identity(), options);
  EXPECT_LT((by_gradient.T_floating_reference - truth).norm(), 1e-2);
  EXPECT_LT(by_gradient.evaluations, 80);
  options.max_iterations = 120;
  const Optimum by_lines = maximise_by_lines(measure, Matrix4d::Identity(), options);
  EXPECT_LT((by_lines.T_floating_reference - truth).norm(), 5e-2);
}

TEST(PoseOptimiser, TwelveParametersFindScalesAndShears) {
  Matrix4d truth = test::pose({3, 2, -4}, {2, 5, -3});
  truth.topLeftCorner<3, 3>() *= Eigen::Vector3d(1.05, 0.97, 1.02).asDiagonal();
  truth(0, 1) += 0.03;
  Distance measure(truth);
  OptimiserOptions options;
  options.parameters = 12;
  options.centre_mm = kCentre;
  options.tolerance_mm = 1e-4;
  options.max_iterations = 200;
  EXPECT_LT((maximise_by_gradient(measure, Matrix4d::Identity(), options).T_floating_reference - truth).norm(), 2e-2);
}

TEST(PoseOptimiser, GradientOfAStepIsThatOfDifferences) {
  Distance measure(test::pose({8, -5, 12}, {7, -3, 11}));
  const Matrix4d T = test::pose({-4, 9, 2}, {1, 2, 3});
  AffineGradient by_affine;
  (void)measure.value_and_gradient(T, by_affine);
  for (const int parameters : {6, 12}) {
    const Step gradient = step_gradient(by_affine, T, kCentre, parameters);
    for (int i = 0; i < parameters; ++i) {
      Step step = Step::Zero(parameters);
      step[i] = 1e-4;
      const double difference =
          (measure.value(T * motion_of(step, kCentre)) - measure.value(T * motion_of(-step, kCentre))) / 2e-4;
      EXPECT_NEAR(gradient[i], difference, 1e-5 * gradient.norm()) << i;
    }
  }
}

} // namespace
} // namespace bregma::intensity
