// The move of an arm's guide onto a planned line: its tip at a distance before the entry, its axis along the line.
//
// The turn about the guide's axis is free. Turns are tried from the smallest to the largest, each by three routes:
// straight; over a point farther before the entry; and over a retreat along the guide first. The first path that the
// check (arm_collision.hpp) accepts is taken. It is not the shortest of all paths, and where none is accepted another
// route may exist.
//
// Frame: RobotBase, mm, rad. Pure; any thread; allocates. Takes up to some 100 ms for each path that is tried.
#pragma once

#include <vector>

#include "algorithms/planning/arm_collision.hpp"

namespace bregma::planning {

// In RobotFlange.
struct GuideOnFlange {
  Eigen::Vector3d tip_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ(); // unit, towards the tip
};

struct GuideGoal {
  Eigen::Vector3d entry_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ(); // unit, from the entry to the target
  double standoff_mm = 0.0;                             // of the tip before the entry
};

struct GuideMoveOptions {
  PathCheckOptions check;
  double detour_mm = 80.0; // length of the retreat, and of the final straight line along the guide
  int turns = 12;          // that are tried, evenly over a whole turn
};

struct GuideMove {
  std::vector<robot::FlangePose> waypoints; // empty: no path is clear
  PathCheck check;                          // of the path; where none is clear, of the one that led farthest
  [[nodiscard]] bool found() const { return !waypoints.empty(); }
};

// The flange whose guide is at the goal, turned by turn_rad about the line from the orientation that is nearest to the
// reference.
[[nodiscard]] robot::FlangePose flange_at_goal(const robot::FlangePose &reference, const GuideOnFlange &guide,
                                               const GuideGoal &goal, double turn_rad);

[[nodiscard]] GuideMove plan_guide_move(const ArmCollision &collision, const robot::InverseKinematics &inverse,
                                        const robot::JointAngles &start, const GuideOnFlange &guide,
                                        const GuideGoal &goal, const GuideMoveOptions &options = {});

} // namespace bregma::planning
