// Rigid registration of paired points: by least squares, and by maximum likelihood for anisotropic errors.
//
// Frames: every pose is T_target_source, covariances of poses are left perturbations in the target frame
// (geometry/pose_covariance.hpp). Lengths in mm. Pure functions, reentrant, without allocation or exceptions.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::registration {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;
using PairedPose = geometry::Rigid3<geometry::frame::Target, geometry::frame::Source>;

inline constexpr int kMaxPairs = 256;

// Least squares, sum w_i |T s_i - t_i|^2, by singular values [Arun 1987], with reflections handled as in
// [Umeyama 1991]. Empty weights: all one. No result when there are fewer than three points, the lists differ in
// length, a value is not finite, or the points are collinear (second singular value below 1e-9 of the first).
[[nodiscard]] std::optional<PairedPose> fit_rigid(std::span<const Vector3d> source_mm,
                                                  std::span<const Vector3d> target_mm,
                                                  std::span<const double> weights = {}) noexcept;

// RMS distances (mm) of points from their centroid along their principal axes, largest first. The second is their
// distance from a line.
[[nodiscard]] Vector3d spread_mm(std::span<const Vector3d> points_mm) noexcept;

struct PointPair {
  Vector3d source_mm = Vector3d::Zero();
  Vector3d target_mm = Vector3d::Zero();
  Matrix3d source_covariance = Matrix3d::Zero(); // mm^2, in the source frame
  Matrix3d target_covariance = Matrix3d::Zero(); // mm^2, in the target frame; the sum must be positive definite
};

// Residual statistics of one fiducial that was used in an estimate.
struct FiducialFit {
  Vector3d residual_mm = Vector3d::Zero(); // mapped source minus target, in the target frame
  double norm_mm = 0.0;
  // Leave-one-out distance, to first order; NaN where the others do not determine the pose.
  double leave_one_out_mm = 0.0;
  double chi_square =
      0.0; // squared Mahalanobis distance of the residual, equal to that of the leave-one-out prediction
  double expected_squared_mm2 = 0.0; // expected squared residual
  double p_value = 1.0;              // probability of at least this chi-square if the stated errors hold
};

struct PairedFit {
  bool converged = false;
  int iterations = 0;
  int count = 0;
  PairedPose T_target_source;
  Matrix6d covariance = Matrix6d::Zero();
  double fre_mm = 0.0;          // root mean square residual
  double fre_expected_mm = 0.0; // expected from the stated covariances
  double chi_square = 0.0;      // sum of the squared weighted residuals, 3 count - 6 degrees of freedom
  double p_value = 1.0;
  std::array<FiducialFit, kMaxPairs> fiducials{}; // the first count are used
};

// Maximum likelihood: Gauss-Newton with the residual's covariance R Cs R' + Ct updated in each iteration
// (generalised total least squares [Balachandran 2009] [Moghari 2007]). Starts from fit_rigid
// unless a start is given. converged is false for what fit_rigid refuses, for more than kMaxPairs pairs, and for
// covariances that are not positive definite.
[[nodiscard]] PairedFit fit_paired(std::span<const PointPair> pairs, const PairedPose *start = nullptr) noexcept;

// Residual statistics of one pair that was used in an estimate with weights W = (R Cs R' + Ct)^-1. normal_inverse:
// inverse of the estimate's normal matrix. covariance: covariance of the estimate, equal to normal_inverse where the
// weights describe all errors, larger where other terms are correlated. fixed_by_others: the pose is determined without
// this pair.
[[nodiscard]] FiducialFit assess_fiducial(const PointPair &pair, const PairedPose &T_target_source,
                                          const Matrix6d &covariance, const Matrix6d &normal_inverse,
                                          bool fixed_by_others) noexcept;

// Covariance of a tool's pose that a tracker estimates by plain (unweighted) least squares. The markers have errors of
// sigma_lateral in the tracker's x and y and sigma_depth in z (mm, 1-sigma, independent): (J'J)^-1 J' S J (J'J)^-1,
// left perturbation in Tracker. Bit i of used: marker i was used. All NaN when fewer than three were used or they are
// collinear. Called for every tool of every frame.
[[nodiscard]] Matrix6d
marker_fit_covariance(std::span<const Vector3d> markers_mm, std::uint32_t used,
                      const geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool> &T_tracker_tool,
                      double sigma_lateral_mm, double sigma_depth_mm) noexcept;

} // namespace bregma::registration
