// Pivot calibration: where a tool's tip lies in its body, from poses recorded while the tip rests in a fixed dimple.
//
// Every pose (R_i, t_i) sees the tip p (in the tool) at the pivot c (in the fixed frame): R_i p + t_i = c + e_i.
// Plain least squares over all poses is the published method (algebraic one step: Yaniv, "Which pivot calibration?",
// SPIE 9415, 2015) and is always reported. The tip that is given out comes from an MM-type estimate: a start that
// tolerates outliers, then iteratively reweighted least squares with Tukey's biweight.
//
// The covariance is not the one of independent residuals: poses a few milliseconds apart share their error, and a
// tracker's error varies over its volume. It is the larger, in every direction, of a delete-a-block jackknife over
// blocks of time and of what the halves of the recording show against each other.
//
// Pure functions; any thread. Poses in order of time. A few thousand poses take a few milliseconds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::calibration {

// Fixed is the frame that the dimple rests in: the tracker, or better the reference.
using ToolPose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Tool>;

struct PivotPose {
  std::int64_t time_ns = 0;
  ToolPose T_fixed_tool;
};

struct PivotOptions {
  std::size_t min_poses = 50;
  double min_rotation_rad = 0.35; // about each of two axes: 20 degrees
  double tracker_noise_mm = 0.25; // 1 sigma of one coordinate of a tracked marker
  double max_noise_ratio = 4.0;   // RMS of the residuals above so many times the noise is not fit for navigation
  double max_outlier_share = 0.2;
};

enum class PivotVerdict { kAccepted, kTooFewPoses, kStatic, kTooLittleRotation, kTooManyOutliers, kResidualTooLarge };

struct PivotFit {
  geometry::Vector3d tip_mm = geometry::Vector3d::Zero();   // in the tool
  geometry::Vector3d pivot_mm = geometry::Vector3d::Zero(); // in the fixed frame
  double rms_mm = 0.0;                                      // of the distances |e_i|, over the poses that take part
  double rms_component_mm = 0.0;                            // over their 3n coordinates: rms_mm / sqrt(3)
  double worst_mm = 0.0;
};

struct PivotResult {
  PivotVerdict verdict = PivotVerdict::kTooFewPoses;
  std::string text; // the verdict for a person, with the figures that decided it
  // Meaningful unless the verdict is one of kTooFewPoses, kStatic, kTooLittleRotation.
  geometry::Vector3d tip_mm = geometry::Vector3d::Zero();
  geometry::Matrix3d covariance_mm2 = geometry::Matrix3d::Zero(); // of tip_mm, in the tool's frame
  geometry::Vector3d pivot_mm = geometry::Vector3d::Zero();
  double rms_mm = 0.0;   // of the inliers about the robust estimate
  double worst_mm = 0.0; // of all poses about the robust estimate
  std::size_t poses = 0;
  std::size_t outliers = 0;
  PivotFit least_squares; // all poses, weight one
  // Rotation of the tool, as the range of its rotation vectors about the mean along their two widest axes.
  double rotation_rad[2] = {0.0, 0.0};
  // The same estimate from the first and the second half of the recording.
  geometry::Vector3d half_tips_mm[2] = {geometry::Vector3d::Zero(), geometry::Vector3d::Zero()};
  double halves_apart_mm = 0.0;

  [[nodiscard]] bool accepted() const { return verdict == PivotVerdict::kAccepted; }
};

// Weight one for every pose. Needs at least three poses that differ in rotation; otherwise the fit is not finite.
[[nodiscard]] PivotFit fit_pivot_least_squares(std::span<const PivotPose> poses);

[[nodiscard]] PivotResult calibrate_pivot(std::span<const PivotPose> poses, const PivotOptions &options = {});

} // namespace bregma::calibration
