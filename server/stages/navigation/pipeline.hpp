// The navigation pipeline: from a tracker frame to each tool's tip in the image, its accuracy, and its position
// relative to the plan and the critical structures.
//
// T_image_tip = T_image_reference (T_tracker_reference)^-1 T_tracker_tool T_tool_tip, all of the same frame. The motion
// of the tip in Reference is filtered (tip_filter.hpp). The covariance is propagated to first order from the markers of
// both bodies, the tip's calibration and the registration (algorithms/geometry/pose_covariance.hpp), assumed
// independent.
//
// A state describes the tip at the time of its publication. The age of the frame is paid for: the tip is moved by its
// velocity, and its covariance grows by that of the velocity and by an unknown acceleration of the hand
// (docs/navigation.md). A pose is live until its age reaches wire::live_limit_ns, then stale, then lost.
//
// A case without a tracker is navigated by an arm: Reference is the arm's base, and the tool that the arm states to
// carry is a body at its flange (on_arm()). The base does not follow the patient. All other rules are the same.
//
// With a tracker beside the arm (hand-eye) the tracker's frames navigate, and the tool that the arm carries is one more
// body in them, T_tracker_tool = T_base_tracker^-1 T_base_flange, with the flange interpolated at the exposure; a frame
// waits for the flange for at most kFlangeWait_ns. The error of the hand-eye calibration is common to all frames: it is
// part of each stated error, and is averaged nowhere.
//
// One thread at a time. No allocation, exceptions, locks or logging. The caller passes the time: ns UTC, host clock.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>

#include "algorithms/planning/critical_structures.hpp"
#include "idl/validity.hpp"
#include "server/runtime/spsc_ring.hpp"
#include "server/session/messages.hpp"
#include "server/stages/loaded_case.hpp"
#include "server/stages/navigation/capture.hpp"
#include "server/stages/navigation/hand_eye_check.hpp"
#include "server/stages/navigation/tip_filter.hpp"
#include "server/stages/navigation/turn_rate.hpp"
#include "server/stages/plausibility/frame_judge.hpp"
#include "server/stages/plausibility/tracker_volume.hpp"
#include "server/stages/pose_history.hpp"
#include "server/stages/robot_tool/tool_pose.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

using NavigationInput = std::variant<CaseChanged, NavigationMessage>;
using NavigationEvents = runtime::SpscRing<NavigationEvent, 4096>;

// Of the stage; the pipeline uses all but names, rate and priority.
struct NavigationParameters {
  std::string trackers = "Tracker"; // names, separated by commas
  // Assumed noise of the poses: standard deviation per marker coordinate.
  double marker_sigma_lateral_mm = 0.10;
  double marker_sigma_depth_mm = 0.25;
  double latency_ms = 4.0; // exposure to the driver's write, as stated by the manufacturer
  TrackerVolume volume;
  double floor_rate_hz = 50.0;
  double live_limit_ms = wire::kLiveLimit_ms; // maximal age of a live pose; three frame periods if they are longer
  double hand_acceleration_mm_s2 = 1500.0;    // of a motion that the filter does not know yet: 1 sigma of a coordinate
  double filter_hz = 3.0;                     // bandwidth of the tip filter; 0: no filter
  std::int64_t priority = 70;
  ToolPoseOptions arm; // for an arm that states no covariance; set by the wiring from the parameters of robot tool
};

// When a frame was exposed, by the input check.
struct Exposure {
  std::int64_t acquired_ns = 0; // on the host's clock
  std::int64_t sigma_ns = 0;    // 1 sigma of that time
  std::int64_t period_ns = 0;   // of the tracker
  std::int64_t written_ns = 0;  // the driver's write, on the host's clock; 0: not known
};

class NavigationPipeline {
public:
  // events: to the control thread; must outlive the pipeline. It counts dropped events.
  NavigationPipeline(const NavigationParameters &parameters, NavigationEvents &events);

  void handle(const NavigationInput &input) noexcept;
  // Where references go that a surface scan measures with; must outlive the pipeline.
  void share_references(ReferenceRing &references) noexcept { references_ = &references; }
  // A frame that has passed the input check. True if the states were updated; else the frame waits for the arm.
  bool on_frame(const wire::TrackerFrame &frame, const Exposure &exposure, std::int64_t now_ns) noexcept;
  // A measurement of an arm; ignored unless it is the case's. True if the states were updated by it.
  bool on_arm(const FlangeSample &sample, std::int64_t now_ns) noexcept;
  // The case has an arm instead of a tracker.
  [[nodiscard]] bool by_arm() const noexcept { return case_ != nullptr && case_->data->arm_alone(); }
  [[nodiscard]] bool has_arm() const noexcept { return case_ != nullptr && case_->data->robot.has_value(); }
  // A tracker navigates beside an arm.
  [[nodiscard]] bool beside_arm() const noexcept { return hand_eye_ != nullptr; }
  // Frames of this tracker navigate.
  [[nodiscard]] bool takes(std::string_view tracker) const noexcept {
    return !by_arm() && (hand_eye_ == nullptr || tracker == hand_eye_->tracker);
  }
  [[nodiscard]] const HandEyeCheck &hand_eye_check() const noexcept { return hand_eye_check_; }
  // Predicted positions of the targets; predictions older than 0.25 s are not shown.
  void on(const PredictedTargets &predicted) noexcept { predicted_ = predicted; }
  // Turns the states into the last ones of their instances: the case is closed or replaced.
  void end_states(std::int64_t now_ns) noexcept;
  // Updates the states without a frame, for the elapsed time.
  void on_tick(std::int64_t now_ns) noexcept;
  // Time at which a tick changes the states without a frame (a pose becomes stale, the tracker is lost).
  [[nodiscard]] std::int64_t next_change_ns() const noexcept;

  // One per navigable tool of the case, in the case's order, at the last frame or tick.
  [[nodiscard]] std::span<const wire::NavigationState> states() const noexcept { return {states_.data(), tool_count_}; }
  [[nodiscard]] bool reference_visible() const noexcept { return reference_.visible; }
  [[nodiscard]] const wire::Name &tracker() const noexcept { return source_; } // of the last frame
  // Beside a tracker; the covariance is that of the markers alone.
  [[nodiscard]] ReferenceView reference_view() const noexcept;
  [[nodiscard]] std::int64_t frame_acquired_ns() const noexcept { return any_frame_ ? exposure_.acquired_ns : 0; }
  // Plausibility of the bodies, for monitoring. The second: per tool, in the order of states().
  [[nodiscard]] BodyReport reference_report() const noexcept;
  [[nodiscard]] BodyReport report(std::size_t tool) const noexcept;
  // Bodies that were refused as malformed in accepted frames, since the start.
  [[nodiscard]] std::uint64_t malformed_bodies() const noexcept { return malformed_bodies_; }
  // The probe at the last frame or tick, input of the tissue model.
  [[nodiscard]] ProbeView probe() const noexcept;

private:
  struct BodyInTracker {
    bool visible = false;
    geometry::UncertainPose<geometry::frame::Tracker, geometry::frame::Tool> T_tracker_body;
    // Exposure of the first frame with this pose: a frame that repeats it to the last bit is no new exposure.
    wire::Pose pose{};
    std::int64_t acquired_ns = 0;
    BodyFrame in_frame;                                     // what the last frame contains of it
    inputs::MarkerFault fault = inputs::MarkerFault::kNone; // of the last malformed frame
    std::uint32_t used_markers = 0;                         // in that frame

    [[nodiscard]] bool malformed() const noexcept { return in_frame.content == BodyFrame::Content::kMalformed; }
  };
  struct Tool {
    const casefile::ToolModel *model = nullptr;
    bool carried = false; // by the arm beside the tracker
    wire::Name name{};
    BodyInTracker body;
    bool calibrated = false;
    geometry::Vector3d tip_mm = geometry::Vector3d::Zero();
    geometry::Matrix3d tip_covariance = geometry::Matrix3d::Zero();
    const casefile::Trajectory *plan = nullptr;
    TipFilter filter;
    TurnRate turn_rate;
    planning::CriticalStructures::Warm warm;
  };
  using TipPose = geometry::UncertainPose<geometry::frame::Reference, geometry::frame::Tip>;
  using Registration = geometry::UncertainPose<geometry::frame::Image, geometry::frame::Reference>;

  void on(const CaseChanged &change) noexcept;
  void on(const NavigationMessage &message) noexcept;
  [[nodiscard]] Tool *find(const wire::Name &name) noexcept;
  void locate(const wire::TrackerFrame &frame, const casefile::ToolModel &model, BodyInTracker &body) const noexcept;
  void locate(const wire::TrackedTool &seen, const casefile::ToolModel &model, BodyInTracker &body) const noexcept;
  // With a tracker beside the arm: frames wait for the flange at their exposure.
  struct PendingFrame {
    wire::TrackerFrame frame{};
    Exposure exposure;
  };
  void take(const wire::TrackerFrame &frame, const Exposure &exposure, std::int64_t now_ns) noexcept;
  void take_pending(std::int64_t now_ns) noexcept;
  [[nodiscard]] bool waits(std::int64_t exposed_ns, std::int64_t now_ns) const noexcept;
  // The tool that the arm carries, in the tracker.
  void carry_beside(Tool &tool) noexcept;
  void check_hand_eye(const wire::TrackerFrame &frame) noexcept;
  void share_reference() noexcept;
  // Error of the hand-eye calibration, in Reference: a left perturbation of each pose of a carried tool.
  [[nodiscard]] geometry::Matrix6d hand_eye_covariance() const noexcept;
  // A tool of the arm whose hand-eye calibration is contradicted.
  [[nodiscard]] bool misplaced(const Tool &tool) const noexcept { return tool.carried && hand_eye_check_.disagrees(); }
  // The arm's base as the reference, and the tool that it carries.
  void place_base() noexcept;
  void carry(const FlangeSample &sample, Tool &tool) noexcept;
  void watch_arm(const FlangeSample &sample, std::int64_t now_ns) noexcept;
  // The bodies of the last frame are set: tests and records them.
  void evaluate(std::int64_t now_ns) noexcept;
  void judge() noexcept;
  [[nodiscard]] std::size_t index_of(const Tool &tool) const noexcept {
    return static_cast<std::size_t>(&tool - tools_.data());
  }
  // Exposure of the pose of a tool in Reference: that of the older one of the two bodies.
  [[nodiscard]] std::int64_t acquired_ns(const Tool &tool) const noexcept;
  [[nodiscard]] std::int64_t live_limit_ns() const noexcept;
  [[nodiscard]] std::int64_t stale_at_ns(const Tool &tool) const noexcept;
  [[nodiscard]] std::int64_t lost_at_ns() const noexcept;
  [[nodiscard]] std::int64_t measured_until_ns(std::int64_t acquired_ns) const noexcept;
  [[nodiscard]] wire::PoseStatus status_of(const Tool &tool, std::int64_t now_ns) const noexcept;
  // check_touch: it proves where a body is, which needs no trust.
  [[nodiscard]] FrameContent content_of(const Tool &tool, bool check_touch, std::int64_t now_ns) const noexcept;
  void record(Tool &tool, std::int64_t now_ns) noexcept;
  void publish(Tool &tool, wire::NavigationState &state, std::int64_t now_ns) noexcept;
  // Fields that are known only with a shown pose. False, with nothing filled, if a value would not be finite.
  [[nodiscard]] bool fill_pose(Tool &tool, wire::NavigationState &state) noexcept;
  static void clear_pose(wire::NavigationState &state) noexcept;
  void fill_prediction(const Tool &tool, wire::NavigationState &state) const noexcept;
  void fill_structure(Tool &tool, const geometry::Vector3d &tip, const geometry::Matrix3d &tip_covariance,
                      wire::NavigationState &state) const noexcept;
  // The pose at the time of the state, and the motion of its tip.
  struct MovingTip {
    TipPose T_reference_tip;
    MovingPoint tip;
  };
  [[nodiscard]] MovingTip moved(Tool &tool, const TipPose &T_reference_tip, double age_s) const noexcept;
  void update_states(std::int64_t now_ns) noexcept;
  void reset_filters() noexcept;
  using ToolInReference = geometry::UncertainPose<geometry::frame::Reference, geometry::frame::Tool>;
  [[nodiscard]] ToolInReference tool_in_reference(const Tool &tool) const noexcept;
  [[nodiscard]] TipPose tip_in_reference(const Tool &tool) const noexcept;

  NavigationParameters parameters_;
  NavigationEvents &events_;
  LoadedCase *case_ = nullptr;
  std::uint64_t generation_ = 0;
  std::array<Tool, bregma_wire_MAX_TOOLS> tools_;
  std::array<wire::NavigationState, bregma_wire_MAX_TOOLS> states_{};
  std::size_t tool_count_ = 0;
  BodyInTracker reference_;
  FrameJudge judge_;
  std::optional<Registration> registration_;
  PredictedTargets predicted_;
  SessionChanged session_{bregma_wire_SESSION_IDLE, false};
  TouchCapture touch_;
  SurfaceTrace trace_;
  PivotRequest pivot_{};

  struct Arm { // of this case, as far as it was seen
    bool seen = false;
    std::uint32_t incarnation = 0;
    wire::Name tool{};
    bool replaced = false;                 // the session does not know it yet
    std::int64_t seen_ns = 0, anew_ns = 0; // its last measurement, and the last that differed from the one before
  };
  Arm arm_;

  // A tracker beside the arm.
  static constexpr std::int64_t kFlangeWait_ns = 50'000'000;
  static constexpr std::size_t kMaxPending = 4;
  using Flanges = PoseHistory<geometry::frame::RobotBase, geometry::frame::RobotFlange, 64>;
  const casefile::HandEyeModel *hand_eye_ = nullptr; // of the case
  const casefile::ToolModel *flange_model_ = nullptr;
  Flanges flanges_;
  std::array<PendingFrame, kMaxPending> pending_;
  std::size_t pending_count_ = 0;
  BodyInTracker flange_body_;
  HandEyeCheck hand_eye_check_;
  ReferenceRing *references_ = nullptr;
  std::uint64_t malformed_bodies_ = 0;
  bool any_frame_ = false;
  std::uint64_t frame_ = 0;
  std::int64_t frame_sent_ns_ = 0;
  wire::Name source_{};           // the tracker
  Exposure exposure_;             // of the last frame
  std::int64_t evaluated_ns_ = 0; // time of the last update of states_
  std::uint64_t updates_ = 0;     // of states_
};

} // namespace bregma::server
