// Hand-eye and beam calibration on simulated devices: coverage of the covariance, degenerate motions by name.
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "algorithms/geometry/angles.hpp"
#include "bench/robot/calibration_scenes.hpp"

namespace bregma::bench {
namespace {

using calibration::BeamVerdict;
using calibration::HandEyeVerdict;
using geometry::kRadiansPerDegree;

TEST(HandEye, IsExactWithoutNoise) {
  HandEyeScene scene;
  scene.options.robot = {1e-9, 1e-6};
  scene.options.tracker = {1e-9, 1e-6};
  std::mt19937 rng(1);
  const auto result = calibration::calibrate_hand_eye(scene.poses(20, rng), scene.options);
  ASSERT_TRUE(result.accepted()) << result.text;
  EXPECT_LT((result.X.matrix() - scene.X.matrix()).cwiseAbs().maxCoeff(), 1e-4);
  EXPECT_LT((result.Y.matrix() - scene.Y.matrix()).cwiseAbs().maxCoeff(), 1e-4);
  const auto motions = calibration::calibrate_hand_eye_motions(scene.motions(20, rng), scene.options);
  ASSERT_TRUE(motions.accepted()) << motions.text;
  EXPECT_LT((motions.X.matrix() - scene.X.matrix()).cwiseAbs().maxCoeff(), 1e-4);
}

// Full samples: ./dev bench robot --only calibration.
TEST(HandEye, ErrorsAgreeWithTheCovariance) {
  const HandEyeScene scene;
  const auto absolute = hand_eye_coverage(scene, true, 20, 200, 2);
  EXPECT_EQ(absolute.refused, 0);
  EXPECT_GE(absolute.percent_within, 90.0);
  EXPECT_LE(absolute.percent_within, 99.0);
  const auto motions = hand_eye_coverage(scene, false, 20, 200, 3);
  EXPECT_EQ(motions.refused, 0);
  EXPECT_GE(motions.percent_within, 90.0);
  EXPECT_LE(motions.percent_within, 99.0);
}

TEST(HandEye, RefusesDegenerateMotionsByName) {
  HandEyeScene scene;
  std::mt19937 rng(4);
  const auto verdict = [&scene](const std::vector<calibration::HandEyePair> &poses) {
    return calibration::calibrate_hand_eye(poses, scene.options).verdict;
  };
  EXPECT_EQ(verdict(scene.poses(3, rng)), HandEyeVerdict::kTooFewPoses);
  scene.turn_rad = {0.0, 0.0, 0.0};
  EXPECT_EQ(verdict(scene.poses(20, rng)), HandEyeVerdict::kNoRotation);
  scene.turn_rad = {0.0, 0.0, 0.6};
  const auto one_axis = calibration::calibrate_hand_eye(scene.poses(20, rng), scene.options);
  EXPECT_EQ(one_axis.verdict, HandEyeVerdict::kOneAxis);
  EXPECT_NE(one_axis.text.find("about one axis"), std::string::npos) << one_axis.text;
  scene.turn_rad = {0.6, 0.6, 0.6};
  auto poses = scene.poses(20, rng);
  std::rotate(poses.begin(), poses.begin() + 1, poses.end());
  for (std::size_t i = 0; i + 1 < poses.size(); ++i) { // each tracker pose with the robot's next one
    poses[i].B = poses[i + 1].B;
  }
  EXPECT_NE(verdict(poses), HandEyeVerdict::kAccepted);
  poses = scene.poses(20, rng);
  poses[3].A = calibration::HandEyePose(Eigen::Quaterniond::Identity(), Eigen::Vector3d::Constant(std::nan("")));
  EXPECT_EQ(verdict(poses), HandEyeVerdict::kInvalidPose);
}

TEST(Beam, IsFoundFromPlaneAndSphereWithoutNoise) {
  for (const auto body : {calibration::BeamBody::kPlane, calibration::BeamBody::kSphere}) {
    BeamScene scene;
    scene.options.body = body;
    scene.options.range_sigma_mm = 1e-6;
    scene.options.robot_sigma_mm = 1e-6;
    std::mt19937 rng(5);
    const auto result = calibration::calibrate_beam(scene.readings(150, rng), scene.options);
    ASSERT_TRUE(result.accepted()) << result.text;
    EXPECT_LT((result.beam.origin_mm - scene.beam.origin_mm).norm(), 1e-4);
    EXPECT_LT((result.beam.direction - scene.beam.direction).norm(), 1e-6);
  }
}

TEST(Beam, ErrorsAgreeWithTheCovariance) {
  BeamScene scene;
  const auto plane = beam_coverage(scene, 200, 100, 6);
  EXPECT_EQ(plane.refused, 0);
  EXPECT_GE(plane.percent_within, 88.0);
  scene.options.body = calibration::BeamBody::kSphere;
  const auto sphere = beam_coverage(scene, 200, 100, 7);
  EXPECT_EQ(sphere.refused, 0);
  EXPECT_GE(sphere.percent_within, 88.0);
}

TEST(Beam, RefusesDegenerateScansByName) {
  BeamScene scene;
  std::mt19937 rng(8);
  const auto verdict = [&](std::size_t count = 150) {
    return calibration::calibrate_beam(scene.readings(count, rng), scene.options).verdict;
  };
  EXPECT_EQ(verdict(10), BeamVerdict::kTooFewReadings);
  scene.turn_rad = {0.0, 0.0, 0.0};
  const auto fixed = calibration::calibrate_beam(scene.readings(150, rng), scene.options);
  EXPECT_EQ(fixed.verdict, BeamVerdict::kFixedOrientation);
  EXPECT_NE(fixed.text.find("kept its orientation"), std::string::npos) << fixed.text;
  scene.turn_rad = {0.5, 0.0, 0.0};
  EXPECT_EQ(verdict(), BeamVerdict::kOneAxis);
  scene.turn_rad = {0.4, 0.4, 0.4};
  scene.range_mm = {150.0, 150.5};
  scene.at_range = true;
  EXPECT_EQ(verdict(), BeamVerdict::kConstantRange);
  scene.at_range = false;
  scene.options.range_sigma_mm = 0.05; // ten times too small
  scene.noise_factor = 10.0;
  EXPECT_EQ(verdict(), BeamVerdict::kFitsBadly);
}

TEST(Beam, PointCovarianceCoversTheBeamsError) {
  const BeamScene scene;
  std::mt19937 rng(9);
  const auto readings = scene.readings(150, rng);
  const auto result = calibration::calibrate_beam(readings, scene.options);
  ASSERT_TRUE(result.accepted()) << result.text;
  const auto covariance = calibration::beam_point_covariance(result, readings[0], 0.5, 0.05);
  const Eigen::Vector3d along = readings[0].T_base_flange.rotation() * result.beam.direction;
  EXPECT_GT(along.dot(covariance * along), 0.25);
  const Eigen::Vector3d error =
      calibration::beam_point(result.beam, readings[0]) - calibration::beam_point(scene.beam, readings[0]);
  EXPECT_LT(error.dot(covariance.ldlt().solve(error)), 16.0);
}

} // namespace
} // namespace bregma::bench
