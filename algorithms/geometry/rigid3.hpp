// Rigid transforms whose type states their target and source frames.
//
// Rigid3<Target, Source> maps points given in Source (mm) to the same points in Target (mm); a variable of this type is
// named T_target_source. Two transforms compose only where the inner frames agree, at compile time.
#pragma once

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace bregma::geometry {

namespace frame {
struct Image;     // the planning image: RAS, mm
struct Reference; // the patient's dynamic reference
struct Tracker;
struct Tool; // a tracked tool's marker body
struct Tip;  // the tool's tip: same axes as Tool, origin at the tip
struct RobotBase;
struct RobotFlange;
struct Source; // for algorithms without specific frames: the moving side
struct Target; // and the fixed side
} // namespace frame

using Eigen::Matrix3d;
using Eigen::Vector3d;

template <class TargetFrame, class SourceFrame> class Rigid3 {
public:
  Rigid3() : rotation_(Eigen::Quaterniond::Identity()), translation_(Vector3d::Zero()) {}
  // rotation must be a unit quaternion up to rounding; it is normalised here.
  Rigid3(const Eigen::Quaterniond &rotation, const Vector3d &translation)
      : rotation_(rotation.normalized()), translation_(translation) {}
  Rigid3(const Matrix3d &rotation, const Vector3d &translation) : Rigid3(Eigen::Quaterniond(rotation), translation) {}

  [[nodiscard]] const Eigen::Quaterniond &rotation() const { return rotation_; }
  [[nodiscard]] const Vector3d &translation() const { return translation_; }
  [[nodiscard]] Matrix3d rotation_matrix() const { return rotation_.toRotationMatrix(); }
  [[nodiscard]] Eigen::Matrix4d matrix() const {
    Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
    out.topLeftCorner<3, 3>() = rotation_matrix();
    out.topRightCorner<3, 1>() = translation_;
    return out;
  }

  [[nodiscard]] Rigid3<SourceFrame, TargetFrame> inverse() const {
    const Eigen::Quaterniond back = rotation_.conjugate();
    return {back, -(back * translation_)};
  }

  // The point in Target of a point in Source.
  [[nodiscard]] Vector3d operator*(const Vector3d &point) const { return rotation_ * point + translation_; }

  template <class Inner>
  [[nodiscard]] Rigid3<TargetFrame, Inner> operator*(const Rigid3<SourceFrame, Inner> &right) const {
    return {rotation_ * right.rotation(), rotation_ * right.translation() + translation_};
  }

  // Assigns other frames to the same numbers, between an algorithm and its caller.
  template <class NewTarget, class NewSource> [[nodiscard]] Rigid3<NewTarget, NewSource> as() const {
    return {rotation_, translation_};
  }

private:
  Eigen::Quaterniond rotation_;
  Vector3d translation_;
};

[[nodiscard]] inline Matrix3d skew(const Vector3d &v) {
  Matrix3d out;
  out << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return out;
}

// The rotation by |w| radians about w.
[[nodiscard]] inline Eigen::Quaterniond rotation_exp(const Vector3d &w) {
  const double angle = w.norm();
  // sin(a/2)/a, by its series where the division would lose precision.
  const double scale = angle < 1e-6 ? 0.5 - angle * angle / 48.0 : std::sin(0.5 * angle) / angle;
  return Eigen::Quaterniond(std::cos(0.5 * angle), scale * w.x(), scale * w.y(), scale * w.z());
}

// The rotation vector of q, of length at most pi.
[[nodiscard]] inline Vector3d rotation_log(const Eigen::Quaterniond &q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const double sine = q.vec().norm();
  const double scale = sine < 1e-9 ? 2.0 : 2.0 * std::atan2(sine, sign * q.w()) / sine;
  return sign * scale * q.vec();
}

[[nodiscard]] inline double angle_between(const Eigen::Quaterniond &a, const Eigen::Quaterniond &b) {
  return rotation_log(a.conjugate() * b).norm();
}

} // namespace bregma::geometry
