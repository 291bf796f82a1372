#include <cmath>
#include <numbers>
#include <string>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/robot/inverse_kinematics.hpp"
#include "tests/unit/algorithms/tables.hpp"
#include "tests/unit/robot/arms.hpp"

namespace bregma::robot {
namespace {

using geometry::kRadiansPerDegree;

double apart_rad(const JointAngles &a, const JointAngles &b) {
  double out = 0.0;
  for (Eigen::Index i = 0; i < a.size(); ++i) {
    out = std::max(out, std::abs(std::remainder(a[i] - b[i], 2.0 * std::numbers::pi)));
  }
  return out;
}

bool contains(const InverseResult &result, const JointAngles &joints, double tolerance_rad) {
  for (const ArmSolution &solution : result.all()) {
    if (apart_rad(solution.joints, joints) < tolerance_rad) {
      return true;
    }
  }
  return false;
}

TEST(ArmModel, GivesTheRealPosesOfTheTeachPendant) {
  const std::filesystem::path file =
      std::filesystem::path(BREGMA_SOURCE_DIR) / "../shared/data/robot/mz07f_teach_pendant.csv";
  if (!std::filesystem::exists(file)) {
    GTEST_SKIP() << file << " is not here";
  }
  const ArmModel arm = test::mz07f();
  const InverseKinematics inverse(arm);
  const auto rows = test::read_table(file, 2);
  ASSERT_EQ(rows.size(), 4U);
  for (const auto &row : rows) {
    JointAngles joints;
    for (Eigen::Index i = 0; i < 6; ++i) {
      joints[i] = kRadiansPerDegree * row[static_cast<std::size_t>(i)];
    }
    const auto turn = [&row](std::size_t column, const Vector3d &axis) {
      return Eigen::Quaterniond(Eigen::AngleAxisd(kRadiansPerDegree * row[column], axis));
    };
    const FlangePose shown(turn(9, Vector3d::UnitZ()) * turn(10, Vector3d::UnitY()) * turn(11, Vector3d::UnitX()),
                           {row[6], row[7], row[8]});
    const FlangePose computed = arm.forward(joints);
    EXPECT_LT((computed.translation() - shown.translation()).norm(), 0.07);
    EXPECT_LT(geometry::angle_between(computed.rotation(), shown.rotation()), 0.013 * kRadiansPerDegree);
    EXPECT_FALSE(arm.beyond_limits(joints));
    // Back to the pendant's own joint angles.
    const auto nearest = inverse.nearest(shown, joints);
    ASSERT_TRUE(nearest);
    EXPECT_LT((nearest->joints - joints).cwiseAbs().maxCoeff(), 0.05 * kRadiansPerDegree);
  }
}

TEST(ArmModel, JacobianAgreesWithDifferences) {
  const ArmModel arm = test::mz07f();
  std::mt19937 rng(1);
  constexpr double kStep = 1e-6;
  for (int run = 0; run < 20; ++run) {
    const JointAngles joints = test::random_joints(arm, rng);
    const Matrix6d J = arm.jacobian(joints);
    const Vector3d tool(10.0, -20.0, 150.0); // in the flange
    const Vector3d point = arm.forward(joints) * tool;
    for (Eigen::Index i = 0; i < 6; ++i) {
      const JointAngles step = kStep * JointAngles::Unit(i);
      const Vector3d moved = (arm.forward(joints + step) * tool - arm.forward(joints - step) * tool) / (2.0 * kStep);
      EXPECT_LT((geometry::point_jacobian(point) * J.col(i) - moved).norm(), 1e-5);
    }
  }
}

TEST(ArmModel, KeepsJointsWithinTheirLimitsAndNearTheReference) {
  const ArmModel arm = test::mz07f();
  JointAngles joints = JointAngles::Zero();
  joints[3] = -175.0 * kRadiansPerDegree;
  joints[5] = 20.0 * kRadiansPerDegree;
  JointAngles reference = JointAngles::Zero();
  reference[3] = 180.0 * kRadiansPerDegree;
  reference[5] = -300.0 * kRadiansPerDegree;
  const auto turned = arm.turned_near(joints, reference);
  ASSERT_TRUE(turned);
  EXPECT_NEAR((*turned)[3], 185.0 * kRadiansPerDegree, 1e-12);
  EXPECT_NEAR((*turned)[5], -340.0 * kRadiansPerDegree, 1e-12);
  joints[4] = 130.0 * kRadiansPerDegree;
  EXPECT_FALSE(arm.turned_near(joints, reference));
  EXPECT_EQ(arm.beyond_limits(joints), 4U);
}

TEST(InverseKinematics, FindsTheJointsOfRandomPosesInEveryBranch) {
  const ArmModel arm = test::mz07f();
  const InverseKinematics inverse(arm);
  std::mt19937 rng(20261129);
  int singular = 0;
  for (int run = 0; run < 5000; ++run) {
    const JointAngles joints = test::random_joints(arm, rng);
    const FlangePose pose = arm.forward(joints);
    const InverseResult result = inverse.solve(pose, joints);
    ASSERT_EQ(result.status, InverseStatus::kSolved) << run;
    for (const ArmSolution &solution : result.all()) {
      singular += solution.singular() ? 1 : 0;
      ASSERT_LT((arm.forward(solution.joints).translation() - pose.translation()).norm(), 1e-9) << run;
      ASSERT_LT(geometry::angle_between(arm.forward(solution.joints).rotation(), pose.rotation()), 1e-11) << run;
    }
    ASSERT_TRUE(contains(result, joints, 1e-6)) << run;
    const auto nearest = inverse.nearest(pose, joints);
    ASSERT_TRUE(nearest);
    ASSERT_LT((nearest->joints - joints).cwiseAbs().maxCoeff(), 1e-6) << run;
  }
  EXPECT_LT(singular, 20);
}

// An independent search: Newton's method from random joints finds no solution that is not among the branches.
TEST(InverseKinematics, MissesNoSolutionThatASearchFinds) {
  const ArmModel arm = test::mz07f();
  const InverseKinematics inverse(arm);
  std::mt19937 rng(3);
  int found = 0;
  for (int run = 0; run < 40; ++run) {
    const FlangePose pose = arm.forward(test::random_joints(arm, rng));
    const InverseResult result = inverse.solve(pose);
    for (int start = 0; start < 40; ++start) {
      JointAngles joints = std::numbers::pi * JointAngles::Random();
      Vector6d left = Vector6d::Ones();
      for (int step = 0; step < 60 && left.norm() > 1e-10; ++step) {
        const FlangePose now = arm.forward(joints);
        const Eigen::Quaterniond turn = pose.rotation() * now.rotation().conjugate();
        left << geometry::rotation_log(turn), pose.translation() - turn * now.translation();
        joints += arm.jacobian(joints).partialPivLu().solve(left);
      }
      if (left.norm() <= 1e-10) {
        ++found;
        EXPECT_TRUE(contains(result, joints, 1e-5)) << run << ' ' << joints.transpose();
      }
    }
  }
  EXPECT_GT(found, 400);
}

TEST(InverseKinematics, NamesSingularPoses) {
  const ArmModel arm = test::mz07f();
  const InverseKinematics inverse(arm);
  JointAngles joints;
  joints << 0.3, 1.0, -0.5, 0.7, 0.0, 0.2; // axes 4 and 6 in line
  InverseResult result = inverse.solve(arm.forward(joints), joints);
  ASSERT_TRUE(contains(result, joints, 1e-6)); // the free joint keeps its angle
  EXPECT_TRUE(result.solutions[0].wrist_singular || result.solutions[result.count - 1].wrist_singular);

  // The elbow stretched: the forearm in line with the upper arm.
  joints << 0.3, 1.0, std::atan2(340.0, 45.0), 0.7, 0.9, 0.2;
  EXPECT_LT(inverse.distance_to_singularity(joints).elbow_rad, 1e-9);
  result = inverse.solve(arm.forward(joints), joints);
  ASSERT_EQ(result.status, InverseStatus::kSolved);
  EXPECT_TRUE(contains(result, joints, 1e-5));
  EXPECT_TRUE(std::any_of(result.all().begin(), result.all().end(),
                          [](const ArmSolution &solution) { return solution.elbow_singular; }));

  // The wrist's centre above the base: any angle of joint 1 will do, and the reference's is kept.
  const auto lever = [](double q2, double q3) {
    return 50.0 + 330.0 * std::cos(q2) + 45.0 * std::cos(q2 + q3) + 340.0 * std::sin(q2 + q3);
  };
  double low = 1.6;
  double high = 3.1;
  ASSERT_LT(lever(high, 0.2) * lever(low, 0.2), 0.0);
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (lever(middle, 0.2) * lever(high, 0.2) > 0.0 ? high : low) = middle;
  }
  joints << -0.8, low, 0.2, 0.7, 0.9, 0.2;
  EXPECT_LT(inverse.distance_to_singularity(joints).shoulder_mm, 1e-9);
  result = inverse.solve(arm.forward(joints), joints);
  ASSERT_EQ(result.status, InverseStatus::kSolved);
  EXPECT_TRUE(std::all_of(result.all().begin(), result.all().end(),
                          [](const ArmSolution &solution) { return solution.shoulder_singular; }));
}

TEST(InverseKinematics, StatesByHowMuchAPoseIsOutOfReach) {
  const ArmModel arm = test::mz07f();
  const InverseKinematics inverse(arm);
  // The wrist's centre straight ahead of joint 2: reach is 330 + hypot(45, 340).
  const double reach = 50.0 + 330.0 + std::hypot(45.0, 340.0);
  const Eigen::Quaterniond ahead(Eigen::AngleAxisd(0.5 * std::numbers::pi, Vector3d::UnitY()));
  InverseResult result = inverse.solve({ahead, {reach + 78.0 + 12.5, 0.0, 355.0}});
  EXPECT_EQ(result.status, InverseStatus::kTooFar);
  EXPECT_NEAR(result.missing_mm, 12.5, 1e-6);
  EXPECT_EQ(inverse.solve({ahead, {reach + 78.0 - 0.5, 0.0, 355.0}}).status, InverseStatus::kSolved);
  EXPECT_EQ(inverse.solve({ahead, Vector3d::Constant(std::nan(""))}).status, InverseStatus::kInvalidPose);
  EXPECT_FALSE(inverse.nearest({ahead, {2000.0, 0.0, 355.0}}, JointAngles::Zero()));
}

TEST(InverseKinematics, StatesByHowMuchAPoseIsTooNear) {
  // Axes 1 and 2 meet, so that both shoulder branches are equally far.
  constexpr double kRight = 0.5 * std::numbers::pi;
  const std::array<DhRow, kJoints> rows{{{355.0, kRight, 0.0, 0.0},
                                         {0.0, 0.0, 330.0, 0.0},
                                         {0.0, kRight, 45.0, 0.0},
                                         {340.0, -kRight, 0.0, 0.0},
                                         {0.0, kRight, 0.0, 0.0},
                                         {78.0, 0.0, 0.0, 0.0}}};
  const InverseKinematics inverse(ArmModel::from_dh("arm", rows, test::mz07f().limits()));
  const Eigen::Quaterniond ahead(Eigen::AngleAxisd(kRight, Vector3d::UnitY()));
  const InverseResult result = inverse.solve({ahead, {5.0 + 78.0, 0.0, 355.0}});
  EXPECT_EQ(result.status, InverseStatus::kTooNear);
  EXPECT_NEAR(result.missing_mm, std::hypot(45.0, 340.0) - 330.0 - 5.0, 1e-6);
}

TEST(InverseKinematics, RefusesOtherArmsByReason) {
  const ArmModel arm = test::mz07f();
  auto axes = arm.axes_at_zero();
  axes[4].point_mm += Vector3d(0.0, 0.0, 5.0) + Vector3d(5.0, 0.0, 0.0);
  const auto refusal = [&](const std::array<JointAxis, kJoints> &wrong) -> std::string {
    try {
      const InverseKinematics inverse(ArmModel("arm", wrong, arm.limits(), arm.flange_at_zero()));
    } catch (const std::invalid_argument &problem) {
      return problem.what();
    }
    return "";
  };
  EXPECT_EQ(refusal(axes), "arm: axes 4, 5 and 6 do not meet in one point");
  axes = arm.axes_at_zero();
  axes[1].direction = Vector3d(0.0, -1.0, 0.1).normalized();
  EXPECT_EQ(refusal(axes), "arm: axes 2 and 3 are not parallel");
}

} // namespace
} // namespace bregma::robot
