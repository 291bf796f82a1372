// From a tracker's frame to the bodies in it: visible, well-formed, plausible; and the tip of a tool in Reference.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>

#include "algorithms/registration/points/paired_points.hpp"
#include "server/stages/navigation/pipeline.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

using inputs::MarkerFault;

// 1 sigma between the times of an arm and of a tracker: no stated latency is better.
constexpr std::int64_t kBetweenDevices_ns = 2'000'000;

// Expected RMS residual of a fit to n markers: of the 3n coordinates' errors the fit takes up 6, of any direction.
double expected_residual_mm(int markers, const NavigationParameters &parameters) noexcept {
  const double variance = 2.0 * parameters.marker_sigma_lateral_mm * parameters.marker_sigma_lateral_mm +
                          parameters.marker_sigma_depth_mm * parameters.marker_sigma_depth_mm;
  return std::sqrt(variance * (markers - 2.0) / markers);
}

bool is_same(const wire::Pose &a, const wire::Pose &b) noexcept {
  return std::ranges::equal(a.rotation_wxyz, b.rotation_wxyz) && std::ranges::equal(a.translation_mm, b.translation_mm);
}

Matrix6d stated_covariance(const wire::PoseCovariance &upper) noexcept {
  Matrix6d out;
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = row; column < 6; ++column) {
      const double entry = upper[wire::upper_index(row, column)];
      out(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column)) = entry;
      out(static_cast<Eigen::Index>(column), static_cast<Eigen::Index>(row)) = entry;
    }
  }
  return out;
}

template <class A, class B>
BodySample sample_of(const geometry::UncertainPose<A, B> &T, const Vector3d &point, std::int64_t time_ns) noexcept {
  const Vector3d at = T.pose * point;
  return {time_ns, at, uncertainty::tre_covariance(T.covariance, at).trace(), T.pose.rotation(),
          T.covariance.template topLeftCorner<3, 3>().trace()};
}

} // namespace

void NavigationPipeline::locate(const wire::TrackerFrame &frame, const casefile::ToolModel &model,
                                BodyInTracker &body) const noexcept {
  body.visible = false;
  body.in_frame = {};
  for (std::uint32_t i = 0; i < frame.tool_count; ++i) {
    const wire::TrackedTool &seen = frame.tools[i];
    if (wire::view(seen.tool) == model.name) {
      if (seen.status == bregma_wire_TOOL_VISIBLE || seen.status == bregma_wire_TOOL_PARTLY_VISIBLE) {
        locate(seen, model, body);
      }
      return;
    }
  }
}

void NavigationPipeline::locate(const wire::TrackedTool &seen, const casefile::ToolModel &model,
                                BodyInTracker &body) const noexcept {
  const std::vector<Vector3d> &markers = model.markers_mm;
  const auto T = wire::from_wire<frame::Tracker, frame::Tool>(seen.T_tracker_tool);
  MarkerFault fault = inputs::check_markers(seen, markers.size());
  if (fault == MarkerFault::kNone) {
    body.T_tracker_body = {T, markers.empty() ? stated_covariance(seen.covariance)
                                              : registration::marker_fit_covariance(markers, seen.used_markers, T,
                                                                                    parameters_.marker_sigma_lateral_mm,
                                                                                    parameters_.marker_sigma_depth_mm)};
    fault = body.T_tracker_body.covariance.allFinite() ? MarkerFault::kNone : MarkerFault::kTooFew; // on one line
  }
  BodyFrame &out = body.in_frame;
  out.markers = std::popcount(seen.used_markers);
  if (fault != MarkerFault::kNone) {
    out.content = BodyFrame::Content::kMalformed;
    body.fault = fault;
    body.used_markers = seen.used_markers;
    return;
  }
  body.visible = true;
  if (body.acquired_ns == 0 || !is_same(body.pose, seen.T_tracker_tool)) {
    out.content = BodyFrame::Content::kNew;
    body.pose = seen.T_tracker_tool;
    body.acquired_ns = exposure_.acquired_ns;
  } else {
    out.content = BodyFrame::Content::kRepeated;
    out.repeated_ns = exposure_.acquired_ns - body.acquired_ns;
  }
  const Vector3d middle = std::accumulate(markers.begin(), markers.end(), Vector3d(Vector3d::Zero())) /
                          std::max<double>(1.0, static_cast<double>(markers.size()));
  out.volume = parameters_.volume.position(T * middle);
  if (!markers.empty()) {
    out.residual_mm = seen.marker_rms_mm;
    out.expected_residual_mm = expected_residual_mm(out.markers, parameters_);
  }
}

// Another arm under this name, or another tool at its flange: what is known of the place of tip and base is void until
// a landmark was touched.
void NavigationPipeline::watch_arm(const FlangeSample &sample, std::int64_t now_ns) noexcept {
  const bool replaced = arm_.seen && sample.incarnation != arm_.incarnation;
  if (replaced) {
    flanges_.clear();
  }
  if (replaced || (arm_.seen && !same(sample.tool, arm_.tool))) {
    judge_.require_touch();
  }
  arm_.replaced = arm_.replaced || replaced;
  arm_.seen = true;
  arm_.seen_ns = sample.acquired_ns;
  if (sample.measured_anew) {
    arm_.anew_ns = sample.acquired_ns;
    const auto T = wire::from_wire<frame::RobotBase, frame::RobotFlange>(sample.T_base_flange);
    flanges_.add({sample.acquired_ns,
                  std::max(sample.age_sigma_ns, kBetweenDevices_ns),
                  sample.period_ns,
                  {T, flange_covariance(sample.covariance, T.translation(), parameters_.arm)}});
  }
  arm_.incarnation = sample.incarnation;
  copy_name(arm_.tool, sample.tool);
  if (arm_.replaced && events_.try_push(ArmReplaced{now_ns})) { // a full ring: with the next sample
    arm_.replaced = false;
  }
}

void NavigationPipeline::place_base() noexcept {
  reference_.visible = true;
  // Exact, but for the filters of the plausibility, which cannot divide by a variance of zero.
  constexpr double kExact = 1e-12;
  reference_.T_tracker_body = {{}, kExact * Matrix6d::Identity()};
  reference_.acquired_ns = exposure_.acquired_ns;
  reference_.in_frame = {};
  reference_.in_frame.content = BodyFrame::Content::kNew;
}

void NavigationPipeline::carry(const FlangeSample &sample, Tool &tool) noexcept {
  BodyInTracker &body = tool.body;
  const bool was_carried = body.visible;
  body.visible = same(sample.tool, tool.name);
  body.in_frame = {};
  if (!body.visible) {
    return;
  }
  const auto T = wire::from_wire<frame::Tracker, frame::Tool>(sample.T_base_flange);
  body.T_tracker_body = {T, flange_covariance(sample.covariance, T.translation(), parameters_.arm)};
  body.pose = sample.T_base_flange;
  if (!was_carried || sample.measured_anew) {
    body.in_frame.content = BodyFrame::Content::kNew;
    body.acquired_ns = exposure_.acquired_ns;
  } else {
    body.in_frame.content = BodyFrame::Content::kRepeated;
    body.in_frame.repeated_ns = exposure_.acquired_ns - body.acquired_ns;
  }
}

void NavigationPipeline::carry_beside(Tool &tool) noexcept {
  BodyInTracker &body = tool.body;
  body.visible = false;
  body.in_frame = {};
  if (!arm_.seen || !same(arm_.tool, tool.name)) {
    return;
  }
  const auto flange = flanges_.at(exposure_.acquired_ns);
  if (!flange) {
    if (arm_.seen_ns > arm_.anew_ns) { // numbers go on, and measure nothing
      body.in_frame.content = BodyFrame::Content::kRepeated;
      body.in_frame.repeated_ns = std::max<std::int64_t>(exposure_.acquired_ns - arm_.anew_ns, 0);
    }
    return;
  }
  const geometry::UncertainPose<frame::Tracker, frame::RobotBase> T_tracker_base{
      hand_eye_->T_base_tracker.pose.inverse(), Matrix6d::Zero()};
  const auto T = T_tracker_base * *flange;
  body.visible = true;
  body.T_tracker_body = {T.pose.as<frame::Tracker, frame::Tool>(), T.covariance};
  body.acquired_ns = exposure_.acquired_ns;
  body.in_frame.content = BodyFrame::Content::kNew;
}

void NavigationPipeline::check_hand_eye(const wire::TrackerFrame &frame) noexcept {
  if (hand_eye_ == nullptr || flange_model_ == nullptr) {
    return;
  }
  locate(frame, *flange_model_, flange_body_);
  const auto flange = flanges_.at(exposure_.acquired_ns);
  if (flange && flange_body_.visible && flange_body_.in_frame.content == BodyFrame::Content::kNew) {
    hand_eye_check_.add(*hand_eye_, *flange, flange_body_.T_tracker_body, exposure_.acquired_ns);
  }
}

void NavigationPipeline::share_reference() noexcept {
  const bool fresh = reference_.visible && reference_.acquired_ns == exposure_.acquired_ns;
  if (hand_eye_ == nullptr || references_ == nullptr || !fresh || !judge_.reference_trusted() ||
      hand_eye_check_.disagrees()) {
    return;
  }
  ReferenceSample out;
  out.acquired_ns = exposure_.acquired_ns;
  out.age_sigma_ns = exposure_.sigma_ns;
  out.period_ns = exposure_.period_ns;
  out.T_tracker_reference = wire::to_wire(reference_.T_tracker_body.pose);
  put(reference_.T_tracker_body.covariance, out.covariance);
  (void)references_->try_push(out); // a full ring counts dropped values
}

ReferenceView NavigationPipeline::reference_view() const noexcept {
  ReferenceView out;
  out.visible = reference_.visible;
  out.trusted = judge_.reference_trusted() && !reference_.malformed();
  out.acquired_ns = reference_.acquired_ns;
  out.period_ns = exposure_.period_ns;
  out.limit_ns = live_limit_ns();
  out.T_tracker_reference = wire::to_wire(reference_.T_tracker_body.pose);
  put(reference_.T_tracker_body.covariance, out.covariance);
  out.hand_eye = hand_eye_check_.view();
  return out;
}

Matrix6d NavigationPipeline::hand_eye_covariance() const noexcept {
  const auto T_reference_tracker = reference_.T_tracker_body.pose.as<frame::Tracker, frame::Reference>().inverse();
  const auto T_reference_base = T_reference_tracker * hand_eye_->T_base_tracker.pose.inverse();
  const Matrix6d ad = geometry::adjoint(T_reference_base);
  return ad * hand_eye_->T_base_tracker.covariance * ad.transpose();
}

// Tests the bodies of the last frame, and inflates the covariances of those whose markers fit badly.
void NavigationPipeline::judge() noexcept {
  if (reference_.visible) {
    const geometry::UncertainPose<frame::Tracker, frame::Tool> &T = reference_.T_tracker_body;
    reference_.in_frame.sample = sample_of(T, Vector3d::Zero(), exposure_.acquired_ns);
    reference_.in_frame.placed = true;
  }
  std::array<BodyFrame, bregma_wire_MAX_TOOLS> bodies;
  for (std::size_t i = 0; i < tool_count_; ++i) {
    Tool &tool = tools_[i];
    if (tool.body.visible && reference_.visible) {
      tool.body.in_frame.sample = sample_of(tool_in_reference(tool), tool.model->nominal_tip_mm, exposure_.acquired_ns);
      tool.body.in_frame.placed = true;
    }
    bodies[i] = tool.body.in_frame;
  }
  judge_.judge(reference_.in_frame, {bodies.data(), tool_count_}, live_limit_ns());
  reference_.T_tracker_body.covariance *= judge_.reference().inflation();
  for (std::size_t i = 0; i < tool_count_; ++i) {
    tools_[i].body.T_tracker_body.covariance *= judge_.tool(i).inflation();
  }
}

NavigationPipeline::ToolInReference NavigationPipeline::tool_in_reference(const Tool &tool) const noexcept {
  const auto T_reference_tracker = geometry::inverse(geometry::UncertainPose<frame::Tracker, frame::Reference>{
      reference_.T_tracker_body.pose.as<frame::Tracker, frame::Reference>(), reference_.T_tracker_body.covariance});
  return T_reference_tracker * tool.body.T_tracker_body;
}

NavigationPipeline::TipPose NavigationPipeline::tip_in_reference(const Tool &tool) const noexcept {
  const geometry::UncertainPose<frame::Tool, frame::Tip> T_tool_tip{{Eigen::Quaterniond::Identity(), tool.tip_mm},
                                                                    Matrix6d::Zero()};
  return tool_in_reference(tool) * T_tool_tip;
}

BodyReport NavigationPipeline::reference_report() const noexcept {
  return {judge_.reference_judgement(), judge_.reference().refusals(), reference_.fault, reference_.used_markers};
}

BodyReport NavigationPipeline::report(std::size_t tool) const noexcept {
  const BodyInTracker &body = tools_[tool].body;
  return {judge_.tool(tool).judgement(), judge_.tool(tool).refusals(), body.fault, body.used_markers};
}

} // namespace bregma::server
