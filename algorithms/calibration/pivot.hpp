// Pivot calibration: where a tool's tip lies in its body, from poses recorded while the tip rests in a fixed dimple.
//
// Every pose (R_i, t_i) sees the tip p (in the tool) at the pivot c (in the fixed frame): R_i p + t_i = c + e_i.
// Plain least squares over all poses is the published method (the algebraic one step of Yaniv, "Which pivot
// calibration?", SPIE 9415, 2015) and is always reported. The tip that is given out comes from an MM estimate (Yohai
// 1987): a start of least median of squares, then reweighted least squares with Tukey's biweight.
//
// The covariance is not the one of independent residuals: neighbouring poses share their error, and a tracker's error
// changes over its volume. It is a delete-a-block jackknife (Künsch 1989) over blocks of time, widened for the few
// blocks, so that its 95 % region holds 95 % for errors that stay correlated for less than a block.
//
// Pure functions; any thread; tens of milliseconds for a few thousand poses, so never inside a loop step.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::calibration {

// Target is the frame that the dimple rests in: the tracker's, or better the reference's.
using ToolPose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Tool>;

struct PivotPose {
  std::int64_t time_ns = 0;
  ToolPose T_fixed_tool;
};

struct PivotOptions {
  std::size_t min_poses = 50;
  double min_rotation_rad = 0.35; // about each of two axes: 20 degrees
  double tracker_noise_mm = 0.25; // 1 sigma of a coordinate of a tracked marker
  double max_noise_ratio = 4.0;   // RMS residual above so many times the noise: not fit for navigation
  double max_outlier_fraction = 0.2;
};

enum class PivotVerdict { kAccepted, kTooFewPoses, kStatic, kTooLittleRotation, kTooManyOutliers, kResidualTooLarge };

struct PivotFit {
  geometry::Vector3d tip_mm = geometry::Vector3d::Zero();   // in the tool
  geometry::Vector3d pivot_mm = geometry::Vector3d::Zero(); // in the fixed frame
  double rms_mm = 0.0;                                      // of |e_i|
  double rms_component_mm = 0.0;                            // of the 3n coordinates of e_i: rms_mm / sqrt(3)
  double worst_mm = 0.0;
};

struct PivotResult {
  PivotVerdict verdict = PivotVerdict::kTooFewPoses;
  std::string text;       // the verdict for a person, with the figures that decided it
  bool estimated = false; // false for kTooFewPoses, kStatic, kTooLittleRotation: then all that follows is zero
  geometry::Vector3d tip_mm = geometry::Vector3d::Zero();         // in the tool
  geometry::Matrix3d covariance_mm2 = geometry::Matrix3d::Zero(); // of tip_mm
  geometry::Vector3d pivot_mm = geometry::Vector3d::Zero();
  double rms_mm = 0.0;   // of the poses that are not outliers
  double worst_mm = 0.0; // of all poses
  std::size_t poses = 0;
  std::size_t outliers = 0; // poses beyond four robust sigmas
  PivotFit least_squares;   // of all poses, outliers included
  // How far the tool was turned about its two widest axes (98 % of the poses).
  double rotation_rad[2] = {0.0, 0.0};
  geometry::Vector3d half_tips_mm[2] = {geometry::Vector3d::Zero(), geometry::Vector3d::Zero()}; // first, second half
  double halves_apart_mm = 0.0;

  [[nodiscard]] bool accepted() const { return verdict == PivotVerdict::kAccepted; }
};

// Weight one for every pose. NaN throughout when the poses do not fix the tip (fewer than three, or turned about one
// axis only).
[[nodiscard]] PivotFit fit_pivot_least_squares(std::span<const PivotPose> poses);

// Poses in the order of time, all finite.
[[nodiscard]] PivotResult calibrate_pivot(std::span<const PivotPose> poses, const PivotOptions &options = {});

} // namespace bregma::calibration
