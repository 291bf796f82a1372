#include "algorithms/robot/inverse_kinematics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include <Eigen/Dense>

namespace bregma::robot {

namespace {

constexpr double kMeets_mm = 1e-6;  // axes that are described in decimal numbers still meet
constexpr double kParallel = 1e-9;  // sine of the angle between axes 2 and 3
constexpr double kRounding = 1e-12; // relative overshoot of a stretched arm that is rounding
constexpr double kSolved_mm = 1e-9; // of the flange; its rotation counts with a lever of kLever_mm
constexpr double kLever_mm = 100.0;
constexpr double kSame_rad = 1e-7; // branches that are nearer coincide
constexpr double kFree_rad = 1e-8; // axes 4 and 6 in line to rounding: joint 4 is free
constexpr int kPolishSteps = 4;

Eigen::Matrix3d turn(const Vector3d &axis, double angle) { return Eigen::AngleAxisd(angle, axis).toRotationMatrix(); }

double within_a_turn(double angle) {
  const double wrapped = std::remainder(angle, 2.0 * std::numbers::pi);
  return wrapped <= -std::numbers::pi ? std::numbers::pi : wrapped;
}

// Angle of the rotation about the axis that takes a to b, of their parts perpendicular to it.
double angle_about(const Vector3d &axis, const Vector3d &a, const Vector3d &b) {
  return std::atan2(axis.dot(a.cross(b)), a.dot(b) - axis.dot(a) * axis.dot(b));
}

// The angles with h . R(k, angle) u = d.
struct Angles {
  std::array<double, 2> value{};
  int count = 0;          // 0: no angle, 1: two that coincide
  bool free = false;      // any angle
  double overshoot = 0.0; // by which d exceeds what can be reached; signed like d
};
Angles angles_with_component(const Vector3d &h, const Vector3d &k, const Vector3d &u, double d) {
  const double cosine = h.dot(u) - k.dot(u) * h.dot(k); // h . u perpendicular to k
  const double sine = h.dot(k.cross(u));
  const double wanted = d - k.dot(u) * h.dot(k);
  const double reach = std::hypot(cosine, sine);
  Angles out;
  const double scale = h.norm() * u.norm();
  if (reach <= kRounding * scale) {
    out.free = std::abs(wanted) <= kRounding * scale;
    out.overshoot = wanted;
    return out;
  }
  if (std::abs(wanted) > reach + kRounding * scale) {
    out.overshoot = wanted - std::copysign(reach, wanted);
    return out;
  }
  const double middle = std::atan2(sine, cosine);
  const double rest = std::max(0.0, (reach - wanted) * (reach + wanted));
  const double half = std::atan2(std::sqrt(rest), wanted);
  out.value = {middle + half, middle - half};
  out.count = rest > 0.0 ? 2 : 1;
  return out;
}

// The point nearest to three lines, and its largest distance from them.
struct Meeting {
  Vector3d point_mm;
  double miss_mm;
};
Meeting meeting_of(std::span<const JointAxis, 3> axes) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (const JointAxis &axis : axes) {
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - axis.direction * axis.direction.transpose();
    normal += across;
    right += across * axis.point_mm;
  }
  Meeting out{normal.fullPivLu().solve(right), 0.0};
  for (const JointAxis &axis : axes) {
    out.miss_mm = std::max(out.miss_mm, axis.direction.cross(out.point_mm - axis.point_mm).norm());
  }
  return out;
}

// The twist that is left from T to the wanted pose, about the flange; rotation first, times the lever.
Vector6d remainder_of(const FlangePose &wanted, const FlangePose &T) {
  Vector6d out;
  out << kLever_mm * geometry::rotation_log(wanted.rotation() * T.rotation().conjugate()),
      wanted.translation() - T.translation();
  return out;
}

double sine_between(const Vector3d &a, const Vector3d &b) { return a.cross(b).norm(); }

} // namespace

InverseKinematics::InverseKinematics(const ArmModel &model) : model_(model) {
  const auto &axes = model_.axes_at_zero();
  if (sine_between(axes[1].direction, axes[2].direction) > kParallel) {
    throw std::invalid_argument(model_.name() + ": axes 2 and 3 are not parallel");
  }
  if (sine_between(axes[0].direction, axes[1].direction) < kParallel) {
    throw std::invalid_argument(model_.name() + ": axes 1 and 2 are parallel");
  }
  const Meeting meeting = meeting_of(std::span<const JointAxis, 3>(axes.data() + 3, 3));
  if (!(meeting.miss_mm < kMeets_mm)) {
    throw std::invalid_argument(model_.name() + ": axes 4, 5 and 6 do not meet in one point");
  }
  wrist_mm_ = meeting.point_mm;
}

InverseResult InverseKinematics::solve(const FlangePose &T_base_flange, const JointAngles &reference) const {
  InverseResult out;
  if (!T_base_flange.translation().allFinite() || !T_base_flange.rotation().coeffs().allFinite() ||
      !reference.allFinite()) {
    return out;
  }
  const auto &axes = model_.axes_at_zero();
  const Vector3d wrist = T_base_flange * (model_.flange_at_zero().inverse() * wrist_mm_);
  // Joint 1: turned back by it, the wrist's centre has the same component along axis 2 as at zero angles.
  const Vector3d from_axis = wrist - axes[0].point_mm;
  Angles first = angles_with_component(axes[1].direction, -axes[0].direction, from_axis,
                                       axes[1].direction.dot(wrist_mm_ - axes[0].point_mm));
  if (first.free) {
    first.value[0] = reference[0];
    first.count = 1;
  }
  out.status = InverseStatus::kOutOfPlane;
  out.missing_mm = std::numeric_limits<double>::infinity();
  for (int i = 0; i < first.count; ++i) {
    const double q1 = first.value[static_cast<std::size_t>(i)];
    solve_elbow({q1, turn(axes[0].direction, -q1) * from_axis + axes[0].point_mm}, T_base_flange, reference, out);
  }
  if (out.count > 0) {
    out.status = InverseStatus::kSolved;
    out.missing_mm = 0.0;
  }
  return out;
}

void InverseKinematics::solve_elbow(const Shoulder &shoulder, const FlangePose &wanted, const JointAngles &reference,
                                    InverseResult &out) const {
  const auto &axes = model_.axes_at_zero();
  const Vector3d upper = axes[2].point_mm - axes[1].point_mm;
  const Vector3d fore = wrist_mm_ - axes[2].point_mm;
  const Vector3d target = shoulder.wrist - axes[1].point_mm;
  // Joint 3: |upper + R3 fore| = |target|.
  const double needed = 0.5 * (target.squaredNorm() - upper.squaredNorm() - fore.squaredNorm());
  Angles third = angles_with_component(upper, axes[2].direction, fore, needed);
  if (third.count == 0) {
    // The distance that the wrist's centre lacks, in the plane of the arm.
    const double along = axes[1].direction.dot(target);
    const double reached = std::sqrt(std::max(0.0, target.squaredNorm() - 2.0 * third.overshoot - along * along));
    const double missing = std::abs(std::sqrt(std::max(0.0, target.squaredNorm() - along * along)) - reached);
    if (missing < out.missing_mm) {
      out.missing_mm = missing;
      out.status = third.overshoot > 0.0 ? InverseStatus::kTooFar : InverseStatus::kTooNear;
    }
    return;
  }
  for (int i = 0; i < third.count; ++i) {
    JointAngles joints = JointAngles::Zero();
    joints[0] = shoulder.q1;
    joints[2] = third.value[static_cast<std::size_t>(i)];
    joints[1] = angle_about(axes[1].direction, upper + turn(axes[2].direction, joints[2]) * fore, target);
    solve_wrist(joints, wanted, reference, out);
  }
}

void InverseKinematics::solve_wrist(const JointAngles &first_three, const FlangePose &wanted,
                                    const JointAngles &reference, InverseResult &out) const {
  const auto &axes = model_.axes_at_zero();
  const Vector3d h4 = axes[3].direction;
  const Vector3d h5 = axes[4].direction;
  const Vector3d h6 = axes[5].direction;
  const Matrix3d arm = turn(axes[0].direction, first_three[0]) * turn(axes[1].direction, first_three[1]) *
                       turn(axes[2].direction, first_three[2]);
  const Matrix3d rest =
      arm.transpose() * wanted.rotation_matrix() * model_.flange_at_zero().rotation_matrix().transpose();
  // Joint 5: the angle between axes 4 and 6.
  const Angles fifth = angles_with_component(h4, h5, h6, h4.dot(rest * h6));
  if (fifth.count == 0 && out.status == InverseStatus::kTooFar) {
    out.status = InverseStatus::kOutOfPlane;
  }
  for (int i = 0; i < fifth.count; ++i) {
    JointAngles joints = first_three;
    joints[4] = fifth.value[static_cast<std::size_t>(i)];
    const Matrix3d bent = turn(h5, joints[4]);
    joints[3] = sine_between(h4, bent * h6) < kFree_rad ? reference[3] : angle_about(h4, bent * h6, rest * h6);
    const Vector3d across = h6.unitOrthogonal();
    joints[5] = angle_about(h6, across, (turn(h4, joints[3]) * bent).transpose() * rest * across);
    add(joints, wanted, out);
  }
}

void InverseKinematics::add(JointAngles joints, const FlangePose &wanted, InverseResult &out) const {
  Vector6d left = remainder_of(wanted, model_.forward(joints));
  for (int step = 0; step < kPolishSteps && !(left.norm() < 0.1 * kSolved_mm); ++step) {
    Matrix6d J = model_.jacobian(joints);
    J.bottomRows<3>() += geometry::skew(-wanted.translation()) * J.topRows<3>(); // velocity of the flange's origin
    J.topRows<3>() *= kLever_mm;
    const JointAngles next = joints + J.completeOrthogonalDecomposition().solve(left);
    const Vector6d left_then = remainder_of(wanted, model_.forward(next));
    if (!(left_then.norm() < left.norm())) {
      break;
    }
    joints = next;
    left = left_then;
  }
  if (!(left.norm() < kSolved_mm) || out.count == kMaxBranches) {
    return;
  }
  for (double &q : joints) {
    q = within_a_turn(q);
  }
  for (const ArmSolution &other : out.all()) {
    const JointAngles apart = (other.joints - joints).unaryExpr(&within_a_turn);
    if (apart.cwiseAbs().maxCoeff() < kSame_rad) {
      return;
    }
  }
  ArmSolution &solution = out.solutions[out.count++];
  solution.joints = joints;
  solution.singularity = distance_to_singularity(joints);
  solution.shoulder_singular = solution.singularity.shoulder_mm < kSingular.shoulder_mm;
  solution.elbow_singular = solution.singularity.elbow_rad < kSingular.elbow_rad;
  solution.wrist_singular = solution.singularity.wrist_rad < kSingular.wrist_rad;
}

std::optional<ArmSolution> InverseKinematics::nearest(const FlangePose &T_base_flange,
                                                      const JointAngles &reference) const {
  const InverseResult result = solve(T_base_flange, reference);
  std::optional<ArmSolution> best;
  double least = std::numeric_limits<double>::infinity();
  for (const ArmSolution &solution : result.all()) {
    const auto turned = model_.turned_near(solution.joints, reference);
    if (!turned) {
      continue;
    }
    if (const double moved = (*turned - reference).cwiseAbs().maxCoeff(); moved < least) {
      least = moved;
      best = solution;
      best->joints = *turned;
    }
  }
  return best;
}

SingularityDistance InverseKinematics::distance_to_singularity(const JointAngles &joints) const {
  const auto axes = model_.axes(joints);
  const Vector3d wrist = model_.forward(joints) * (model_.flange_at_zero().inverse() * wrist_mm_);
  SingularityDistance out;
  out.shoulder_mm = std::abs(axes[1].direction.dot(axes[0].direction.cross(wrist - axes[0].point_mm)));
  const auto in_plane = [&](const Vector3d &v) -> Vector3d { return v - axes[1].direction.dot(v) * axes[1].direction; };
  const Vector3d upper = in_plane(axes[2].point_mm - axes[1].point_mm);
  const Vector3d fore = in_plane(wrist - axes[2].point_mm);
  out.elbow_rad = std::atan2(upper.cross(fore).norm(), std::abs(upper.dot(fore)));
  out.wrist_rad = std::atan2(sine_between(axes[3].direction, axes[5].direction),
                             std::abs(axes[3].direction.dot(axes[5].direction)));
  return out;
}

} // namespace bregma::robot
