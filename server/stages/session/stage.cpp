#include "server/stages/session/stage.hpp"

#include <exception>
#include <stdexcept>
#include <utility>

#include "algorithms/geometry/angles.hpp"
#include "idl/names.hpp"
#include "server/runtime/state_directory.hpp"

namespace bregma::server {
namespace {

constexpr double kPollRate_hz = 200.0; // rate of polling other stages and pending answers

SessionConfig config_of(const SessionParameters &parameters) {
  SessionConfig out;
  out.state_directory = runtime::state_directory(parameters.state_directory);
  out.capture_window_ms = parameters.capture_window_ms;
  out.capture_max_motion_mm = parameters.capture_max_motion_mm;
  out.trace_spacing_mm = parameters.trace_spacing_mm;
  out.trace_max_samples = static_cast<std::size_t>(parameters.trace_max_samples);
  out.pivot_min_rotation_rad = parameters.pivot_min_rotation_deg * geometry::kRadiansPerDegree;
  out.pivot_max_samples = static_cast<std::size_t>(parameters.pivot_max_samples);
  out.min_checks = static_cast<std::size_t>(parameters.min_checks);
  return out;
}

// The alarm if no session file could be created.
AlarmCondition not_recording(const std::string &why, std::int64_t now_ns) {
  AlarmCondition out{};
  (void)wire::set_name(out.kind, alarm::kDisk);
  out.active = true;
  out.severity = bregma_wire_SEVERITY_CRITICAL;
  out.effect = SessionEffect::kNone;
  out.time_ns = now_ns;
  wire::set_text(out.text, "the session is not being recorded: " + why);
  return out;
}

const char *text_of(wire::AlarmState state) {
  return state == bregma_wire_ALARM_RAISED         ? "raised"
         : state == bregma_wire_ALARM_ACKNOWLEDGED ? "acknowledged"
                                                   : "cleared";
}

} // namespace

void declare(base::ParameterSet &set, SessionParameters &p) {
  set.number("capture.window_ms", &p.capture_window_ms, "ms", 20, 5000,
             "A touch is the mean of the tip over this time.");
  set.number("capture.max_motion_mm", &p.capture_max_motion_mm, "mm", 0.05, 20,
             "A touch is refused as not held still when its tip strays further than this from its mean.");
  set.number("trace.spacing_mm", &p.trace_spacing_mm, "mm", 0.1, 50,
             "A surface sample is taken when the tip is this far from the last one.");
  set.integer("trace.max_samples", &p.trace_max_samples, "", 10, kMaxSurfaceSamples,
              "Maximum number of surface samples; the trace then ends.");
  set.number("pivot.min_rotation_deg", &p.pivot_min_rotation_deg, "deg", 5, 180,
             "A tool is not calibrated when it turned by less than this about either of two axes.");
  set.integer("pivot.max_samples", &p.pivot_max_samples, "", 50, 20000,
              "Maximum number of poses of one pivot calibration; later ones are ignored.");
  set.integer("verification.min_checks", &p.min_checks, "", 1, 64,
              "Number of landmarks to check after a registration was accepted, before it can be confirmed.");
  set.string("state.directory", &p.state_directory,
             "Where the session is kept for a restart. Empty: $STATE_DIRECTORY, else $XDG_STATE_HOME/bregma, else "
             "~/.local/state/bregma.");
  set.number(
      "registration.correlation_length_mm", &p.correlation_length_mm, "mm", 0.1, 100,
      "Distance over which errors of the surface (skin, segmentation) are correlated; closer samples count for less.");
}

SessionStage::SessionStage(const SessionParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = kPollRate_hz, .triggered = true}),
      parameters_(parameters), host_(context.host), commands_(context.link), replies_(context.link),
      alarms_(context.link), captures_(context.link),
      session_(config_of(parameters), static_cast<SessionPorts &>(*this),
               [this](const std::function<void()> &job) { host_.run_elsewhere(job); }) {}

void SessionStage::connect(NavigationEvents &events, AlarmEvents &conditions,
                           const runtime::LatestValue<wire::RegistrationState> &estimate) {
  events_ = &events;
  conditions_ = &conditions;
  estimate_.connect(estimate);
}

void SessionStage::begin(const Moment &now) {
  now_ns_ = now.utc_ns;
  session_.restore(now_ns_);
  tell_of_recording();
}

void SessionStage::step(const Moment &now) noexcept {
  now_ns_ = now.utc_ns;
  commands_.take_each(now_ns_, [this](const wire::Command &command, std::uint64_t /*writer*/) {
    session_.handle(command, now_ns_);
    tell_of_recording();
  });
  take_in();
  session_.poll(now_ns_);
  to_navigation.flush();
  to_registration.flush();
  to_monitoring.flush();
  cases.free_unused();
  share_view();
}

void SessionStage::take_in() {
  NavigationEvent event;
  while (events_->try_pop(event)) {
    session_.on(event, now_ns_);
  }
  AlarmCondition condition;
  while (conditions_->try_pop(condition)) {
    session_.on(condition, now_ns_);
  }
  if (estimate_.refresh()) {
    session_.on(estimate_.value(), now_ns_);
  }
}

base::Result<void> SessionStage::use_case(std::shared_ptr<const casefile::Case> loaded) {
  std::unique_ptr<LoadedCase> fresh;
  if (loaded) {
    try {
      fresh = std::make_unique<LoadedCase>(loaded, parameters_.correlation_length_mm,
                                           static_cast<int>(parameters_.trace_max_samples));
    } catch (const std::invalid_argument &error) {
      return base::failure((loaded->folder / "case.toml").string() + ": " + error.what());
    }
  }
  const CaseChanged change = cases.add(std::move(fresh));
  to_navigation.send(change);
  to_registration.send(change);
  to_monitoring.send(change);
  recording_ = host_.case_changed(loaded.get(), now_ns_);
  return {};
}

void SessionStage::tell_of_recording() {
  if (const auto file = std::exchange(recording_, std::nullopt)) {
    if (!*file) {
      session_.on(not_recording(file->error().message, now_ns_), now_ns_);
    } else if (file->value()) {
      session_.recording_to(*file->value());
    }
  }
}

void SessionStage::publish(const wire::CommandReply &reply) {
  host_.log(LogLevel::kInfo, wire::text(reply.client) + " " + std::to_string(reply.id) + ": " + reply.text);
  replies_(reply, now_ns_);
}

void SessionStage::publish(const wire::Alarm &alarm) {
  host_.log(LogLevel::kWarning, std::string("alarm ") + text_of(alarm.state) + ": " + wire::text(alarm.kind) + " " +
                                    wire::text(alarm.subject) + ": " + alarm.text);
  alarms_(alarm, now_ns_);
}

void SessionStage::share_view() {
  SessionView shown;
  shown.state = session_.state();
  if (const auto loaded = session_.loaded_case()) {
    wire::set_text(shown.case_folder, loaded->folder.string());
  }
  view.store(shown);
}

} // namespace bregma::server
