#include "server/stages/navigation/pipeline.hpp"

#include <algorithm>
#include <limits>

#include "server/stages/schedules.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kMeasuredPeriods = 3;       // maximal age of a frame that is measured with
constexpr std::int64_t kMinStale_ns = 100'000'000; // a pose is stale for at least this time before it is lost

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
  const bool was_by_arm = by_arm();
  case_ = change.loaded;
  any_frame_ = any_frame_ && was_by_arm == by_arm(); // the last frame was of another kind of source
  arm_ = {};
  hand_eye_ = case_ != nullptr ? case_->data->hand_eye() : nullptr;
  flange_model_ = hand_eye_ != nullptr ? case_->data->tool(hand_eye_->flange_body) : nullptr;
  flanges_.clear();
  pending_count_ = 0;
  flange_body_ = {};
  hand_eye_check_.reset();
  generation_ = change.generation;
  registration_.reset();
  reference_ = {};
  judge_.reset();
  pivot_ = {};
  trace_ = {};
  tool_count_ = 0;
  if (case_ == nullptr) {
    return;
  }
  for (const casefile::ToolModel &model : case_->data->tools) {
    if (model.role == casefile::ToolRole::kReference || &model == flange_model_ || tool_count_ == tools_.size()) {
      continue;
    }
    Tool &tool = tools_[tool_count_];
    tool = Tool{};
    tool.model = &model;
    tool.carried = hand_eye_ != nullptr && case_->data->carried_by_arm(model.name);
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
      self.judge_.guard(true);
      self.reset_filters();
    }
    void operator()(const RegistrationReset &) const noexcept {
      self.registration_.reset();
      self.judge_.guard(false);
      self.reset_filters();
    }
    void operator()(const TrackingConfirmed &confirmed) const noexcept {
      if (const Tool *tool = self.find(confirmed.tool)) {
        self.judge_.confirm(self.index_of(*tool));
      }
    }
  };
  std::visit(Visitor{*this}, message);
}

void NavigationPipeline::reset_filters() noexcept {
  for (Tool &tool : tools_) {
    tool.filter.reset();
    tool.turn_rate.reset();
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

bool NavigationPipeline::on_frame(const wire::TrackerFrame &frame, const Exposure &exposure,
                                  std::int64_t now_ns) noexcept {
  if (hand_eye_ == nullptr) {
    take(frame, exposure, now_ns);
    return true;
  }
  const std::uint64_t updates = updates_;
  if (pending_count_ == kMaxPending) { // a tracker far faster than the arm
    take(pending_[0].frame, pending_[0].exposure, now_ns);
    std::move(pending_.begin() + 1, pending_.end(), pending_.begin());
    --pending_count_;
  }
  pending_[pending_count_++] = {frame, exposure};
  take_pending(now_ns);
  return updates_ != updates;
}

// Frames whose flange has come, or does not come.
void NavigationPipeline::take_pending(std::int64_t now_ns) noexcept {
  std::size_t taken = 0;
  while (taken < pending_count_ && !waits(std::min(pending_[taken].exposure.acquired_ns, now_ns), now_ns)) {
    take(pending_[taken].frame, pending_[taken].exposure, now_ns);
    ++taken;
  }
  const auto first = pending_.begin() + static_cast<std::ptrdiff_t>(taken);
  std::move(first, pending_.begin() + static_cast<std::ptrdiff_t>(pending_count_), pending_.begin());
  pending_count_ -= taken;
}

// Not for an arm that is silent: the tracked tools are shown as without it.
bool NavigationPipeline::waits(std::int64_t exposed_ns, std::int64_t now_ns) const noexcept {
  return !flanges_.reaches(exposed_ns) && now_ns - exposed_ns < kFlangeWait_ns &&
         now_ns - arm_.anew_ns < kFlangeWait_ns;
}

void NavigationPipeline::take(const wire::TrackerFrame &frame, const Exposure &exposure, std::int64_t now_ns) noexcept {
  any_frame_ = true;
  frame_ = frame.frame;
  frame_sent_ns_ = exposure.written_ns;
  copy_name(source_, frame.device);
  exposure_ = exposure;
  exposure_.acquired_ns = std::min(exposure.acquired_ns, now_ns); // an estimate; none is later than the arrival
  if (case_ != nullptr) {
    if (const casefile::ToolModel *reference = case_->data->reference()) {
      locate(frame, *reference, reference_);
    }
    for (std::size_t i = 0; i < tool_count_; ++i) {
      if (tools_[i].carried) {
        carry_beside(tools_[i]);
      } else {
        locate(frame, *tools_[i].model, tools_[i].body);
      }
    }
    check_hand_eye(frame);
    evaluate(now_ns);
    share_reference();
  }
  update_states(now_ns);
}

bool NavigationPipeline::on_arm(const FlangeSample &sample, std::int64_t now_ns) noexcept {
  if (!has_arm() || wire::view(sample.device) != case_->data->robot->device) {
    return false;
  }
  if (hand_eye_ != nullptr) {
    const std::uint64_t updates = updates_;
    watch_arm(sample, now_ns);
    take_pending(now_ns);
    return updates_ != updates;
  }
  any_frame_ = true;
  frame_ = sample.frame;
  frame_sent_ns_ = sample.written_ns;
  copy_name(source_, sample.device);
  exposure_ = {std::min(sample.acquired_ns, now_ns), sample.age_sigma_ns, sample.period_ns, sample.written_ns};
  watch_arm(sample, now_ns);
  place_base();
  for (std::size_t i = 0; i < tool_count_; ++i) {
    carry(sample, tools_[i]);
  }
  evaluate(now_ns);
  update_states(now_ns);
  return true;
}

void NavigationPipeline::evaluate(std::int64_t now_ns) noexcept {
  judge();
  malformed_bodies_ += reference_.malformed() ? 1 : 0;
  for (std::size_t i = 0; i < tool_count_; ++i) {
    malformed_bodies_ += tools_[i].body.malformed() ? 1 : 0;
    record(tools_[i], now_ns);
  }
}

void NavigationPipeline::on_tick(std::int64_t now_ns) noexcept {
  take_pending(now_ns);
  update_states(now_ns);
}

std::int64_t NavigationPipeline::acquired_ns(const Tool &tool) const noexcept {
  const bool posed = reference_.visible && tool.body.visible;
  return posed ? std::min(reference_.acquired_ns, tool.body.acquired_ns) : exposure_.acquired_ns;
}

std::int64_t NavigationPipeline::live_limit_ns() const noexcept {
  return wire::live_limit_ns(parameters_.live_limit_ms, exposure_.period_ns);
}

std::int64_t NavigationPipeline::stale_at_ns(const Tool &tool) const noexcept {
  return acquired_ns(tool) + live_limit_ns();
}

std::int64_t NavigationPipeline::lost_at_ns() const noexcept {
  const std::int64_t deadline_ns = ns_of_ms(parameters_.latency_ms) + wire::qos::kTracker.deadline_ns;
  return exposure_.acquired_ns + std::max(deadline_ns, live_limit_ns() + kMinStale_ns);
}

// Measuring is stricter than showing: three frame periods after the frame was due.
std::int64_t NavigationPipeline::measured_until_ns(std::int64_t acquired_ns) const noexcept {
  return acquired_ns + ns_of_ms(parameters_.latency_ms) + kMeasuredPeriods * exposure_.period_ns;
}

std::int64_t NavigationPipeline::next_change_ns() const noexcept {
  std::int64_t next_ns = std::numeric_limits<std::int64_t>::max();
  const auto consider = [&](std::int64_t time_ns) {
    next_ns = any_frame_ && time_ns > evaluated_ns_ ? std::min(next_ns, time_ns) : next_ns;
  };
  consider(lost_at_ns());
  for (std::size_t i = 0; i < tool_count_; ++i) {
    consider(stale_at_ns(tools_[i]));
  }
  return next_ns;
}

FrameContent NavigationPipeline::content_of(const Tool &tool, bool check_touch, std::int64_t now_ns) const noexcept {
  if (reference_.malformed() || tool.body.malformed()) {
    return FrameContent::kImplausible;
  }
  if (!reference_.visible) {
    return FrameContent::kReferenceHidden;
  }
  if (!tool.body.visible) {
    return FrameContent::kToolHidden;
  }
  if (!tool.calibrated) {
    return FrameContent::kNotCalibrated;
  }
  const std::size_t index = index_of(tool);
  if (misplaced(tool) || !(check_touch ? judge_.steady(index) : judge_.trusted(index))) {
    return FrameContent::kImplausible;
  }
  const bool repeated = acquired_ns(tool) != exposure_.acquired_ns;
  return repeated || now_ns > measured_until_ns(exposure_.acquired_ns) ? FrameContent::kNotNew : FrameContent::kTip;
}

// Passes this frame to the active recordings: touch, trace, pivot.
void NavigationPipeline::record(Tool &tool, std::int64_t now_ns) noexcept {
  const bool touching = touch_.busy() && same(touch_.tool(), tool.name);
  const bool tracing = trace_.on(tool.name);
  if (touching || tracing) {
    const bool check_touch = touching && touch_.kind() == bregma_wire_CAPTURE_CHECK;
    const FrameContent content = content_of(tool, check_touch, now_ns);
    TipInReference tip{};
    if (content == FrameContent::kTip) {
      const TipPose T = tip_in_reference(tool);
      const Matrix3d R = T.pose.rotation_matrix();
      tip = {T.pose.translation(), uncertainty::tre_covariance(T.covariance, T.pose.translation()),
             R * tool.tip_covariance * R.transpose(), Matrix3d::Zero()};
      if (tool.carried) {
        tip.common_covariance = uncertainty::tre_covariance(hand_eye_covariance(), tip.position_mm);
      }
    }
    if (touching) {
      touch_.add(content, tip, frame_, exposure_.acquired_ns);
    }
    if (tracing && content == FrameContent::kTip) {
      if (const auto sample = trace_.add(tip, frame_, exposure_.acquired_ns)) {
        (void)events_.try_push(*sample); // a full ring counts dropped values
      }
    }
  }
  const bool fresh = tool.body.visible && judge_.tool(index_of(tool)).steady() &&
                     tool.body.acquired_ns == exposure_.acquired_ns &&
                     now_ns <= measured_until_ns(exposure_.acquired_ns);
  if (pivot_.on && same(pivot_.tool, tool.name) && fresh) {
    PivotPose pose{};
    pose.id = pivot_.id;
    pose.frame = frame_;
    pose.acquired_time_ns = exposure_.acquired_ns;
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
  if (now_ns >= exposure_.acquired_ns + live_limit_ns()) {
    return bregma_wire_POSE_STALE;
  }
  if (reference_.malformed() || tool.body.malformed()) {
    return bregma_wire_POSE_IMPLAUSIBLE;
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
  if (misplaced(tool) || !judge_.trusted(index_of(tool))) {
    return bregma_wire_POSE_IMPLAUSIBLE;
  }
  if (now_ns >= stale_at_ns(tool)) { // frames arrive, but repeat an old pose
    return bregma_wire_POSE_STALE;
  }
  return session_.verified ? bregma_wire_POSE_LIVE : bregma_wire_POSE_UNVERIFIED;
}

} // namespace bregma::server
