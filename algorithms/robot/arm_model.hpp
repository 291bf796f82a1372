// A serial arm of six revolute joints: forward kinematics, Jacobian, joint limits.
//
// The arm is stored as the screw axes of its joints in RobotBase at zero joint angles, and the flange's pose there:
// T(q) = exp(q1 S1) ... exp(q6 S6) T(0), the product of exponentials [Brockett 1984]. Denavit-Hartenberg tables and
// URDF chains both convert to it without loss.
//
// Units: mm, rad. Pure functions; any thread; no allocation after construction.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::robot {

using geometry::Matrix3d;
using geometry::Matrix6d;
using geometry::Vector3d;
using geometry::Vector6d;

inline constexpr std::size_t kJoints = 6;
using JointAngles = Vector6d; // rad, the joint nearest to the base first
using FlangePose = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::RobotFlange>;

// One row of a standard Denavit-Hartenberg table [Denavit 1955]: Rz(q + offset) Tz(d) Tx(a) Rx(alpha).
struct DhRow {
  double d_mm = 0.0;
  double alpha_rad = 0.0;
  double a_mm = 0.0;
  double offset_rad = 0.0;
};

struct JointLimits {
  double lower_rad = 0.0, upper_rad = 0.0;
};

// The axis of a joint in RobotBase: unit direction, and a point on it.
struct JointAxis {
  Vector3d direction = Vector3d::UnitZ();
  Vector3d point_mm = Vector3d::Zero();
};

// A joint of a chain as URDF describes it: a fixed transform from the joint before, and an axis there.
struct ChainJoint {
  geometry::Rigid3<geometry::frame::Target, geometry::frame::Source> T_previous_joint;
  Vector3d axis = Vector3d::UnitX(); // in the joint's own frame, of any positive length
};

class ArmModel {
public:
  // All throw std::invalid_argument that names the joint and the value: a value that is not finite, an axis of length
  // zero, limits that are not in order.
  ArmModel(std::string name, const std::array<JointAxis, kJoints> &axes, const std::array<JointLimits, kJoints> &limits,
           const FlangePose &T_base_flange_at_zero);
  [[nodiscard]] static ArmModel from_dh(std::string name, const std::array<DhRow, kJoints> &rows,
                                        const std::array<JointLimits, kJoints> &limits);
  // T_last_flange: the flange in the frame of the last joint.
  [[nodiscard]] static ArmModel
  from_chain(std::string name, const std::array<ChainJoint, kJoints> &joints,
             const std::array<JointLimits, kJoints> &limits,
             const geometry::Rigid3<geometry::frame::Target, geometry::frame::Source> &T_last_flange);

  [[nodiscard]] FlangePose forward(const JointAngles &joints) const;
  // The axes of all joints at these angles, in RobotBase.
  [[nodiscard]] std::array<JointAxis, kJoints> axes(const JointAngles &joints) const;
  // d(twist of the flange)/d(joints): a left perturbation in RobotBase, rotation first, per radian
  // (geometry/pose_covariance.hpp). The velocity of a point p is geometry::point_jacobian(p) times it.
  [[nodiscard]] Matrix6d jacobian(const JointAngles &joints) const;

  [[nodiscard]] const std::string &name() const { return name_; }
  [[nodiscard]] const std::array<JointAxis, kJoints> &axes_at_zero() const { return axes_; }
  [[nodiscard]] const std::array<JointLimits, kJoints> &limits() const { return limits_; }
  [[nodiscard]] const FlangePose &flange_at_zero() const { return T_base_flange_at_zero_; }

  // Smallest distance of a joint from its limits, rad; negative beyond one.
  [[nodiscard]] double limit_margin(const JointAngles &joints) const;
  // The first joint (from 0) beyond its limits; nullopt: none. Angles that are not finite are beyond.
  [[nodiscard]] std::optional<std::size_t> beyond_limits(const JointAngles &joints) const;
  // The same pose with whole turns added, so that each joint lies within its limits and as near to the reference as
  // possible; nullopt where a joint has no such turn.
  [[nodiscard]] std::optional<JointAngles> turned_near(const JointAngles &joints, const JointAngles &reference) const;

private:
  std::string name_;
  std::array<JointAxis, kJoints> axes_;
  std::array<JointLimits, kJoints> limits_;
  FlangePose T_base_flange_at_zero_;
};

} // namespace bregma::robot
