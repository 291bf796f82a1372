// The move of an arm's guide onto a planned trajectory of the case: from the accepted, verified registration and the
// measured joints to a path that was checked against head and table (algorithms/planning/guide_move.hpp).
//
// Refused, with the reason for the operator: a state of the arm that is not fresh, a tool that is not live in the
// navigation (which needs the verified registration), links that do not describe the arm that measures, a head that is
// no closed surface, no clear path.
//
// Beside a tracker the registration is that of the tracked reference, and RobotBase comes from
//
//   T_base_image = T_base_tracker T_tracker_reference (T_image_reference)^-1
//
// with the calibrated hand-eye and the mean of the latest frames (patient_place.hpp). Refused too where the motion
// would be stopped (guide_watch.hpp), and for a driver that does not obey the permit. The block around the reference's
// markers is an obstacle. The predicted error of the tip contains registration, reference, hand-eye, flange and tool; a
// path is refused where it is larger than the distance that the path keeps.
//
// RobotBase, mm, rad, ns UTC. Pure; any thread; allocates; may take seconds.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "algorithms/planning/guide_move.hpp"
#include "base/result.hpp"
#include "casefile/case.hpp"
#include "server/stages/robot_motion/guide_watch.hpp"
#include "server/stages/robot_motion/patient_place.hpp"
#include "server/stages/robot_tool/tool_pose.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct GuidePlanInputs {
  const casefile::Case *a_case = nullptr; // with an arm of this device and the trajectory; nullptr: it was closed
  const RobotView *robot = nullptr;       // nullptr: the daemon reads no arm of this name
  const TrackingView *tracking = nullptr;
  const wire::RegistrationState *registration = nullptr;
  // Beside a tracker.
  const ReferenceView *reference = nullptr;
  const PatientPlace *patient = nullptr;
  ToolPoseOptions arm; // for an arm that states no covariance
};

struct GuidePlan {
  planning::GuideMove move;
  robot::JointAngles start = robot::JointAngles::Zero();
  std::uint64_t accepted_revision = 0;
  WatchedGuide guide;
  double predicted_95_mm = 0.0; // of the tip at the end of the path
  std::string text;
};

// The joints of an arm whose state is not older than a live pose; the error states what is wrong.
[[nodiscard]] base::Result<robot::JointAngles> fresh_joints(const RobotView *robot, std::int64_t now_ns);

[[nodiscard]] base::Result<GuidePlan> plan_guide(const GuidePlanInputs &inputs, std::string_view trajectory,
                                                 double standoff_mm, const planning::GuideMoveOptions &options,
                                                 std::int64_t now_ns);

} // namespace bregma::server
