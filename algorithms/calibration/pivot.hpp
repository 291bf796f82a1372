// Pivot calibration: the position of a tool's tip in its body, from poses recorded while the tip rests in a fixed
// dimple.
//
// Every pose (R_i, t_i) maps the tip p (in the tool) to the pivot c (in the fixed frame): R_i p + t_i = c + e_i.
// Plain least squares over all poses, the algebraic one-step method of [Yaniv 2015], is always reported. The resulting
// tip comes from an MM estimate [Yohai 1987]: a start by least median of squares, then reweighted least squares with
// Tukey's biweight.
//
// The covariance does not assume independent residuals: neighbouring poses share their error, and a tracker's error
// changes over its volume. It is a delete-a-block jackknife [Kuensch 1989] over blocks of time, widened for the small
// number of blocks. Its 95 % region contains 95 % for errors that stay correlated for less than a block.
//
// Pure functions; any thread. A few thousand poses take tens of milliseconds: not for use in a loop step.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::calibration {

// Target is the frame in which the dimple does not move: the tracker's, or better the reference's.
using ToolPose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Tool>;

struct PivotPose {
  std::int64_t time_ns = 0;
  ToolPose T_fixed_tool;
};

struct PivotOptions {
  std::size_t min_poses = 50;     // different ones, in at least half as many places
  double min_rotation_rad = 0.35; // about each of two axes: 20 degrees
  double tracker_noise_mm = 0.25; // 1 sigma of a coordinate of a tracked marker
  double max_noise_ratio = 4.0;   // maximum RMS residual over the noise; above it the tip is not fit for navigation
  // A smaller one is not of this tracker: poses in cm, or computed ones. Even a tip amid four markers has an RMS of
  // 0.87 times their noise, so a tracker four times as good as stated passes.
  double min_noise_ratio = 0.2;
  // From the tool's origin. Pointers are 100 to 300 mm long, and the tip of the endoscope of the tests' recording is
  // 395 mm away. With more, a tracker's error of orientation alone (1 mrad) is above 0.5 mm.
  double max_tip_mm = 500.0;
  double max_outlier_fraction = 0.2;
};

enum class PivotVerdict {
  kAccepted,
  kTooFewPoses,
  kStatic,
  kTooLittleRotation,
  kTooManyOutliers,
  kResidualTooLarge,
  kResidualTooSmall,
  kTipImplausible // longer than a tool, or not determined
};

struct PivotFit {
  geometry::Vector3d tip_mm = geometry::Vector3d::Zero();   // in the tool
  geometry::Vector3d pivot_mm = geometry::Vector3d::Zero(); // in the fixed frame
  double rms_mm = 0.0;                                      // RMS of |e_i|
  double rms_component_mm = 0.0;                            // RMS of the 3n coordinates of e_i: rms_mm / sqrt(3)
  double worst_mm = 0.0;
};

struct PivotResult {
  PivotVerdict verdict = PivotVerdict::kTooFewPoses;
  std::string text;       // the verdict as a sentence, with the figures that decided it
  bool estimated = false; // false for kTooFewPoses, kStatic, kTooLittleRotation: all following values are then zero
  geometry::Vector3d tip_mm = geometry::Vector3d::Zero();         // in the tool
  geometry::Matrix3d covariance_mm2 = geometry::Matrix3d::Zero(); // covariance of tip_mm
  geometry::Vector3d pivot_mm = geometry::Vector3d::Zero();
  double rms_mm = 0.0;      // RMS of the poses that are not outliers
  double worst_mm = 0.0;    // maximum over all poses
  std::size_t poses = 0;    // different ones
  std::size_t repeated = 0; // left out: a pose that is sent again is no other pose
  std::size_t outliers = 0; // poses beyond four robust sigmas
  PivotFit least_squares;   // fit to all poses, outliers included
  // Rotation of the tool about its two widest axes (98 % of the poses).
  double rotation_rad[2] = {0.0, 0.0};
  geometry::Vector3d half_tips_mm[2] = {geometry::Vector3d::Zero(), geometry::Vector3d::Zero()}; // first, second half
  double halves_apart_mm = 0.0;

  [[nodiscard]] bool accepted() const { return verdict == PivotVerdict::kAccepted; }
};

// Weight one for every pose. All NaN when the poses do not determine the tip (fewer than three, or rotation about one
// axis only).
[[nodiscard]] PivotFit fit_pivot_least_squares(std::span<const PivotPose> poses);

// Poses in temporal order, all finite. Repeats of an earlier one, to 0.01 degrees and 0.08 of the noise, are left out.
[[nodiscard]] PivotResult calibrate_pivot(std::span<const PivotPose> recorded, const PivotOptions &options = {});

} // namespace bregma::calibration
