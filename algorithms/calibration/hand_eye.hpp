// Hand-eye calibration: where a tracked body sits on a robot's flange, and where the robot's base stands in the
// tracker.
//
// Two forms [Shiu 1989] [Zhuang 1994]:
//   A X = X B   motions A of the flange and B of the tracked body, both seen from where they started;
//   A X = Y B   absolute poses: A = T_base_flange, X = T_flange_body, Y = T_base_tracker, B = T_tracker_body.
// Start in closed form: the rotation from the motions' rotation vectors [Park 1994], then the translations by linear
// least squares. Then maximum likelihood by Gauss-Newton on the twists log(A X (Y B)^-1), with the errors of both
// devices propagated (left perturbations, geometry/pose_covariance.hpp). The covariance is that of the likelihood;
// it holds where the stated errors do, which the residuals test.
//
// Observability: motions without rotation leave the position free, rotations about parallel axes the position along
// them. Such motions are refused by name.
//
// Pure functions; any thread; hundreds of poses take milliseconds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::calibration {

using HandEyePose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

// A is the robot's, B the tracker's.
struct HandEyePair {
  HandEyePose A, B;
};

// Errors of one pose, 1 sigma per coordinate, independent: of its rotation, and of the position of its origin.
struct PoseNoise {
  double rotation_rad = 0.0;
  double position_mm = 0.0;
};

struct HandEyeOptions {
  PoseNoise robot{1.7e-4, 0.05};   // 0.01 degrees
  PoseNoise tracker{1.7e-3, 0.15}; // 0.1 degrees
  double min_rotation_rad = 0.17;  // about each of two axes: 10 degrees
  double max_sigma_mm = 5.0;       // worst direction of X's or Y's position; above it the motion does not fix them
  double min_p_value = 1e-6;       // of the residuals, if the stated errors hold
};

enum class HandEyeVerdict : std::uint8_t {
  kAccepted,
  kTooFewPoses,    // three motions or four poses are needed
  kInvalidPose,    // not finite
  kNoRotation,     // degenerate: only translations
  kOneAxis,        // degenerate: rotations about parallel axes
  kPoorlyObserved, // the predicted error exceeds max_sigma_mm
  kNotConverged,
  kFitsBadly // the residuals are larger than stated: wrong pairs, a body that moved, or too small errors
};

struct HandEyeResult {
  HandEyeVerdict verdict = HandEyeVerdict::kTooFewPoses;
  std::string text;       // the verdict as a sentence, with the figures that decided it
  bool estimated = false; // X, Y and what follows are valid
  HandEyePose X, Y;       // Y equals X for motions
  // Left perturbations of X and Y, rotation first. X's come first in `joint`; zero beyond it for motions.
  geometry::Matrix6d covariance_X = geometry::Matrix6d::Zero(), covariance_Y = geometry::Matrix6d::Zero();
  Eigen::Matrix<double, 12, 12> joint = Eigen::Matrix<double, 12, 12>::Zero();
  std::size_t pairs = 0;
  double rotation_rad[2] = {0.0, 0.0};                  // range of the flange's rotations about their two widest axes
  double rms_rotation_rad = 0.0, rms_position_mm = 0.0; // of the residuals, at the tracked body; a consistency
  double chi_square = 0.0, p_value = 0.0;

  [[nodiscard]] bool accepted() const { return verdict == HandEyeVerdict::kAccepted; }
};

// Motions: pairs with independent errors, each relative to the same start or to any other pose.
[[nodiscard]] HandEyeResult calibrate_hand_eye_motions(std::span<const HandEyePair> motions,
                                                       const HandEyeOptions &options = {});
// Absolute poses of the same instants.
[[nodiscard]] HandEyeResult calibrate_hand_eye(std::span<const HandEyePair> poses, const HandEyeOptions &options = {});

} // namespace bregma::calibration
