#include "server/stages/robot_motion/guide_plan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <utility>

#include "idl/names.hpp"
#include "idl/validity.hpp"

namespace bregma::server {

namespace {

using geometry::Vector3d;
using BaseFromImage = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::Image>;

constexpr double kMaxStandoff_mm = 500.0;
// Between the stated flange and where the links put it by the measured joints.
constexpr double kMaxLinkError_mm = 1.0;
constexpr double kMaxLinkError_rad = 0.005;

tl::unexpected<base::Error> refuse(const std::string &text) { return tl::unexpected(base::Error{text}); }

// The arm's tool, live in the navigation of this case; nullptr: `why` says why not.
const casefile::RobotToolModel *live_tool(const GuidePlanInputs &inputs, std::string &why) {
  const std::string carried = wire::text(inputs.robot->tool);
  const auto &tools = inputs.a_case->robot->equipment.tools;
  const auto tool = std::find_if(tools.begin(), tools.end(), [&](const auto &one) { return one.name == carried; });
  if (tool == tools.end()) {
    why = "the arm states to carry \"" + carried + "\", which the file of robot.tools does not have";
    return nullptr;
  }
  const TrackingView &tracking = *inputs.tracking;
  const auto *end = tracking.tools + tracking.tool_count;
  const auto *seen =
      std::find_if(tracking.tools, end, [&](const auto &one) { return wire::view(one.tool) == carried; });
  if (!tracking.by_arm || seen == end || seen->status != bregma_wire_POSE_LIVE) {
    why = carried + " is not live: its pose must be live and the registration verified";
    return nullptr;
  }
  return &*tool;
}

// The head and the table around the arm, and what it carries.
planning::ArmCollision surroundings(const casefile::Case &a_case, const casefile::RobotToolModel &tool,
                                    const BaseFromImage &T_base_image) {
  const casefile::RobotEquipment &equipment = a_case.robot->equipment;
  planning::ArmScene scene;
  scene.table_z_mm = equipment.table_z_mm;
  surface::TriangleMesh head = a_case.scalp.mesh;
  for (Vector3d &vertex : head.vertices_mm) {
    vertex = T_base_image * vertex;
  }
  scene.obstacles.push_back({"the head", std::move(head)});
  planning::ArmBodies bodies;
  bodies.tools.push_back({tool.name, Vector3d::Zero(), tool.tip_mm, tool.radius_mm});
  for (const casefile::RangeSensorModel &sensor : equipment.sensors) {
    bodies.tools.push_back({sensor.name, Vector3d::Zero(), sensor.origin_mm, sensor.radius_mm});
  }
  return {*equipment.arm, std::move(bodies), scene};
}

} // namespace

base::Result<robot::JointAngles> fresh_joints(const RobotView *robot, std::int64_t now_ns) {
  if (robot == nullptr || robot->acquired_ns == 0) {
    return refuse("the arm has not been heard");
  }
  const std::int64_t age_ns = now_ns - robot->acquired_ns;
  if (robot->lost || age_ns < 0 || age_ns > wire::live_limit_ns(wire::kLiveLimit_ms, robot->period_ns)) {
    return refuse("the arm's state is too old: no sample for " + std::to_string(age_ns / 1'000'000) + " ms");
  }
  if (robot->joint_count != robot::kJoints) {
    return refuse("the arm states " + std::to_string(robot->joint_count) + " joints: paths are planned for six");
  }
  return robot::JointAngles(robot->joint_position_rad);
}

base::Result<GuidePlan> plan_guide(const GuidePlanInputs &inputs, std::string_view trajectory, double standoff_mm,
                                   const planning::GuideMoveOptions &options, std::int64_t now_ns) {
  const casefile::Case *a_case = inputs.a_case;
  const casefile::Trajectory *line = a_case != nullptr ? a_case->trajectory(std::string(trajectory)) : nullptr;
  if (line == nullptr || !a_case->robot) {
    return refuse("the case was closed");
  }
  if (a_case->hand_eye() != nullptr) {
    return refuse("beside a tracker no motion is planned: the patient may move while the arm does");
  }
  if (!a_case->robot->equipment.arm) {
    return refuse("no motion can be planned: the file of robot.tools does not state the arm's links (arm = \"...\")");
  }
  if (!(standoff_mm >= 0.0 && standoff_mm <= kMaxStandoff_mm)) {
    return refuse("standoff_mm = " + std::to_string(standoff_mm) + ": must be 0 to 500");
  }
  const auto start = fresh_joints(inputs.robot, now_ns);
  if (!start) {
    return tl::unexpected(start.error());
  }
  const wire::RegistrationState &registration = *inputs.registration;
  if (registration.ended || registration.accepted_revision == 0) {
    return refuse("no registration is accepted");
  }
  std::string why;
  const casefile::RobotToolModel *tool = live_tool(inputs, why);
  if (tool == nullptr) {
    return refuse(why);
  }
  const robot::ArmModel &arm = *a_case->robot->equipment.arm;
  const auto stated =
      wire::from_wire<geometry::frame::RobotBase, geometry::frame::RobotFlange>(inputs.robot->T_base_flange);
  const robot::FlangePose computed = arm.forward(*start);
  const double off_mm = (stated.translation() - computed.translation()).norm();
  if (!(off_mm <= kMaxLinkError_mm) || !(stated.rotation().angularDistance(computed.rotation()) <= kMaxLinkError_rad)) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "is not the arm that measures: its flange is %.1f mm from where these links put it", off_mm);
    return refuse(arm.name() + " " + text);
  }
  const BaseFromImage T_base_image =
      wire::from_wire<geometry::frame::Image, geometry::frame::RobotBase>(registration.accepted_T_image_reference)
          .inverse();
  planning::GuideGoal goal;
  goal.entry_mm = T_base_image * line->entry_mm;
  goal.direction = (T_base_image.rotation() * (line->target_mm - line->entry_mm)).normalized();
  goal.standoff_mm = standoff_mm;
  GuidePlan out;
  out.start = *start;
  out.accepted_revision = registration.accepted_revision;
  try {
    const robot::InverseKinematics inverse(arm);
    const planning::ArmCollision collision = surroundings(*a_case, *tool, T_base_image);
    out.move = planning::plan_guide_move(collision, inverse, *start, {tool->tip_mm, tool->axis}, goal, options);
  } catch (const std::invalid_argument &wrong) {
    return refuse(std::string("no motion can be planned: ") + wrong.what());
  }
  if (!out.move.found()) {
    return refuse("no clear path to " + line->name + " was found: " + out.move.check.text);
  }
  char text[200];
  std::snprintf(text, sizeof text, "%s to %.0f mm before the entry of %s: %.0f mm, nearest %.0f mm (%s, %s)",
                tool->name.c_str(), standoff_mm, line->name.c_str(), out.move.check.length_mm,
                out.move.check.nearest.distance_mm, out.move.check.nearest.part.c_str(),
                out.move.check.nearest.obstacle.c_str());
  out.text = text;
  return out;
}

} // namespace bregma::server
