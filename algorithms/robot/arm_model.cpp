#include "algorithms/robot/arm_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace bregma::robot {

namespace {

using Link = geometry::Rigid3<geometry::frame::Target, geometry::frame::Target>;

std::string joint_text(std::size_t joint) { return "joint " + std::to_string(joint + 1); }

JointAxis axis_of(const Link &T_base_joint, const Vector3d &axis, std::size_t joint) {
  const double length = axis.norm();
  if (!(length > 0.0) || !std::isfinite(length)) {
    throw std::invalid_argument(joint_text(joint) + ": its axis has no direction");
  }
  return {T_base_joint.rotation() * (axis / length), T_base_joint.translation()};
}

} // namespace

ArmModel::ArmModel(std::string name, const std::array<JointAxis, kJoints> &axes,
                   const std::array<JointLimits, kJoints> &limits, const FlangePose &T_base_flange_at_zero)
    : name_(std::move(name)), axes_(axes), limits_(limits), T_base_flange_at_zero_(T_base_flange_at_zero) {
  if (!T_base_flange_at_zero.translation().allFinite() || !T_base_flange_at_zero.rotation().coeffs().allFinite()) {
    throw std::invalid_argument("the flange's pose at zero angles is not finite");
  }
  for (std::size_t i = 0; i < kJoints; ++i) {
    if (!axes[i].point_mm.allFinite() || std::abs(axes[i].direction.norm() - 1.0) > 1e-9) {
      throw std::invalid_argument(joint_text(i) + ": its axis is not finite or not of unit length");
    }
    if (!(limits[i].lower_rad < limits[i].upper_rad) || !std::isfinite(limits[i].lower_rad) ||
        !std::isfinite(limits[i].upper_rad)) {
      throw std::invalid_argument(joint_text(i) + ": its lower limit must be below its upper limit");
    }
  }
}

ArmModel ArmModel::from_dh(std::string name, const std::array<DhRow, kJoints> &rows,
                           const std::array<JointLimits, kJoints> &limits) {
  std::array<JointAxis, kJoints> axes;
  Link T;
  for (std::size_t i = 0; i < kJoints; ++i) {
    const DhRow &row = rows[i];
    axes[i] = axis_of(T, Vector3d::UnitZ(), i);
    const Link turn(Eigen::Quaterniond(Eigen::AngleAxisd(row.offset_rad, Vector3d::UnitZ())),
                    Vector3d(0.0, 0.0, row.d_mm));
    const Link twist(Eigen::Quaterniond(Eigen::AngleAxisd(row.alpha_rad, Vector3d::UnitX())),
                     Vector3d(row.a_mm, 0.0, 0.0));
    T = T * turn * twist;
  }
  return {std::move(name), axes, limits, T.as<geometry::frame::RobotBase, geometry::frame::RobotFlange>()};
}

ArmModel ArmModel::from_chain(std::string name, const std::array<ChainJoint, kJoints> &joints,
                              const std::array<JointLimits, kJoints> &limits,
                              const geometry::Rigid3<geometry::frame::Target, geometry::frame::Source> &T_last_flange) {
  std::array<JointAxis, kJoints> axes;
  Link T;
  for (std::size_t i = 0; i < kJoints; ++i) {
    T = T * joints[i].T_previous_joint.as<geometry::frame::Target, geometry::frame::Target>();
    axes[i] = axis_of(T, joints[i].axis, i);
  }
  return {std::move(name), axes, limits,
          (T * T_last_flange).as<geometry::frame::RobotBase, geometry::frame::RobotFlange>()};
}

FlangePose ArmModel::forward(const JointAngles &joints) const {
  Eigen::Quaterniond R = T_base_flange_at_zero_.rotation();
  Vector3d t = T_base_flange_at_zero_.translation();
  for (std::size_t i = kJoints; i-- > 0;) {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(joints[static_cast<Eigen::Index>(i)], axes_[i].direction));
    R = turn * R;
    t = turn * (t - axes_[i].point_mm) + axes_[i].point_mm;
  }
  return {R, t};
}

std::array<JointAxis, kJoints> ArmModel::axes(const JointAngles &joints) const {
  std::array<JointAxis, kJoints> out;
  Eigen::Quaterniond R = Eigen::Quaterniond::Identity();
  Vector3d t = Vector3d::Zero();
  for (std::size_t i = 0; i < kJoints; ++i) {
    out[i] = {R * axes_[i].direction, R * axes_[i].point_mm + t};
    // exp(q S) maps p to turn (p - point) + point.
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(joints[static_cast<Eigen::Index>(i)], axes_[i].direction));
    t = R * (axes_[i].point_mm - turn * axes_[i].point_mm) + t;
    R = (R * turn).normalized();
  }
  return out;
}

Matrix6d ArmModel::jacobian(const JointAngles &joints) const {
  Matrix6d out;
  const auto now = axes(joints);
  for (std::size_t i = 0; i < kJoints; ++i) {
    out.col(static_cast<Eigen::Index>(i)) << now[i].direction, now[i].point_mm.cross(now[i].direction);
  }
  return out;
}

double ArmModel::limit_margin(const JointAngles &joints) const {
  double margin = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < kJoints; ++i) {
    const double q = joints[static_cast<Eigen::Index>(i)];
    margin = std::min({margin, q - limits_[i].lower_rad, limits_[i].upper_rad - q});
  }
  return margin;
}

std::optional<std::size_t> ArmModel::beyond_limits(const JointAngles &joints) const {
  for (std::size_t i = 0; i < kJoints; ++i) {
    const double q = joints[static_cast<Eigen::Index>(i)];
    if (!(q >= limits_[i].lower_rad && q <= limits_[i].upper_rad)) {
      return i;
    }
  }
  return std::nullopt;
}

std::optional<JointAngles> ArmModel::turned_near(const JointAngles &joints, const JointAngles &reference) const {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  JointAngles out = joints;
  for (std::size_t i = 0; i < kJoints; ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    // The turns inside the limits are consecutive: the one nearest to the reference, or the end on its side.
    const double first = std::ceil((limits_[i].lower_rad - joints[at]) / kTurn);
    const double last = std::floor((limits_[i].upper_rad - joints[at]) / kTurn);
    if (!(first <= last)) {
      return std::nullopt;
    }
    out[at] += kTurn * std::clamp(std::round((reference[at] - joints[at]) / kTurn), first, last);
  }
  return out;
}

} // namespace bregma::robot
