#include "algorithms/planning/guide_move.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <Eigen/Geometry>

namespace bregma::planning {

namespace {

using robot::FlangePose;
using Route = std::vector<FlangePose>;

FlangePose displaced(const FlangePose &pose, const Eigen::Vector3d &by_mm) {
  return {pose.rotation(), Eigen::Vector3d(pose.translation() + by_mm)};
}

// 0, +1, -1, +2, -2, ... steps of a whole turn, so that smaller turns come first.
std::vector<double> turns_from_small(int count) {
  std::vector<double> out;
  const double step = 2.0 * std::numbers::pi / std::max(count, 1);
  for (int i = 0; i < count; ++i) {
    const int multiple = (i + 1) / 2;
    out.push_back(i % 2 == 0 ? -multiple * step : multiple * step);
  }
  return out;
}

} // namespace

FlangePose flange_at_goal(const FlangePose &reference, const GuideOnFlange &guide, const GuideGoal &goal,
                          double turn_rad) {
  const Eigen::Vector3d now = reference.rotation() * guide.axis;
  const Eigen::Quaterniond least = Eigen::Quaterniond::FromTwoVectors(now, goal.direction);
  const Eigen::Quaterniond R =
      (Eigen::Quaterniond(Eigen::AngleAxisd(turn_rad, goal.direction)) * least * reference.rotation()).normalized();
  const Eigen::Vector3d tip = goal.entry_mm - goal.standoff_mm * goal.direction;
  return {R, tip - R * guide.tip_mm};
}

GuideMove plan_guide_move(const ArmCollision &collision, const robot::InverseKinematics &inverse,
                          const robot::JointAngles &start, const GuideOnFlange &guide, const GuideGoal &goal,
                          const GuideMoveOptions &options) {
  const FlangePose from = collision.arm().forward(start);
  const FlangePose retreat = displaced(from, -options.detour_mm * (from.rotation() * guide.axis));
  GuideMove out;
  bool first = true;
  for (const double turn : turns_from_small(options.turns)) {
    const FlangePose at = flange_at_goal(from, guide, goal, turn);
    const FlangePose before = displaced(at, -options.detour_mm * goal.direction);
    for (Route &route : std::vector<Route>{{at}, {before, at}, {retreat, before, at}}) {
      PathCheck check = check_path(collision, inverse, start, route, options.check);
      if (check.clear()) {
        out.waypoints = std::move(route);
        out.check = std::move(check);
        return out;
      }
      if (check.at_mm <= 0.0 && check.verdict == PathVerdict::kTooClose) {
        out.check = std::move(check); // the arm is too close where it is: no route mends that
        return out;
      }
      if (first || check.at_mm / check.length_mm > out.check.at_mm / out.check.length_mm) {
        out.check = std::move(check);
        first = false;
      }
    }
  }
  return out;
}

} // namespace bregma::planning
