#include "server/stages/navigation/pipeline.hpp"

#include <limits>

#include "algorithms/planning/trajectory_guidance.hpp"
#include "server/stages/schedules.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kStaleAfterPeriods = 3;
constexpr std::int64_t kPredictionAge_ns = 250'000'000;
constexpr double kSameTarget_mm = 0.01;    // tolerance between the end of a plan and its target
constexpr double kVelocityFilter_hz = 3.0; // for the velocity if the displayed position is not filtered

// Fields that are known only with a live pose.
void clear_pose(wire::NavigationState &state) noexcept {
  state.T_image_tip = wire::unknown_pose();
  put_unknown(state.velocity_mm_s);
  put_unknown(state.covariance);
  state.tre_rms_mm = wire::kUnknown;
  state.tre_95 = unknown_ellipsoid();
  state.distance_to_target_mm = state.lateral_deviation_mm = wire::kUnknown;
  state.angle_rad = state.remaining_depth_mm = wire::kUnknown;
  state.prediction = bregma_wire_DEFORMATION_NO_MODEL;
  put_unknown(state.predicted_target_mm);
  state.distance_to_predicted_target_mm = wire::kUnknown;
  (void)wire::set_name(state.nearest_structure, "");
  state.nearest_structure_mm = wire::kUnknown;
  put_unknown(state.position_velocity_covariance_mm2_s);
  put_unknown(state.velocity_covariance_mm2_s2);
  state.acceleration_sigma_mm_s2 = wire::kUnknown;
  state.plausibility_statistic = state.plausibility_threshold = wire::kUnknown;
}

} // namespace

NavigationPipeline::NavigationPipeline(const NavigationParameters &parameters, NavigationEvents &events)
    : parameters_(parameters), events_(events) {}

void NavigationPipeline::handle(const NavigationInput &input) noexcept {
  std::visit([this](const auto &content) noexcept { on(content); }, input);
}

void NavigationPipeline::end_states(std::int64_t now_ns) noexcept {
  for (std::size_t i = 0; i < tool_count_; ++i) {
    wire::NavigationState &state = states_[i];
    clear_pose(state);
    (void)wire::set_name(state.trajectory, "");
    state.status = bregma_wire_POSE_NOT_REGISTERED;
    state.session = bregma_wire_SESSION_UNKNOWN; // the change of the session follows the change of the case
    state.published_time_ns = now_ns;
    state.ended = true;
  }
}

void NavigationPipeline::on(const CaseChanged &change) noexcept {
  case_ = change.loaded;
  generation_ = change.generation;
  registration_.reset();
  reference_ = {};
  pivot_ = {};
  trace_ = {};
  tool_count_ = 0;
  if (case_ == nullptr) {
    return;
  }
  for (const casefile::ToolModel &model : case_->data->tools) {
    if (model.role == casefile::ToolRole::kReference || tool_count_ == tools_.size()) {
      continue;
    }
    Tool &tool = tools_[tool_count_];
    tool = Tool{};
    tool.model = &model;
    (void)wire::set_name(tool.name, model.name); // load_case rejects names that are too long
    states_[tool_count_] = wire::NavigationState{};
    copy_name(states_[tool_count_].tool, tool.name);
    clear_pose(states_[tool_count_]);
    ++tool_count_;
  }
}

void NavigationPipeline::on(const NavigationMessage &message) noexcept {
  struct Visitor {
    NavigationPipeline &self;
    void operator()(const SessionChanged &change) const noexcept { self.session_ = change; }
    void operator()(const CaptureRequest &request) const noexcept { self.touch_.start(request); }
    void operator()(const TraceRequest &request) const noexcept { self.trace_.request(request); }
    void operator()(const PivotRequest &request) const noexcept { self.pivot_ = request; }
    void operator()(const ToolTip &tip) const noexcept {
      if (Tool *tool = self.find(tip.tool)) {
        tool->calibrated = true;
        tool->tip_mm = vector_of(tip.tip_mm);
        tool->tip_covariance = matrix_of(tip.covariance_mm2);
        tool->filter.reset();
      }
    }
    void operator()(const PlanSelected &plan) const noexcept {
      if (Tool *tool = self.find(plan.tool)) {
        tool->plan = plan.on ? self.case_->data->trajectory(wire::view(plan.trajectory)) : nullptr;
      }
    }
    void operator()(const RegistrationAccepted &accepted) const noexcept {
      self.registration_ = Registration{wire::from_wire<frame::Image, frame::Reference>(accepted.T_image_reference),
                                        matrix_of(accepted.covariance)};
      self.reset_filters();
    }
    void operator()(const RegistrationReset &) const noexcept {
      self.registration_.reset();
      self.reset_filters();
    }
  };
  std::visit(Visitor{*this}, message);
}

void NavigationPipeline::reset_filters() noexcept {
  for (Tool &tool : tools_) {
    tool.filter.reset();
  }
}

NavigationPipeline::Tool *NavigationPipeline::find(const wire::Name &name) noexcept {
  for (std::size_t i = 0; i < tool_count_; ++i) {
    if (same(tools_[i].name, name)) {
      return &tools_[i];
    }
  }
  return nullptr;
}

NavigationPipeline::BodyInTracker NavigationPipeline::locate(const wire::TrackerFrame &frame,
                                                             const casefile::ToolModel &model) const noexcept {
  for (std::uint32_t i = 0; i < frame.tool_count; ++i) {
    const wire::TrackedTool &seen = frame.tools[i];
    if (wire::view(seen.tool) != model.name) {
      continue;
    }
    if (seen.status != bregma_wire_TOOL_VISIBLE && seen.status != bregma_wire_TOOL_PARTLY_VISIBLE) {
      return {};
    }
    const auto T = wire::from_wire<frame::Tracker, frame::Tool>(seen.T_tracker_tool);
    return {true,
            {T, registration::marker_fit_covariance(model.markers_mm, seen.used_markers, T,
                                                    parameters_.marker_sigma_lateral_mm,
                                                    parameters_.marker_sigma_depth_mm)}};
  }
  return {};
}

void NavigationPipeline::on_frame(const wire::TrackerFrame &frame, std::int64_t acquired_ns,
                                  std::int64_t now_ns) noexcept {
  any_frame_ = true;
  frame_ = frame.frame;
  frame_sent_ns_ = frame.sent_time_ns;
  copy_name(source_, frame.device);
  acquired_ns_ = acquired_ns;
  period_ns_ = frame.period_ns;
  if (case_ != nullptr) {
    const casefile::ToolModel *reference = case_->data->reference();
    reference_ = reference != nullptr ? locate(frame, *reference) : BodyInTracker{};
    for (std::size_t i = 0; i < tool_count_; ++i) {
      tools_[i].body = locate(frame, *tools_[i].model);
      record(tools_[i], acquired_ns);
    }
  }
  update_states(now_ns);
}

void NavigationPipeline::on_tick(std::int64_t now_ns) noexcept { update_states(now_ns); }

std::int64_t NavigationPipeline::stale_at_ns() const noexcept {
  return acquired_ns_ + ns_of_ms(parameters_.latency_ms) + kStaleAfterPeriods * period_ns_;
}

std::int64_t NavigationPipeline::lost_at_ns() const noexcept {
  return acquired_ns_ + ns_of_ms(parameters_.latency_ms) + wire::qos::kTracker.deadline_ns;
}

std::int64_t NavigationPipeline::next_change_ns() const noexcept {
  if (any_frame_ && evaluated_ns_ < stale_at_ns()) {
    return stale_at_ns();
  }
  if (any_frame_ && evaluated_ns_ < lost_at_ns()) {
    return lost_at_ns();
  }
  return std::numeric_limits<std::int64_t>::max();
}

NavigationPipeline::TipPose NavigationPipeline::tip_in_reference(const Tool &tool) const noexcept {
  const auto T_reference_tracker = geometry::inverse(geometry::UncertainPose<frame::Tracker, frame::Reference>{
      reference_.T_tracker_body.pose.as<frame::Tracker, frame::Reference>(), reference_.T_tracker_body.covariance});
  const geometry::UncertainPose<frame::Tool, frame::Tip> T_tool_tip{{Eigen::Quaterniond::Identity(), tool.tip_mm},
                                                                    Matrix6d::Zero()};
  return T_reference_tracker * tool.body.T_tracker_body * T_tool_tip;
}

// Passes this frame to the active recordings: touch, trace, pivot.
void NavigationPipeline::record(Tool &tool, std::int64_t acquired_ns) noexcept {
  const bool touching = touch_.busy() && same(touch_.tool(), tool.name);
  const bool tracing = trace_.on(tool.name);
  if (touching || tracing) {
    FrameContent content = FrameContent::kTip;
    TipInReference tip{};
    if (!reference_.visible) {
      content = FrameContent::kReferenceHidden;
    } else if (!tool.body.visible) {
      content = FrameContent::kToolHidden;
    } else if (!tool.calibrated) {
      content = FrameContent::kNotCalibrated;
    } else {
      const TipPose T = tip_in_reference(tool);
      const Matrix3d R = T.pose.rotation_matrix();
      tip = {T.pose.translation(), uncertainty::tre_covariance(T.covariance, T.pose.translation()),
             R * tool.tip_covariance * R.transpose()};
    }
    if (touching) {
      touch_.add(content, tip, frame_, acquired_ns);
    }
    if (tracing && content == FrameContent::kTip) {
      if (const auto sample = trace_.add(tip, frame_, acquired_ns)) {
        (void)events_.try_push(*sample); // a full ring counts dropped values
      }
    }
  }
  if (pivot_.on && same(pivot_.tool, tool.name) && tool.body.visible) {
    PivotPose pose{};
    pose.id = pivot_.id;
    pose.frame = frame_;
    pose.acquired_time_ns = acquired_ns;
    pose.T_tracker_tool = wire::to_wire(tool.body.T_tracker_body.pose);
    pose.reference_visible = reference_.visible;
    if (reference_.visible) {
      pose.T_reference_tool =
          wire::to_wire(reference_.T_tracker_body.pose.inverse().as<frame::Reference, frame::Tracker>() *
                        tool.body.T_tracker_body.pose);
    }
    (void)events_.try_push(pose);
  }
}

wire::PoseStatus NavigationPipeline::status_of(const Tool &tool, std::int64_t now_ns) const noexcept {
  if (!any_frame_ || now_ns >= lost_at_ns()) {
    return bregma_wire_POSE_LOST;
  }
  if (now_ns >= stale_at_ns()) {
    return bregma_wire_POSE_STALE;
  }
  if (!reference_.visible) {
    return bregma_wire_POSE_REFERENCE_HIDDEN;
  }
  if (!tool.body.visible) {
    return bregma_wire_POSE_TOOL_HIDDEN;
  }
  if (!tool.calibrated) {
    return bregma_wire_POSE_NOT_CALIBRATED;
  }
  if (!registration_) {
    return bregma_wire_POSE_NOT_REGISTERED;
  }
  return session_.verified ? bregma_wire_POSE_LIVE : bregma_wire_POSE_UNVERIFIED;
}

void NavigationPipeline::update_states(std::int64_t now_ns) noexcept {
  evaluated_ns_ = now_ns;
  if (const auto result = touch_.finish(now_ns)) {
    (void)events_.try_push(*result);
  }
  for (std::size_t i = 0; i < tool_count_; ++i) {
    publish(tools_[i], states_[i], now_ns);
  }
}

void NavigationPipeline::publish(Tool &tool, wire::NavigationState &state, std::int64_t now_ns) noexcept {
  state.frame = frame_;
  state.frame_sent_time_ns = frame_sent_ns_;
  state.acquired_time_ns = acquired_ns_;
  state.published_time_ns = now_ns;
  state.age_ns = any_frame_ ? now_ns - acquired_ns_ : 0;
  state.status = status_of(tool, now_ns);
  state.session = session_.state;
  state.source_kind = any_frame_ ? bregma_wire_DEVICE_TRACKER : bregma_wire_DEVICE_UNKNOWN;
  copy_name(state.source, source_);
  (void)wire::set_name(state.trajectory, tool.plan != nullptr ? std::string_view(tool.plan->name) : std::string_view());
  if (state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED) {
    fill_pose(tool, state);
  } else {
    tool.filter.reset();
    clear_pose(state);
  }
}

// The frame's pose with the filter's position, or unfiltered if configured. The velocity always comes from the filter.
// Rotation and its error are those of the frame, the position's error is that of the filter, and their
// cross-covariance is reduced by the filter's gain.
NavigationPipeline::TipPose NavigationPipeline::filtered(Tool &tool, const TipPose &T_reference_tip) const noexcept {
  // Conversion between perturbations about Reference's origin and about the tip.
  Matrix6d about_tip = Matrix6d::Identity();
  about_tip.bottomLeftCorner<3, 3>() = -geometry::skew(T_reference_tip.pose.translation());
  Matrix6d covariance = about_tip * T_reference_tip.covariance * about_tip.transpose();
  const bool shown = parameters_.filter_hz > 0.0;
  tool.filter.add(T_reference_tip.pose.translation(), covariance.bottomRightCorner<3, 3>(), acquired_ns_,
                  shown ? parameters_.filter_hz : kVelocityFilter_hz);
  if (!shown) {
    return T_reference_tip;
  }
  covariance.bottomRightCorner<3, 3>() = tool.filter.covariance();
  covariance.topRightCorner<3, 3>() = (covariance.topRightCorner<3, 3>() * tool.filter.gain().transpose()).eval();
  covariance.bottomLeftCorner<3, 3>() = covariance.topRightCorner<3, 3>().transpose();
  about_tip.bottomLeftCorner<3, 3>() = geometry::skew(tool.filter.position_mm());
  return {{T_reference_tip.pose.rotation(), tool.filter.position_mm()}, about_tip * covariance * about_tip.transpose()};
}

void NavigationPipeline::fill_pose(Tool &tool, wire::NavigationState &state) noexcept {
  TipPose T_reference_tip = filtered(tool, tip_in_reference(tool));
  // The tip's calibration error, in the axes of Reference, affects only the tip's position.
  const Matrix3d R = T_reference_tip.pose.rotation_matrix();
  T_reference_tip.covariance.bottomRightCorner<3, 3>() += R * tool.tip_covariance * R.transpose();
  const auto T_image_tip = *registration_ * T_reference_tip;
  const Vector3d tip = T_image_tip.pose.translation();

  state.T_image_tip = wire::to_wire(T_image_tip.pose);
  put(T_image_tip.covariance, state.covariance);
  const Matrix3d position_covariance = uncertainty::tre_covariance(T_image_tip.covariance, tip);
  state.tre_rms_mm = uncertainty::rms_mm(position_covariance);
  state.tre_95 = to_wire(uncertainty::ellipsoid_95(position_covariance));

  put(registration_->pose.rotation() * tool.filter.velocity_mm_s(), state.velocity_mm_s);

  state.distance_to_target_mm = state.lateral_deviation_mm = wire::kUnknown;
  state.angle_rad = state.remaining_depth_mm = wire::kUnknown;
  if (tool.plan != nullptr) {
    const Vector3d axis = T_image_tip.pose.rotation() * tool.model->axis;
    const auto guidance = planning::guide({tool.plan->entry_mm, tool.plan->target_mm}, tip, axis);
    state.distance_to_target_mm = guidance.distance_to_target_mm;
    state.lateral_deviation_mm = guidance.lateral_deviation_mm;
    state.angle_rad = guidance.angle_rad;
    state.remaining_depth_mm = guidance.remaining_depth_mm;
  }
  fill_prediction(tool, state);
  const auto nearest = case_->structures.nearest(tip, tool.warm);
  (void)wire::set_name(state.nearest_structure, nearest.index >= 0
                                                    ? std::string_view(case_->structures.name(nearest.index))
                                                    : std::string_view());
  state.nearest_structure_mm = nearest.index >= 0 ? nearest.distance_mm : wire::kUnknown;
}

// Fields about the predicted position of the plan's target, if the tissue model provides it.
void NavigationPipeline::fill_prediction(const Tool &tool, wire::NavigationState &state) const noexcept {
  state.prediction = bregma_wire_DEFORMATION_NO_MODEL;
  put_unknown(state.predicted_target_mm);
  state.distance_to_predicted_target_mm = wire::kUnknown;
  const bool young = predicted_.generation == generation_ && evaluated_ns_ - predicted_.time_ns < kPredictionAge_ns;
  if (tool.plan == nullptr || !young) {
    return;
  }
  const auto &targets = case_->data->targets;
  const std::size_t count = std::min<std::size_t>(targets.size(), bregma_wire_MAX_TARGETS);
  for (std::size_t i = 0; i < count; ++i) {
    if ((targets[i].position_mm - tool.plan->target_mm).norm() > kSameTarget_mm) {
      continue;
    }
    state.prediction = predicted_.status[i];
    const Vector3d target = Vector3d::Map(predicted_.position_mm[i]); // NaN if it must not be shown
    put(target, state.predicted_target_mm);
    state.distance_to_predicted_target_mm = (target - Vector3d::Map(state.T_image_tip.translation_mm)).norm();
    return;
  }
}

ProbeView NavigationPipeline::probe() const noexcept {
  ProbeView view;
  for (std::size_t i = 0; i < tool_count_; ++i) {
    const wire::NavigationState &state = states_[i];
    if (tools_[i].model->role != casefile::ToolRole::kProbe || state.status != bregma_wire_POSE_LIVE) {
      continue;
    }
    const Vector3d shaft = -tools_[i].model->axis.normalized();
    const auto T_image_tip = wire::from_wire<frame::Image, frame::Tip>(state.T_image_tip);
    view.live = true;
    view.acquired_ns = state.acquired_time_ns;
    Vector3d::Map(view.tip_mm) = T_image_tip.translation();
    Vector3d::Map(view.shaft) = T_image_tip.rotation() * shaft;
    Vector3d::Map(view.shaft_in_tool) = shaft;
    return view;
  }
  return view;
}

} // namespace bregma::server
