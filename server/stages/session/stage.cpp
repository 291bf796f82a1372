#include "server/stages/session/stage.hpp"

#include <algorithm>
#include <exception>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "algorithms/geometry/angles.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "server/runtime/state_directory.hpp"

namespace bregma::server {
namespace {

constexpr double kPollRate_hz = 200.0; // rate of polling other stages and pending answers
constexpr int kMaxBatches = 64;        // of commands per step
constexpr std::int64_t kFloodShown_ns = 5'000'000'000;

// Of the case that the stages use.
class PreparedForStages final : public PreparedCase {
public:
  explicit PreparedForStages(std::unique_ptr<LoadedCase> a_case) : loaded(std::move(a_case)) {}
  std::unique_ptr<LoadedCase> loaded;
};

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
  out.check_valid_min = parameters.check_valid_min;
  return out;
}

// The alarm if no session file could be created. why: empty if one was.
AlarmCondition not_recording(const std::string &why, std::int64_t now_ns) {
  AlarmCondition out{};
  (void)wire::set_name(out.kind, alarm::kDisk);
  out.active = !why.empty();
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
  set.number("verification.valid_min", &p.check_valid_min, "min", 1, 240,
             "In a case without a tracker: the verification ends when the last check touch is older.");
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
      to_driver_(context.link), alarms_(context.link), captures_(context.link),
      session_(config_of(parameters), static_cast<SessionPorts &>(*this),
               [this](Work work, const std::function<void()> &job) { host_.run_elsewhere(work, job); }) {}

void SessionStage::connect(NavigationEvents &events, AlarmEvents &conditions,
                           const runtime::LatestValue<RegistrationEstimate> &estimate, StageAnswers &scanner_answers,
                           AlarmEvents &scanner_conditions, NavigationEvents &scan_events, AlarmEvents &scan_conditions,
                           StageAnswers &motion_answers, AlarmEvents &motion_conditions) {
  events_ = &events;
  scan_events_ = &scan_events;
  scan_conditions_ = &scan_conditions;
  motion_conditions_ = &motion_conditions;
  scanner_answers_ = &scanner_answers;
  motion_answers_ = &motion_answers;
  scanner_conditions_ = &scanner_conditions;
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
  commands_.take_each(
      now_ns_, [this](const wire::Command &command, std::uint64_t writer) { return take(command, writer); },
      kMaxBatches);
  watch_commands();
  take_in();
  session_.poll(now_ns_);
  tell_of_recording();
  to_navigation.flush();
  to_registration.flush();
  to_monitoring.flush();
  to_scanner.flush();
  to_arm.flush();
  to_scan.flush();
  cases.free_unused();
  share_view();
}

bool SessionStage::take(const wire::Command &command, std::uint64_t writer) {
  const CommandGate::Verdict verdict = gate_.judge(writer, now_ns_);
  if (verdict == CommandGate::Verdict::kAdmitted) {
    session_.handle(command, now_ns_);
    tell_of_recording();
    return true;
  }
  excess_client_ = wire::text(command.client);
  if (verdict == CommandGate::Verdict::kRefused && wire::is_terminated(command.client)) {
    replies_(wire::reply_to(command, bregma_wire_COMMAND_REFUSED, "too many commands: a client may send 50 per second",
                            session_.state()),
             now_ns_);
  }
  return false;
}

// An alarm about clients that flood. Its text names one of them: the names are theirs, and may be any number.
void SessionStage::watch_commands() {
  const bool more = gate_.excess() != std::exchange(excess_seen_, gate_.excess());
  excess_ns_ = more ? now_ns_ : excess_ns_;
  if (excess_ns_ == 0) {
    return;
  }
  AlarmCondition condition{};
  (void)wire::set_name(condition.kind, alarm::kCommandFlood);
  condition.active = now_ns_ - excess_ns_ < kFloodShown_ns;
  condition.severity = bregma_wire_SEVERITY_WARNING;
  condition.effect = SessionEffect::kNone;
  condition.time_ns = now_ns_;
  wire::set_text(condition.text, "client \"" + excess_client_ + "\" sends too many commands: most are refused");
  session_.on(condition, now_ns_);
  excess_ns_ = condition.active ? excess_ns_ : 0;
}

void SessionStage::take_in() {
  NavigationEvent event;
  for (NavigationEvents *events : {events_, scan_events_}) {
    while (events->try_pop(event)) {
      session_.on(event, now_ns_);
    }
  }
  AlarmCondition condition;
  StageAnswer answer;
  for (StageAnswers *answers : {scanner_answers_, motion_answers_}) {
    while (answers != nullptr && answers->try_pop(answer)) {
      session_.on(answer, now_ns_);
    }
  }
  for (AlarmEvents *conditions :
       {conditions_, scanner_conditions_, scan_conditions_, motion_conditions_, host_.conditions()}) {
    while (conditions != nullptr && conditions->try_pop(condition)) {
      session_.on(condition, now_ns_);
    }
  }
  if (estimate_.refresh()) {
    session_.on(estimate_.value(), now_ns_);
  }
}

PrepareCase SessionStage::preparation() {
  return [correlation_length_mm = parameters_.correlation_length_mm,
          max_samples = static_cast<int>(parameters_.trace_max_samples)](
             std::shared_ptr<const casefile::Case> loaded) -> base::Result<std::shared_ptr<PreparedCase>> {
    const std::string file = (loaded->folder / "case.toml").string();
    try {
      return std::make_shared<PreparedForStages>(
          std::make_unique<LoadedCase>(std::move(loaded), correlation_length_mm, max_samples));
    } catch (const std::invalid_argument &error) {
      return base::failure(file + ": " + error.what());
    }
  };
}

void SessionStage::use_case(std::shared_ptr<const casefile::Case> loaded, std::shared_ptr<PreparedCase> prepared) {
  const CaseChanged change = cases.add(prepared ? std::move(static_cast<PreparedForStages &>(*prepared).loaded)
                                                : std::unique_ptr<LoadedCase>());
  to_navigation.send(change);
  to_registration.send(change);
  to_monitoring.send(change);
  auto recording = recordings_.emplace_back(std::make_shared<Recording>());
  host_.run_elsewhere(Work::kSave, [recording, loaded, &host = host_, utc_ns = now_ns_] {
    try {
      recording->set(host.case_changed(loaded.get(), utc_ns));
    } catch (const std::exception &error) {
      recording->set(base::failure(error.what()));
    }
  });
}

void SessionStage::tell_of_recording() {
  while (!recordings_.empty()) {
    const auto *file = recordings_.front()->get();
    if (file == nullptr) {
      return;
    }
    session_.on(not_recording(*file ? "" : file->error().message, now_ns_), now_ns_);
    if (*file && file->value()) {
      session_.recording_to(*file->value());
    }
    recordings_.pop_front();
  }
}

// A hold or a stop does not wait for a path that is being planned. The stage robot motion watches for the reply; it
// knows the command before the driver does.
void SessionStage::send_to_arm(const wire::Command &command) {
  to_arm.send(command);
  if (command.kind != bregma_wire_COMMAND_MOVE_TO_TRAJECTORY) {
    wire::Command out = command;
    std::copy(std::begin(command.body._u.device.device), std::end(command.body._u.device.device), out.receiver);
    to_driver_(out, now_ns_);
  }
}

void SessionStage::publish(const wire::CommandReply &reply) { replies_(reply, now_ns_); }

void SessionStage::publish(const wire::Alarm &alarm) {
  host_.log(LogLevel::kWarning, std::string("alarm ") + text_of(alarm.state) + ": " + wire::text(alarm.kind) + " " +
                                    wire::text(alarm.subject) + ": " + alarm.text);
  alarms_(alarm, now_ns_);
}

void SessionStage::share_view() {
  SessionView shown;
  shown.state = session_.state();
  shown.refused_commands = gate_.excess();
  if (const auto loaded = session_.loaded_case()) {
    wire::set_text(shown.case_folder, loaded->folder.string());
  }
  view.store(shown);
}

} // namespace bregma::server
