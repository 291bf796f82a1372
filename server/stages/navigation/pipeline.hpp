// The navigation pipeline: from a tracker frame to each tool's tip in the image, its accuracy, and its position
// relative to the plan and the critical structures.
//
// T_image_tip = T_image_reference (T_tracker_reference)^-1 T_tracker_tool T_tool_tip, all of the same frame. The motion
// of the tip in Reference is filtered (tip_filter.hpp). The covariance is propagated to first order from the markers of
// both bodies, the tip's calibration and the registration (algorithms/geometry/pose_covariance.hpp), assumed
// independent.
//
// One thread at a time. No allocation, exceptions, locks or logging. The caller passes the time: ns UTC, host clock.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <variant>

#include "algorithms/planning/critical_structures.hpp"
#include "server/runtime/spsc_ring.hpp"
#include "server/session/messages.hpp"
#include "server/stages/loaded_case.hpp"
#include "server/stages/navigation/capture.hpp"
#include "server/stages/navigation/tip_filter.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

using NavigationInput = std::variant<CaseChanged, NavigationMessage>;
using NavigationEvents = runtime::SpscRing<NavigationEvent, 4096>;

// Of the stage; the pipeline uses the noise, the latency and the filter.
struct NavigationParameters {
  std::string trackers = "Tracker"; // names, separated by commas
  // Assumed noise of the poses: standard deviation per marker coordinate.
  double marker_sigma_lateral_mm = 0.10;
  double marker_sigma_depth_mm = 0.25;
  double latency_ms = 4.0; // exposure to the driver's write, as stated by the manufacturer
  double floor_rate_hz = 50.0;
  double filter_hz = 3.0; // bandwidth of the tip filter; 0: no filter
  std::int64_t priority = 70;
};

class NavigationPipeline {
public:
  // events: to the control thread; must outlive the pipeline. It counts dropped events.
  NavigationPipeline(const NavigationParameters &parameters, NavigationEvents &events);

  void handle(const NavigationInput &input) noexcept;
  // A frame that has passed the input check. acquired_ns: its exposure on the host's clock.
  void on_frame(const wire::TrackerFrame &frame, std::int64_t acquired_ns, std::int64_t now_ns) noexcept;
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
  // The probe at the last frame or tick, input of the tissue model.
  [[nodiscard]] ProbeView probe() const noexcept;

private:
  struct BodyInTracker {
    bool visible = false;
    geometry::UncertainPose<geometry::frame::Tracker, geometry::frame::Tool> T_tracker_body;
  };
  struct Tool {
    const casefile::ToolModel *model = nullptr;
    wire::Name name{};
    BodyInTracker body;
    bool calibrated = false;
    geometry::Vector3d tip_mm = geometry::Vector3d::Zero();
    geometry::Matrix3d tip_covariance = geometry::Matrix3d::Zero();
    const casefile::Trajectory *plan = nullptr;
    TipFilter filter;
    planning::CriticalStructures::Warm warm;
  };
  using TipPose = geometry::UncertainPose<geometry::frame::Reference, geometry::frame::Tip>;
  using Registration = geometry::UncertainPose<geometry::frame::Image, geometry::frame::Reference>;

  void on(const CaseChanged &change) noexcept;
  void on(const NavigationMessage &message) noexcept;
  [[nodiscard]] Tool *find(const wire::Name &name) noexcept;
  [[nodiscard]] BodyInTracker locate(const wire::TrackerFrame &frame, const casefile::ToolModel &model) const noexcept;
  [[nodiscard]] std::int64_t stale_at_ns() const noexcept;
  [[nodiscard]] std::int64_t lost_at_ns() const noexcept;
  [[nodiscard]] wire::PoseStatus status_of(const Tool &tool, std::int64_t now_ns) const noexcept;
  void record(Tool &tool, std::int64_t acquired_ns) noexcept;
  void publish(Tool &tool, wire::NavigationState &state, std::int64_t now_ns) noexcept;
  void fill_pose(Tool &tool, wire::NavigationState &state) noexcept;
  void fill_prediction(const Tool &tool, wire::NavigationState &state) const noexcept;
  [[nodiscard]] TipPose filtered(Tool &tool, const TipPose &T_reference_tip) const noexcept;
  void update_states(std::int64_t now_ns) noexcept;
  void reset_filters() noexcept;
  [[nodiscard]] TipPose tip_in_reference(const Tool &tool) const noexcept;

  NavigationParameters parameters_;
  NavigationEvents &events_;
  LoadedCase *case_ = nullptr;
  std::uint64_t generation_ = 0;
  std::array<Tool, bregma_wire_MAX_TOOLS> tools_;
  std::array<wire::NavigationState, bregma_wire_MAX_TOOLS> states_{};
  std::size_t tool_count_ = 0;
  BodyInTracker reference_;
  std::optional<Registration> registration_;
  PredictedTargets predicted_;
  SessionChanged session_{bregma_wire_SESSION_IDLE, false};
  TouchCapture touch_;
  SurfaceTrace trace_;
  PivotRequest pivot_{};

  bool any_frame_ = false;
  std::uint64_t frame_ = 0;
  std::int64_t frame_sent_ns_ = 0;
  wire::Name source_{}; // the tracker
  std::int64_t acquired_ns_ = 0;
  std::int64_t period_ns_ = 0;
  std::int64_t evaluated_ns_ = 0; // time of the last update of states_
};

} // namespace bregma::server
