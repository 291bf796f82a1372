#include "server/stages/robot_motion/guide_watch.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "idl/names.hpp"

namespace bregma::server {

namespace {

constexpr const char *kNotSeen = "the patient's reference is not seen by the tracker";

const TrackingView::Tool *shown_tool(const TrackingView &tracking, const std::string &name) {
  const auto *end = tracking.tools + tracking.tool_count;
  const auto *tool = std::find_if(tracking.tools, end, [&](const auto &one) { return wire::view(one.tool) == name; });
  return tool != end ? tool : nullptr;
}

} // namespace

std::string following_problem(const ReferenceView &reference, const std::string &flange_body, std::int64_t now_ns) {
  char text[200] = {};
  if (reference.hand_eye.disagrees) {
    std::snprintf(text, sizeof text,
                  "the tracker or the arm's base is not where hand-eye was calibrated (%.1f mm): calibrate it anew",
                  reference.hand_eye.distance_mm);
    return text;
  }
  const std::int64_t age_ns = now_ns - reference.acquired_ns;
  if (reference.acquired_ns == 0 || age_ns > reference.limit_ns) {
    return reference.visible ? "the patient's reference is not measured: its last pose is too old" : kNotSeen;
  }
  if (!reference.trusted) {
    return "the poses of the patient's reference are not plausible";
  }
  if (flange_body.empty()) {
    return "nothing checks hand-eye: the case states no body on the flange (flange_body)";
  }
  if (reference.acquired_ns - reference.hand_eye.checked_ns > kUncheckedMotion_ns) {
    return "nothing checks hand-eye: " + flange_body + " on the flange is not seen by the tracker";
  }
  return {};
}

std::string planning_problem(const ReferenceView &reference, const std::string &flange_body, std::int64_t now_ns) {
  std::string problem = following_problem(reference, flange_body, now_ns);
  return problem.empty() && !reference.visible ? kNotSeen : problem;
}

double displacement_mm(const HeadCorners &head, const PatientPlace::Pose &from, const PatientPlace::Pose &to) {
  double out = 0.0;
  for (const geometry::Vector3d &corner : head) {
    const double way_mm = (to * corner - from * corner).norm();
    if (!std::isfinite(way_mm)) {
      return std::numeric_limits<double>::infinity();
    }
    out = std::max(out, way_mm);
  }
  return out;
}

std::string guide_problem(const WatchedGuide &guide, const PatientPlace &patient, const ReferenceView &reference,
                          const TrackingView &tracking, std::int64_t now_ns) {
  if (!guide.T_base_reference) {
    return {};
  }
  if (std::string problem = following_problem(reference, guide.flange_body, now_ns); !problem.empty()) {
    return problem;
  }
  const double moved_mm = patient.known() ? displacement_mm(guide.head, *guide.T_base_reference, patient.mean()) : 0.0;
  if (!(moved_mm <= guide.max_patient_mm)) {
    char text[160] = {};
    std::snprintf(text, sizeof text, "the patient has moved by %.1f mm since the path was planned (limit %.1f mm)",
                  moved_mm, guide.max_patient_mm);
    return text;
  }
  // The view of the tools is made less often than that of the reference, which has been judged above.
  const TrackingView::Tool *tool = shown_tool(tracking, guide.tool);
  if (tool == nullptr || (tool->status != bregma_wire_POSE_LIVE && tool->status != bregma_wire_POSE_REFERENCE_HIDDEN)) {
    return guide.tool + " is not live";
  }
  return {};
}

GuideEnd guide_end(const WatchedGuide &guide, const TrackingView &tracking) {
  const TrackingView::Tool *tool = shown_tool(tracking, guide.tool);
  if (tool == nullptr || tool->status != bregma_wire_POSE_LIVE) {
    return {};
  }
  const auto T_image_tip = wire::from_wire<geometry::frame::Image, geometry::frame::Tip>(tool->T_image_tip);
  GuideEnd out;
  out.live = true;
  out.off_mm = (T_image_tip.translation() - guide.tip_mm).norm();
  out.angle_rad = std::acos(std::clamp((T_image_tip.rotation() * guide.axis).dot(guide.direction), -1.0, 1.0));
  out.tre_95_mm = tool->tre_95_mm;
  return out;
}

} // namespace bregma::server
