#include "server/stages/navigation/stage.hpp"

#include <algorithm>

#include "idl/validity.hpp"
#include "server/inputs/device_names.hpp"
#include "server/stages/host.hpp"
#include "server/stages/host_clock.hpp"
#include "server/stages/schedules.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kShareInterval_ns = 50'000'000;
constexpr std::int64_t kArmInterval_ns = 4'000'000; // between looks for an arm's measurements

inputs::DeviceOptions tracker_options(const NavigationParameters &parameters) {
  inputs::DeviceOptions out;
  out.clock.minimum_latency_ns = ns_of_ms(parameters.latency_ms);
  out.live_limit_ms = parameters.live_limit_ms;
  return out;
}

void state_volume(wire::DeviceHealth &tracker, const TrackerVolume &volume) {
  tracker.volume_near_mm = volume.near_mm;
  tracker.volume_far_mm = volume.far_mm;
  tracker.volume_half_width_rad = volume.half_width_deg * geometry::kRadiansPerDegree;
  tracker.volume_half_height_rad = volume.half_height_deg * geometry::kRadiansPerDegree;
}

} // namespace

void declare(base::ParameterSet &set, NavigationParameters &p) {
  set.string("devices.trackers", &p.trackers,
             "Names of the trackers, separated by commas. Samples of any other are rejected.");
  set.number(
      "tracker.marker_sigma_lateral_mm", &p.marker_sigma_lateral_mm, "mm", 0.001, 5,
      "Error of a marker across the line of sight, 1 sigma of a coordinate. All predicted errors derive from it.");
  set.number("tracker.marker_sigma_depth_mm", &p.marker_sigma_depth_mm, "mm", 0.001, 10,
             "Error of a marker along the line of sight, 1 sigma.");
  set.number("tracker.latency_ms", &p.latency_ms, "ms", 0, 500,
             "From exposure to the driver's write, as the manufacturer states it.");
  set.number("tracker.near_mm", &p.volume.near_mm, "mm", 0, 20000,
             "The tracker's stated volume, a frustum: its smallest depth. A pose outside the volume is refused.");
  set.number("tracker.far_mm", &p.volume.far_mm, "mm", 1, 20000, "The largest depth of the tracker's volume.");
  set.number("tracker.half_width_deg", &p.volume.half_width_deg, "deg", 1, 85,
             "Half of the horizontal angle of the tracker's volume.");
  set.number("tracker.half_height_deg", &p.volume.half_height_deg, "deg", 1, 85,
             "Half of the vertical angle of the tracker's volume.");
  set.number("navigation.floor_rate_hz", &p.floor_rate_hz, "Hz", 1, 1000,
             "The navigation state is published at least this often, also when no frame comes.");
  set.number("navigation.live_limit_ms", &p.live_limit_ms, "ms", wire::kMinLiveLimit_ms, wire::kMaxLiveLimit_ms,
             "Maximal age of a pose that is shown as live; three frame periods of a slower tracker, at most 300 ms.");
  set.number("navigation.hand_acceleration_mm_s2", &p.hand_acceleration_mm_s2, "mm/s^2", 0, 50000,
             "Acceleration of a hand in a motion that the tip filter does not know yet, 1 sigma of a coordinate: the "
             "error of a pose grows by it with the age.");
  set.number("navigation.filter_hz", &p.filter_hz, "Hz", 0, 50,
             "Bandwidth of the tip filter: faster motion is averaged as marker noise. 0: no filter.");
  declare_priority(set, NavigationStage::kName, p.priority);
}

NavigationStage::NavigationStage(const NavigationParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kFifo,
                    .fifo_priority = static_cast<int>(parameters.priority),
                    .rate_hz = parameters.floor_rate_hz,
                    .triggered = true}),
      guard_(inputs::split_names(parameters.trackers), tracker_options(parameters)), pipeline_(parameters, events),
      volume_(parameters.volume), frames_(context.link), states_(context.link), boot_id_(context.host.boot_id()) {
  pipeline_.share_references(references);
}

void NavigationStage::connect(Inbox &inbox, CaseStore &cases, const runtime::LatestValue<PredictedTargets> &predicted,
                              FlangeRing &flanges) {
  flanges_ = &flanges;
  inbox_ = &inbox;
  lease_.connect(cases);
  predicted_.connect(predicted);
}

std::int64_t NavigationStage::wake_ns(const Moment &now) const noexcept {
  const std::int64_t change_utc_ns = pipeline_.next_change_ns();
  const std::int64_t change_ns = change_utc_ns == kNever ? kNever : now.monotonic_ns + (change_utc_ns - now.utc_ns);
  return pipeline_.has_arm() ? std::min(change_ns, looked_ns_ + kArmInterval_ns) : change_ns;
}

// The arm's measurements come from the stage sensors, which is not disturbed by a flood, and disturbs nobody here.
void NavigationStage::take_flanges(const Moment &now) noexcept {
  looked_ns_ = now.monotonic_ns;
  bool taken = false;
  FlangeSample sample;
  while (flanges_->try_pop(sample)) {
    if (pipeline_.by_arm()) {
      frame_period_ns_ = sample.period_ns;
    }
    taken = pipeline_.on_arm(sample, now.utc_ns) || taken;
  }
  if (taken) {
    publish(now);
  }
}

void NavigationStage::step(const Moment &now) noexcept {
  take_messages(now);
  if (predicted_.refresh()) {
    pipeline_.on(predicted_.value());
  }
  guard_.set_host(host_clock(now, boot_id_));
  const std::size_t taken =
      frames_.take_each(now.utc_ns, [&](const wire::TrackerFrame &frame, std::uint64_t writer) noexcept {
        const inputs::Verdict verdict = guard_.check(frame, writer, now.utc_ns);
        if (verdict.accepted && pipeline_.takes(wire::view(frame.device)) && navigates(verdict.device, now.utc_ns)) {
          frame_period_ns_ = frame.period_ns;
          const std::uint64_t malformed = pipeline_.malformed_bodies();
          const bool updated = pipeline_.on_frame(
              frame, {verdict.acquired_time_ns, verdict.age_sigma_ns, verdict.period_ns, verdict.written_time_ns},
              now.utc_ns);
          malformed_bodies_[static_cast<std::size_t>(verdict.device)] += pipeline_.malformed_bodies() - malformed;
          if (updated) {
            publish(now);
          }
        }
      });
  take_flanges(now);
  if (taken == 0) {
    guard_.set_writers_alive(frames_.writers_alive());
  }
  if (now.utc_ns >= pipeline_.next_change_ns() || (now.tick && !published_)) {
    pipeline_.on_tick(now.utc_ns);
    publish(now);
  }
  if (now.tick) {
    published_ = false;
  }
  if (now.monotonic_ns - shared_ns_ >= kShareInterval_ns) {
    shared_ns_ = now.monotonic_ns;
    share(now);
  }
}

// One tracker navigates at a time: the first that sends, until it is lost. Two that see the same tools would show two
// poses in turn.
bool NavigationStage::navigates(int tracker, std::int64_t now_ns) noexcept {
  const auto &trackers = guard_.devices();
  if (tracker_ < 0 || trackers[static_cast<std::size_t>(tracker_)].status(now_ns) == bregma_wire_DEVICE_LOST) {
    tracker_ = tracker;
  }
  return tracker == tracker_;
}

void NavigationStage::take_messages(const Moment &now) noexcept {
  inbox_->take_each([&](const NavigationInput &input) noexcept {
    const auto *change = std::get_if<CaseChanged>(&input);
    if (change != nullptr) {
      pipeline_.end_states(now.utc_ns);
      for (const wire::NavigationState &last : pipeline_.states()) {
        states_(stamped(last, now), now.utc_ns);
      }
    }
    pipeline_.handle(input);
    if (change != nullptr) {
      guard_.set_tools(change->loaded != nullptr ? change->loaded->tools : inputs::KnownTools{});
      lease_.take(*change);
    }
  });
}

wire::NavigationState NavigationStage::stamped(wire::NavigationState state, const Moment &now) const noexcept {
  std::copy(boot_id_.begin(), boot_id_.end(), state.boot_id);
  state.published_boot_ns = now.boot_ns;
  return state;
}

void NavigationStage::publish(const Moment &now) noexcept {
  for (const wire::NavigationState &state : pipeline_.states()) {
    states_(stamped(state, now), now.utc_ns);
  }
  probe.store(pipeline_.probe());
  if (pipeline_.beside_arm()) {
    reference.store(pipeline_.reference_view());
  }
  published_ = true;
}

void NavigationStage::share(const Moment &now) noexcept {
  inputs::StreamHealth health = guard_.health(now.utc_ns);
  for (std::uint32_t i = 0; i < health.device_count; ++i) {
    health.devices[i].malformed_bodies = malformed_bodies_[i];
    state_volume(health.devices[i], volume_);
  }
  devices.store(health);
  TrackingView view;
  view.by_arm = pipeline_.by_arm();
  view.acquired_ns = pipeline_.frame_acquired_ns();
  view.hand_eye = pipeline_.hand_eye_check().view();
  view.reference_visible = pipeline_.reference_visible();
  copy_name(view.tracker, pipeline_.tracker());
  view.reference = pipeline_.reference_report();
  for (const wire::NavigationState &state : pipeline_.states()) {
    TrackingView::Tool &tool = view.tools[view.tool_count];
    tool.body = pipeline_.report(view.tool_count++);
    copy_name(tool.tool, state.tool);
    tool.status = state.status;
    tool.planned = state.trajectory[0] != '\0';
    tool.age_ns = state.age_ns;
    tool.T_image_tip = state.T_image_tip;
    tool.tre_95_mm = state.tre_95.semi_axes_mm[0];
  }
  tracking.store(view);
}

} // namespace bregma::server
