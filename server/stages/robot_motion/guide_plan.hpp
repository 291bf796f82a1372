// The move of an arm's guide onto a planned trajectory of the case: from the accepted, verified registration and the
// measured joints to a path that was checked against head and table (algorithms/planning/guide_move.hpp).
//
// Refused, with the reason for the operator: a state of the arm that is not fresh, a tool that is not live in the
// navigation (which needs the verified registration), links that do not describe the arm that measures, a head that is
// no closed surface, no clear path.
//
// RobotBase, mm, rad, ns UTC. Pure; any thread; allocates; may take seconds.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "algorithms/planning/guide_move.hpp"
#include "base/result.hpp"
#include "casefile/case.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct GuidePlanInputs {
  const casefile::Case *a_case = nullptr; // with an arm of this device and the trajectory; nullptr: it was closed
  const RobotView *robot = nullptr;       // nullptr: the daemon reads no arm of this name
  const TrackingView *tracking = nullptr;
  const wire::RegistrationState *registration = nullptr;
};

struct GuidePlan {
  planning::GuideMove move;
  robot::JointAngles start = robot::JointAngles::Zero();
  std::uint64_t accepted_revision = 0;
  std::string text;
};

// The joints of an arm whose state is not older than a live pose; the error states what is wrong.
[[nodiscard]] base::Result<robot::JointAngles> fresh_joints(const RobotView *robot, std::int64_t now_ns);

[[nodiscard]] base::Result<GuidePlan> plan_guide(const GuidePlanInputs &inputs, std::string_view trajectory,
                                                 double standoff_mm, const planning::GuideMoveOptions &options,
                                                 std::int64_t now_ns);

} // namespace bregma::server
