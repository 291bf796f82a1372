#include "server/stages/navigation/hand_eye_check.hpp"

#include <cstdio>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/calibration/hand_eye.hpp"
#include "server/stages/pose_history.hpp"

namespace bregma::server {
namespace {

using geometry::Matrix6d;
using geometry::Rigid3;
using geometry::UncertainPose;
using geometry::Vector3d;
using geometry::frame::RobotBase;
using geometry::frame::RobotFlange;
using geometry::frame::Tool;
using geometry::frame::Tracker;

constexpr unsigned kSeed = 4;
constexpr double kChiSquare95 = 12.59; // of 6 degrees of freedom

Vector3d scatter(std::mt19937 &rng, double sigma) {
  std::normal_distribution<double> normal(0.0, sigma);
  const double x = normal(rng);
  const double y = normal(rng);
  return {x, y, normal(rng)};
}

// The errors of a device, independent in rotation and position of the origin.
template <class T> T measured(const T &pose, const calibration::PoseNoise &noise, std::mt19937 &rng) {
  const Vector3d turn = scatter(rng, noise.rotation_rad);
  return {geometry::rotation_exp(turn) * pose.rotation(), pose.translation() + scatter(rng, noise.position_mm)};
}

template <class A, class B> UncertainPose<A, B> stated(const Rigid3<A, B> &pose, const calibration::PoseNoise &noise) {
  Matrix6d own = Matrix6d::Zero();
  own.diagonal().head<3>().setConstant(noise.rotation_rad * noise.rotation_rad);
  own.diagonal().tail<3>().setConstant(noise.position_mm * noise.position_mm);
  Matrix6d about_origin = Matrix6d::Identity();
  about_origin.bottomLeftCorner<3, 3>() = geometry::skew(pose.translation());
  return {pose, about_origin * own * about_origin.transpose()};
}

constexpr std::int64_t kSeen_ns = 1'000; // exposure of every frame

struct HandEyeRoom {
  Rigid3<RobotFlange, Tool> X{geometry::rotation_exp({0.1, 0.2, -0.3}), {20.0, -35.0, 90.0}};
  Rigid3<RobotBase, Tracker> Y{geometry::rotation_exp({0.4, -0.2, 1.0}), {150.0, -300.0, 1400.0}};
  calibration::HandEyeOptions options;

  static Rigid3<RobotBase, RobotFlange> flange(std::mt19937 &rng) {
    const Vector3d turn = scatter(rng, 0.35);
    return {geometry::rotation_exp(turn), Vector3d(500.0, 0.0, 500.0) + scatter(rng, 90.0)};
  }
  [[nodiscard]] casefile::HandEyeModel calibrated(std::mt19937 &rng) const {
    std::vector<calibration::HandEyePair> pairs;
    for (int i = 0; i < 20; ++i) {
      const auto A = flange(rng);
      const auto B = Y.inverse() * A * X;
      pairs.push_back({measured(A.as<geometry::frame::Target, geometry::frame::Source>(), options.robot, rng),
                       measured(B.as<geometry::frame::Target, geometry::frame::Source>(), options.tracker, rng)});
    }
    const auto result = calibration::calibrate_hand_eye(pairs, options);
    EXPECT_TRUE(result.accepted()) << result.text;
    casefile::HandEyeModel out;
    out.T_flange_body.pose = result.X.as<RobotFlange, Tool>();
    out.T_base_tracker.pose = result.Y.as<RobotBase, Tracker>();
    out.joint = result.joint;
    return out;
  }
  // A pose of the arm at which the tracker, moved by this against the arm, sees the body.
  void look(HandEyeCheck &check, const casefile::HandEyeModel &model, const Vector3d &moved_mm,
            std::mt19937 &rng) const {
    const auto A = flange(rng);
    const auto B = Y.inverse() * A * X;
    const Rigid3<Tracker, Tool> seen(B.rotation(), B.translation() + moved_mm);
    check.add(model, stated(measured(A, options.robot, rng), options.robot),
              stated(measured(seen, options.tracker, rng), options.tracker), kSeen_ns);
  }
};

TEST(HandEyeCheck, ACalibrationWithinItsErrorPassesAsOftenAsStated) {
  const HandEyeRoom room;
  std::mt19937 rng(kSeed);
  constexpr int kRuns = 300;
  int within = 0;
  for (int run = 0; run < kRuns; ++run) {
    HandEyeCheck check;
    room.look(check, room.calibrated(rng), Vector3d::Zero(), rng);
    within += check.view().statistic <= kChiSquare95 ? 1 : 0;
  }
  std::printf("%d of %d within the 95 %% bound\n", within, kRuns);
  EXPECT_GE(within, 276); // 92 %
  EXPECT_LE(within, 296);
}

TEST(HandEyeCheck, AMovedTrackerIsFoundInThreeFramesAndTheCheckEndsAfterTen) {
  const HandEyeRoom room;
  std::mt19937 rng(kSeed);
  const casefile::HandEyeModel model = room.calibrated(rng);
  HandEyeCheck check;
  const auto look = [&](int frames, const Vector3d &moved_mm) {
    for (int i = 0; i < frames; ++i) {
      room.look(check, model, moved_mm, rng);
    }
    return check.disagrees();
  };
  EXPECT_EQ(check.view().checked_ns, 0);
  EXPECT_FALSE(look(1'000, Vector3d::Zero()));
  EXPECT_EQ(check.view().checked_ns, kSeen_ns);
  const Vector3d moved(2.0, 1.0, -1.0);
  EXPECT_FALSE(look(2, moved));
  EXPECT_TRUE(look(1, moved));
  EXPECT_NEAR(check.view().distance_mm, moved.norm(), 1.5);
  EXPECT_TRUE(look(9, Vector3d::Zero()));
  EXPECT_FALSE(look(1, Vector3d::Zero()));
  EXPECT_FALSE(look(2, Vector3d::Constant(std::nan(""))));
  EXPECT_TRUE(look(1, Vector3d::Constant(std::nan("")))) << "what is not finite does not agree";
}

TEST(PoseHistory, InterpolatesBetweenMeasurementsAndKnowsNothingInAGap) {
  PoseHistory<RobotBase, RobotFlange, 4> history;
  EXPECT_FALSE(history.at(0));
  const auto add = [&](std::int64_t ms, double x_mm) {
    history.add({ms * 1'000'000,
                 500'000,
                 10'000'000,
                 {{geometry::rotation_exp({0.0, 0.0, 0.01 * x_mm}), Vector3d(x_mm, 0.0, 0.0)}, Matrix6d::Identity()}});
  };
  add(0, 0.0);
  add(10, 2.0);
  add(20, 6.0);
  const auto between = history.at(15'000'000);
  ASSERT_TRUE(between);
  EXPECT_NEAR(between->pose.translation().x(), 4.0, 1e-12);
  EXPECT_NEAR(geometry::rotation_log(between->pose.rotation()).z(), 0.04, 1e-12);
  // Half a millisecond of a motion of 0.4 mm/ms and 0.004 rad/ms.
  EXPECT_NEAR(between->covariance(2, 2), 1.0 + std::pow(0.002, 2), 1e-9);
  EXPECT_FALSE(history.at(-1)) << "before the first";
  EXPECT_FALSE(history.at(20'000'001)) << "after the last";
  EXPECT_FALSE(history.reaches(20'000'001));
  add(15, 9.0); // late: ignored
  EXPECT_EQ(history.newest()->time_ns, 20'000'000);
  add(51, 8.0);
  EXPECT_FALSE(history.at(30'000'000)) << "more than three periods";
  EXPECT_TRUE(history.at(20'000'000));
  add(61, 9.0); // the first is forgotten
  EXPECT_FALSE(history.at(5'000'000));
  EXPECT_TRUE(history.at(12'000'000));
}

} // namespace
} // namespace bregma::server
