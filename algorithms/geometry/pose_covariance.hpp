// Poses with uncertainty, to first order.
//
// Twist order: rotation (rad) first, translation (mm) second. The error d = (w, v) is a left perturbation in the target
// frame: T_true = Exp(d) T, so a mapped point p = T x errs by w x p + v. Errors are zero mean; a covariance is their
// second moment. First order of [Barfoot 2014, eqs. 22-30].
#pragma once

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::geometry {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;

template <class TargetFrame, class SourceFrame> struct UncertainPose {
  Rigid3<TargetFrame, SourceFrame> pose;
  Matrix6d covariance = Matrix6d::Zero();
};

// Maps a twist in the source frame of T to its target frame.
template <class TargetFrame, class SourceFrame>
[[nodiscard]] Matrix6d adjoint(const Rigid3<TargetFrame, SourceFrame> &T) {
  const Matrix3d R = T.rotation_matrix();
  Matrix6d out = Matrix6d::Zero();
  out.topLeftCorner<3, 3>() = R;
  out.bottomRightCorner<3, 3>() = R;
  out.bottomLeftCorner<3, 3>() = skew(T.translation()) * R;
  return out;
}

// d(point error)/d(twist) at a point in the target frame.
[[nodiscard]] inline Matrix36d point_jacobian(const Vector3d &point) {
  Matrix36d out;
  out.leftCols<3>() = -skew(point);
  out.rightCols<3>().setIdentity();
  return out;
}

// The errors of the two are assumed to be independent.
template <class A, class B, class C>
[[nodiscard]] UncertainPose<A, C> operator*(const UncertainPose<A, B> &left, const UncertainPose<B, C> &right) {
  const Matrix6d ad = adjoint(left.pose);
  return {left.pose * right.pose, left.covariance + ad * right.covariance * ad.transpose()};
}

template <class A, class B> [[nodiscard]] UncertainPose<B, A> inverse(const UncertainPose<A, B> &T) {
  const auto back = T.pose.inverse();
  const Matrix6d ad = adjoint(back);
  return {back, ad * T.covariance * ad.transpose()};
}

// Covariance, in the target frame, of T * point; the point's own error is independent and given in the source frame.
template <class A, class B>
[[nodiscard]] Matrix3d point_covariance(const UncertainPose<A, B> &T, const Vector3d &point,
                                        const Matrix3d &own_covariance = Matrix3d::Zero()) {
  const Matrix36d J = point_jacobian(T.pose * point);
  const Matrix3d R = T.pose.rotation_matrix();
  return J * T.covariance * J.transpose() + R * own_covariance * R.transpose();
}

} // namespace bregma::geometry
