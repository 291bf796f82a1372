#include "drivers/sim/robot_arm.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>

#include "drivers/sim/motion.hpp"
#include "drivers/sim/scenario.hpp"
#include "idl/names.hpp"

namespace bregma::sim {

namespace {

using Jacobian = Eigen::Matrix<double, 6, RobotArm::kJoints>; // velocity (mm), then rotation (rad), in the base
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr double kHalfPi = std::numbers::pi / 2.0;

struct Link { // Denavit-Hartenberg, standard convention
  double a_mm, alpha_rad, d_mm;
};
constexpr std::array<Link, RobotArm::kJoints> kLinks{
    {{0, kHalfPi, 400}, {450, 0, 0}, {400, 0, 0}, {0, kHalfPi, 120}, {0, -kHalfPi, 100}, {0, 0, 80}}};

const Vector3d kBaseFromHead_mm(450.0, -380.0, 260.0); // in the image's axes: right of, below and behind the head
constexpr double kParkDistance_mm = 260.0;
constexpr double kRotationScale_mm = 200.0; // weighs a radian against a millimetre
constexpr double kGuideWeight_N = 8.0;

struct Kinematics {
  T_BaseFlange T_base_flange;
  Jacobian jacobian;
};

Kinematics kinematics(const RobotArm::Joints &joints) {
  std::array<Vector3d, RobotArm::kJoints> axes;
  std::array<Vector3d, RobotArm::kJoints> origins;
  Matrix3d R = Matrix3d::Identity();
  Vector3d p = Vector3d::Zero();
  for (std::size_t i = 0; i < kLinks.size(); ++i) {
    axes[i] = R.col(2);
    origins[i] = p;
    const Link &link = kLinks[i];
    const double c = std::cos(joints[static_cast<int>(i)]);
    const double s = std::sin(joints[static_cast<int>(i)]);
    const double ca = std::cos(link.alpha_rad);
    const double sa = std::sin(link.alpha_rad);
    Matrix3d step;
    step << c, -s * ca, s * sa, s, c * ca, -c * sa, 0, sa, ca;
    p += R * Vector3d(link.a_mm * c, link.a_mm * s, link.d_mm);
    R = R * step;
  }
  Kinematics out{{R, p}, {}};
  for (std::size_t i = 0; i < kLinks.size(); ++i) {
    out.jacobian.col(static_cast<int>(i)) << axes[i].cross(p - origins[i]), axes[i];
  }
  return out;
}

T_ImageFlange facing(const Vector3d &position, const Vector3d &direction, const Quaterniond &near) {
  const Vector3d present = near * Vector3d::UnitZ();
  return {Quaterniond::FromTwoVectors(present, direction) * near, position};
}

} // namespace

T_BaseFlange RobotArm::forward(const Joints &joints) { return kinematics(joints).T_base_flange; }

bool RobotArm::inverse(const T_BaseFlange &wanted, Joints &joints) {
  constexpr double kClose_mm = 1e-6;
  constexpr double kMaxStep_rad = 0.2;
  Vector6d scale;
  scale << 1, 1, 1, kRotationScale_mm, kRotationScale_mm, kRotationScale_mm;
  for (int iteration = 0; iteration < 200; ++iteration) {
    const Kinematics now = kinematics(joints);
    Vector6d error;
    error << wanted.translation() - now.T_base_flange.translation(),
        geometry::rotation_log(wanted.rotation() * now.T_base_flange.rotation().conjugate());
    error = error.cwiseProduct(scale);
    if (error.norm() < kClose_mm) {
      return true;
    }
    const Jacobian J = scale.asDiagonal() * now.jacobian;
    // Damping increases with the error: robust far away, Newton's method near the solution.
    const double damping = 1e-3 + std::min(1.0, error.norm() * 1e-2) * 10.0;
    Eigen::Matrix<double, 6, 6> A = J * J.transpose();
    A.diagonal().array() += damping * damping;
    Joints step = J.transpose() * A.ldlt().solve(error);
    const double longest = step.cwiseAbs().maxCoeff();
    step *= longest > kMaxStep_rad ? kMaxStep_rad / longest : 1.0;
    joints += step;
  }
  return false;
}

RobotArm::RobotArm(const Patient &patient, const RobotParameters &parameters, std::uint64_t seed)
    : parameters_(parameters), noise_(seed, "robot") {
  const Vector3d centre = patient.head.centre_mm();
  Matrix3d R_image_base; // x towards the head, z up in the room
  R_image_base << Vector3d(-1, 0, 0), Vector3d(0, 0, 1), Vector3d(0, 1, 0);
  T_image_base_ = {R_image_base, centre + kBaseFromHead_mm};
  const Vector3d out = Vector3d(0.5, 0.6, 0.6).normalized();
  const Vector3d park = centre + (patient.head.radius_mm() + kParkDistance_mm - 100.0) * out;
  const Quaterniond rotation = T_image_base_.rotation() * Quaterniond(Eigen::AngleAxisd(kHalfPi, Vector3d::UnitY()));
  from_ = goal_ = facing(park, -out, rotation);
  joints_ << 0.0, -1.2, 1.6, -2.0, -kHalfPi, 0.0;
  reachable_ = inverse(T_image_base_.inverse() * goal_, joints_);
  T_image_flange_ = T_image_base_ * forward(joints_);
}

T_ImageFlange RobotArm::looking(const Vector3d &position, const Vector3d &direction) const {
  return facing(position, direction.normalized(), T_image_flange_.rotation());
}

void RobotArm::go(const T_ImageFlange &goal, std::int64_t now_ns) {
  from_ = wanted(now_ns);
  goal_ = goal;
  const double way = (goal.translation() - from_.translation()).norm() +
                     kRotationScale_mm * geometry::angle_between(from_.rotation(), goal.rotation());
  departure_ns_ = now_ns;
  arrival_ns_ = now_ns + std::llround(std::max(0.5, way / parameters_.speed_mm_s) * 1e9);
}

T_ImageFlange RobotArm::wanted(std::int64_t time_ns) const {
  if (time_ns >= arrival_ns_) {
    return goal_;
  }
  const double way =
      minimum_jerk(static_cast<double>(time_ns - departure_ns_) / static_cast<double>(arrival_ns_ - departure_ns_));
  return {from_.rotation().slerp(way, goal_.rotation()),
          from_.translation() + way * (goal_.translation() - from_.translation())};
}

wire::RobotState RobotArm::sample(std::int64_t time_ns) {
  const Joints before = joints_;
  reachable_ = inverse(T_image_base_.inverse() * wanted(time_ns), joints_);
  const double elapsed_s = static_cast<double>(time_ns - last_sample_ns_) * 1e-9;
  const Joints velocity =
      last_sample_ns_ != 0 && elapsed_s > 0.0 ? Joints((joints_ - before) / elapsed_s) : Joints(Joints::Zero());
  last_sample_ns_ = time_ns;
  Joints measured = joints_;
  for (double &joint : measured) {
    joint += noise_.normal(1e-3 * parameters_.encoder_noise_mrad);
  }
  const Kinematics now = kinematics(measured);
  T_image_flange_ = T_image_base_ * forward(joints_);
  const Joints effort_Nmm = now.jacobian.topRows<3>().transpose() * Vector3d(0, 0, kGuideWeight_N); // against gravity

  wire::RobotState out{};
  out.mode = reachable_ ? bregma_wire_ROBOT_ENABLED : bregma_wire_ROBOT_FAULT;
  out.joint_count = kJoints;
  for (int i = 0; i < kJoints; ++i) {
    out.joint_position_rad[i] = measured[i];
    out.joint_velocity_rad_s[i] = velocity[i];
    out.joint_effort_Nm[i] = 1e-3 * effort_Nmm[i];
  }
  out.T_base_flange = wire::to_wire(now.T_base_flange);
  return out;
}

} // namespace bregma::sim
