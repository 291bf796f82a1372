#include "server/stages/robot_motion/guide_plan.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include "algorithms/uncertainty/tre.hpp"
#include "idl/names.hpp"
#include "idl/validity.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

using geometry::Vector3d;
using geometry::frame::RobotBase;
using Reference = geometry::frame::Reference;
using Image = geometry::frame::Image;
using BaseFromImage = geometry::Rigid3<RobotBase, Image>;

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
  if (tracking.by_arm != inputs.a_case->arm_alone() || seen == end || seen->status != bregma_wire_POSE_LIVE) {
    why = carried + " is not live: its pose must be live and the registration verified";
    return nullptr;
  }
  return &*tool;
}

// Around the markers of a reference, with room for what holds them.
planning::NamedMesh block_around(const casefile::ToolModel &reference, const PatientPlace::Pose &T_base_reference) {
  constexpr double kRoom_mm = 10.0;
  Vector3d low = reference.markers_mm.front(), high = low;
  for (const Vector3d &marker : reference.markers_mm) {
    low = low.cwiseMin(marker);
    high = high.cwiseMax(marker);
  }
  planning::NamedMesh out =
      planning::block("the reference", low - Vector3d::Constant(kRoom_mm), high + Vector3d::Constant(kRoom_mm));
  for (Vector3d &vertex : out.mesh.vertices_mm) {
    vertex = T_base_reference * vertex;
  }
  return out;
}

// What is around the arm, and what it carries.
planning::ArmCollision surroundings(const casefile::Case &a_case, const casefile::RobotToolModel &tool,
                                    const BaseFromImage &T_base_image,
                                    const std::optional<PatientPlace::Pose> &T_base_reference) {
  const casefile::RobotEquipment &equipment = a_case.robot->equipment;
  planning::ArmScene scene;
  scene.table_z_mm = equipment.table_z_mm;
  surface::TriangleMesh head = a_case.scalp.mesh;
  for (Vector3d &vertex : head.vertices_mm) {
    vertex = T_base_image * vertex;
  }
  scene.obstacles.push_back({"the head", std::move(head)});
  if (const casefile::ToolModel *reference = a_case.reference();
      T_base_reference && reference != nullptr && !reference->markers_mm.empty()) {
    scene.obstacles.push_back(block_around(*reference, *T_base_reference));
  }
  planning::ArmBodies bodies;
  bodies.tools.push_back({tool.name, Vector3d::Zero(), tool.tip_mm, tool.radius_mm});
  for (const casefile::RangeSensorModel &sensor : equipment.sensors) {
    bodies.tools.push_back({sensor.name, Vector3d::Zero(), sensor.origin_mm, sensor.radius_mm});
  }
  return {*equipment.arm, std::move(bodies), scene};
}

// The base in the image with its error: registration, reference and hand-eye.
geometry::UncertainPose<Image, RobotBase> base_in_image(const GuidePlanInputs &inputs,
                                                        const std::optional<PatientPlace::Pose> &T_base_reference) {
  const wire::RegistrationState &accepted = *inputs.registration;
  const geometry::UncertainPose<Image, Reference> T_image_reference{
      wire::from_wire<Image, Reference>(accepted.accepted_T_image_reference),
      RowMajor<6>::Map(accepted.accepted_covariance)};
  if (!T_base_reference) { // Reference is the arm's base
    return {T_image_reference.pose.as<Image, RobotBase>(), T_image_reference.covariance};
  }
  const auto &T_base_tracker = inputs.a_case->hand_eye()->T_base_tracker;
  const geometry::UncertainPose<geometry::frame::Tracker, Reference> T_tracker_reference{
      T_base_tracker.pose.inverse() * *T_base_reference, RowMajor<6>::Map(inputs.reference->covariance)};
  return T_image_reference * geometry::inverse(T_base_tracker * T_tracker_reference);
}

HeadCorners corners_of(const surface::TriangleMesh &head, const geometry::Rigid3<Reference, Image> &T_reference_image) {
  Vector3d low = Vector3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const Vector3d &vertex : head.vertices_mm) {
    low = low.cwiseMin(vertex);
    high = high.cwiseMax(vertex);
  }
  HeadCorners out;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = T_reference_image * Vector3d((i & 1U) != 0 ? high.x() : low.x(), (i & 2U) != 0 ? high.y() : low.y(),
                                          (i & 4U) != 0 ? high.z() : low.z());
  }
  return out;
}

// Of the tip at the end of the path, 95 %.
double predicted_error_mm(const GuidePlanInputs &inputs, const geometry::UncertainPose<Image, RobotBase> &T_image_base,
                          const robot::FlangePose &flange, const casefile::RobotToolModel &tool) {
  const geometry::UncertainPose<RobotBase, geometry::frame::RobotFlange> T_base_flange{
      flange, flange_covariance(inputs.robot->covariance, flange.translation(), inputs.arm)};
  const Eigen::Matrix3d covariance = geometry::point_covariance(
      T_image_base * T_base_flange, tool.tip_mm, tool.sigma_mm * tool.sigma_mm * Eigen::Matrix3d::Identity());
  return uncertainty::ellipsoid_95(covariance).semi_axes_mm[0];
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
  std::optional<PatientPlace::Pose> T_base_reference;
  if (const casefile::HandEyeModel *hand_eye = a_case->hand_eye(); hand_eye != nullptr) {
    if (!inputs.robot->takes_permits) {
      return refuse("beside a tracker only an arm is moved whose driver obeys the daemon's permit: this one does not");
    }
    if (const std::string problem = planning_problem(*inputs.reference, hand_eye->flange_body, now_ns);
        !problem.empty()) {
      return refuse(problem);
    }
    if (!inputs.patient->settled()) {
      return refuse("the patient moves, or his reference has just been seen again");
    }
    T_base_reference = inputs.patient->mean();
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
  const geometry::UncertainPose<Image, RobotBase> T_image_base = base_in_image(inputs, T_base_reference);
  const BaseFromImage T_base_image = T_image_base.pose.inverse();
  planning::GuideGoal goal;
  goal.entry_mm = T_base_image * line->entry_mm;
  goal.direction = (T_base_image.rotation() * (line->target_mm - line->entry_mm)).normalized();
  goal.standoff_mm = standoff_mm;
  GuidePlan out;
  out.start = *start;
  out.accepted_revision = registration.accepted_revision;
  try {
    const robot::InverseKinematics inverse(arm);
    const planning::ArmCollision collision = surroundings(*a_case, *tool, T_base_image, T_base_reference);
    out.move = planning::plan_guide_move(collision, inverse, *start, {tool->tip_mm, tool->axis}, goal, options);
  } catch (const std::invalid_argument &wrong) {
    return refuse(std::string("no motion can be planned: ") + wrong.what());
  }
  if (!out.move.found()) {
    return refuse("no clear path to " + line->name + " was found: " + out.move.check.text);
  }
  out.predicted_95_mm = predicted_error_mm(inputs, T_image_base, out.move.waypoints.back(), *tool);
  char text[256];
  if (!(out.predicted_95_mm <= options.check.min_distance_mm)) {
    std::snprintf(
        text, sizeof text,
        "the predicted error of the tip, %.1f mm (95 %%), is larger than the distance that a path keeps, %.1f mm",
        out.predicted_95_mm, options.check.min_distance_mm);
    return refuse(text);
  }
  out.guide.tool = tool->name;
  out.guide.trajectory = line->name;
  out.guide.direction = (line->target_mm - line->entry_mm).normalized();
  out.guide.tip_mm = line->entry_mm - standoff_mm * out.guide.direction;
  out.guide.axis = tool->axis;
  if (T_base_reference) {
    out.guide.T_base_reference = T_base_reference;
    out.guide.head = corners_of(a_case->scalp.mesh, T_base_reference->inverse() * T_base_image);
    out.guide.flange_body = a_case->hand_eye()->flange_body;
  }
  std::snprintf(text, sizeof text,
                "%s to %.0f mm before the entry of %s: %.0f mm, nearest %.0f mm (%s, %s); predicted error of the tip "
                "%.1f mm (95 %%)",
                tool->name.c_str(), standoff_mm, line->name.c_str(), out.move.check.length_mm,
                out.move.check.nearest.distance_mm, out.move.check.nearest.part.c_str(),
                out.move.check.nearest.obstacle.c_str(), out.predicted_95_mm);
  out.text = text;
  return out;
}

} // namespace bregma::server
