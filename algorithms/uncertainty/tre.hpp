// The target registration error: the error of a mapped point, as its 3x3 covariance.
//
// It follows from the covariance of the pose (geometry/pose_covariance.hpp), never from the FRE, which is uncorrelated
// with it [Fitzpatrick 2009].
// Pure functions, no allocation.
#pragma once

#include <span>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::uncertainty {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;

// Covariance (mm^2) of the error at a point, both in the target frame of the pose.
[[nodiscard]] Matrix3d tre_covariance(const Matrix6d &pose_covariance, const Vector3d &point_mm) noexcept;

// Root mean square distance of a zero-mean error.
[[nodiscard]] double rms_mm(const Matrix3d &covariance) noexcept;

// e' C^-1 e; chi-square with three degrees of freedom if e has the covariance C. Infinite where C is singular along e.
[[nodiscard]] double mahalanobis_squared(const Matrix3d &covariance, const Vector3d &error_mm) noexcept;

// The region that contains a zero-mean normal error with 95 % probability.
struct Ellipsoid95 {
  Vector3d semi_axes_mm = Vector3d::Zero(); // longest first
  Matrix3d axes = Matrix3d::Identity();     // row i: unit direction of semi-axis i; right-handed
};
[[nodiscard]] Ellipsoid95 ellipsoid_95(const Matrix3d &covariance) noexcept;

// For isotropic, equal FLE: RMS TRE at a point from the fiducials' spread about their principal axes
// [Fitzpatrick 1998, eq. 46]. fle_rms_mm is the RMS distance
// (sqrt 3 times the 1-sigma of a coordinate). NaN below three fiducials or where they are collinear.
[[nodiscard]] double fitzpatrick_tre_rms_mm(std::span<const Vector3d> fiducials_mm, const Vector3d &target_mm,
                                            double fle_rms_mm) noexcept;

// The expected FRE: sqrt(1 - 2/N) FLE [Sibson 1979].
[[nodiscard]] double expected_fre_rms_mm(int fiducials, double fle_rms_mm) noexcept;

} // namespace bregma::uncertainty
