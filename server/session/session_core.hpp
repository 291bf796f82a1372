// Implementation of the session, common to session.cpp (parts common to all commands, alarms), session_storage.cpp
// (what is kept on disk), session_commands.cpp (execution of the commands) and session_registration.cpp (commands of
// the registration). Only these files include it.
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "idl/names.hpp"
#include "server/session/alarm_registry.hpp"
#include "server/session/pivot_run.hpp"
#include "server/session/reply_cache.hpp"
#include "server/session/session.hpp"
#include "server/session/snapshot_saver.hpp"
#include "server/session/state_machine.hpp"

namespace bregma::server {

inline constexpr double kNanosecondsPerMs = 1e6;
// Raised if the accepted registration has not been verified since a restart or a drift alarm.
inline constexpr const char *kVerify = "verification";
// Raised while the last session waits for its case folder, or was not restored because the case has changed.
inline constexpr const char *kRestore = "restore";

struct Answer {
  wire::CommandResult result = bregma_wire_COMMAND_DONE;
  std::string text;
  double value_mm = wire::kUnknown;
};

// Empty: the answer comes later, from a loop, a worker or a timeout.
using Outcome = std::optional<Answer>;

class Session::Impl {
public:
  Impl(SessionConfig config, SessionPorts &ports, Executor executor);

  // Begins a call from outside.
  void begin(std::int64_t utc_ns) {
    now_ns = utc_ns;
    version_before_ = version_;
  }

  // session.cpp
  void handle(const wire::Command &command);
  void on_condition(const AlarmCondition &condition);
  void poll();
  // session_storage.cpp
  void restore();
  void set_recording(const std::filesystem::path &file);
  // session_registration.cpp
  void on_capture(const CaptureResult &result);
  void on_surface(SurfaceSample sample);
  void on_pivot_pose(const PivotPose &pose);
  void on_arm_replaced();
  void on_estimate(const RegistrationEstimate &estimate);
  // session_commands.cpp
  void on_stage_answer(const StageAnswer &answer);

  std::int64_t now_ns = 0; // time of the current call
  [[nodiscard]] const StateMachine &machine() const { return machine_; }
  [[nodiscard]] const SessionData &data() const { return data_; }
  [[nodiscard]] const std::shared_ptr<const casefile::Case> &loaded_case() const { return case_; }

private:
  struct PendingCapture {
    Ticket ticket;
    CaptureRequest request{};
    std::int64_t deadline_ns = 0;
  };
  struct PendingAccept {
    Ticket ticket;
    std::int64_t deadline_ns = 0;
  };
  struct PassedOn { // a command that the stage of the scanner or of the arm's motion carries out
    Ticket ticket;
    std::int64_t deadline_ns = 0;
  };
  struct PendingLoad {
    std::string folder;
    std::shared_ptr<JobResult<LoadedFolder>> result;
    std::int64_t deadline_ns = 0;
    Ticket ticket; // the LOAD_CASE that waits for it
  };
  struct PendingRestore { // until the last session is restored or given up; its snapshot is not replaced meanwhile
    SessionData data;
    std::shared_ptr<JobResult<LoadedFolder>> result; // null between two attempts
    std::int64_t deadline_ns = 0;                    // of the attempt
    std::int64_t next_ns = 0;                        // of the next attempt
    bool failed = false;                             // the case was not there at the start: it is tried again
    std::string reason;                              // as logged last
  };
  struct PendingReply { // waits until the change that it reports is on disk
    std::uint64_t version = 0;
    Ticket ticket;
    wire::CommandReply reply{};
  };

  // session.cpp
  void answer(const Ticket &ticket, const Answer &answer);
  [[nodiscard]] wire::CommandReply make_reply(const Ticket &ticket, const Answer &answer) const;
  void publish_reply(const Ticket &ticket, const wire::CommandReply &reply);
  void log_reply(const Ticket &ticket, const wire::CommandReply &reply);
  void settle();
  void condition(const char *kind, std::string_view subject, bool active, wire::AlarmSeverity severity,
                 std::string_view text);
  // session_storage.cpp
  // The data have changed.
  void changed() { ++version_; }
  void save();
  // Publishes the replies that waited for the disk, and the alarm about it.
  void take_saved();
  void poll_storage();
  void start_loading(const std::string &folder, const Ticket &ticket);
  [[nodiscard]] std::string late_text(const std::string &folder) const;
  // Takes the loaded case, or gives it up after its deadline.
  void poll_loading();
  void end_loading(const LoadedFolder &folder);
  // Loads the case of the last session, again and again while its folder cannot be read.
  void poll_restoring();
  void retry_restoring(const std::string &reason);
  // Another case is wanted: the last session is no longer tried. Its snapshot is kept as session.json.bad.
  void end_restoring();
  [[nodiscard]] base::Result<void> bring_back(SessionData data, const LoadedFolder &folder);
  template <class Message> void send_all(const Message &message);

  // session_commands.cpp
  [[nodiscard]] Outcome carry_out(const Ticket &ticket, const wire::CommandBody &body);
  // Keeps the ticket until the answer; the command is for the stage.
  [[nodiscard]] wire::Command pass_on(const Ticket &ticket, const wire::CommandBody &body, double timeout_ms);
  [[nodiscard]] Outcome move_guide(const Ticket &ticket, const wire::CommandBody &body);
  void poll_passed_on();
  [[nodiscard]] Outcome load_case(const Ticket &ticket, const std::string &folder);
  [[nodiscard]] Answer take_case(const LoadedFolder &folder);
  void take_tips_of_arm();
  void send_tip(const std::string &tool, const CalibratedTip &tip);
  [[nodiscard]] Answer start_pivot(const std::string &tool);
  [[nodiscard]] Outcome finish_pivot(const Ticket &ticket, const std::string &tool);
  [[nodiscard]] Answer take_pivot(const calibration::PivotResult &result);
  [[nodiscard]] Answer start_registration();
  [[nodiscard]] Outcome touch(const Ticket &ticket, wire::CaptureKind kind, const bregma_wire_TouchBody &body);
  [[nodiscard]] Answer take_fiducial(const CaptureRequest &request, const CaptureResult &result);
  [[nodiscard]] Answer miss_check(const CaptureRequest &request, const JudgedCheck &check);
  void clear_missed_checks();
  [[nodiscard]] Answer take_check(const CaptureRequest &request, const CaptureResult &result);
  [[nodiscard]] Answer remove_fiducial(const std::string &point);
  [[nodiscard]] Answer start_trace(const std::string &tool);
  [[nodiscard]] Answer stop_trace(const std::string &tool);
  [[nodiscard]] Answer start_scan(const bregma_wire_ScanBody &body);
  [[nodiscard]] Answer stop_scan(const std::string &device);
  // The case has no such arm.
  [[nodiscard]] std::optional<Answer> refuse_arm(const std::string &device) const;
  // Why no trace or scan can begin.
  [[nodiscard]] std::optional<Answer> refuse_surface() const;
  // In a case without a tracker: the last check touch is too old.
  void poll_checks();
  [[nodiscard]] Outcome accept_registration(const Ticket &ticket);
  [[nodiscard]] Answer take_registration();
  [[nodiscard]] Answer confirm_verification();
  [[nodiscard]] Answer start_navigation(const std::string &tool, const std::string &trajectory);
  [[nodiscard]] Answer acknowledge(const std::string &kind, const std::string &subject);
  [[nodiscard]] Answer close_case();

  // Publishes a captured point; its instance ends with the set of samples.
  void show(const wire::CapturedPoint &point);
  void show_points(); // all of the registration: fiducials and surface
  void hide_points(); // ends the instances of all tools
  // Ends running operations. Waiting commands are refused with the reason.
  void abandon(const std::string &reason);
  void end_trace();
  void clear_samples();
  [[nodiscard]] tl::expected<const casefile::ToolModel *, Answer> find_tool(const std::string &name) const;
  [[nodiscard]] tl::expected<const casefile::ToolModel *, Answer> find_tool_with_tip(const std::string &name) const;

  SessionConfig config_;
  SessionPorts &ports_;
  Executor executor_;
  SnapshotFile file_;
  StateMachine machine_;
  AlarmRegistry alarm_registry_;
  ReplyCache reply_cache_;
  SessionData data_;
  SnapshotSaver saver_;
  std::uint64_t version_ = 0;         // of data_
  std::uint64_t version_before_ = 0;  // at the beginning of the present call
  std::uint64_t saving_ = 0;          // the version that the saver has got last
  std::uint64_t saved_ = 0;           // the version whose outcome is known
  std::int64_t submitted_ns_ = 0;     // when the saver got it
  std::int64_t waiting_since_ns_ = 0; // for the disk
  bool save_failed_ = false;          // the latest outcome
  std::deque<PendingReply> unsaved_replies_;
  std::optional<PendingLoad> load_;
  std::optional<PendingRestore> restoring_;
  std::shared_ptr<const casefile::Case> case_;
  std::optional<SessionChanged> announced_;
  std::optional<RegistrationEstimate> estimate_; // the latest
  std::uint64_t next_request_ = 1;
  std::optional<PendingCapture> capture_;
  std::optional<PendingAccept> accept_;
  std::deque<PassedOn> passed_on_;
  std::optional<PivotRun> pivot_;
  std::optional<Ticket> pivot_ticket_; // the FINISH_PIVOT that waits for the estimate
  std::optional<PlanSelected> plan_;   // plan of the navigated tool
  std::string tracing_;                // the tracing tool; empty if there is none
  std::size_t traced_ = 0;             // samples of the current trace
  std::optional<ScanRequest> scan_;    // the trace is a scan by an arm
  bool arm_replaced_ = false;          // since the samples were taken
  int missed_checks_ = 0;              // since the last check touch at its landmark
  std::set<std::string> shown_tools_;  // with captured points on the bus
};

[[nodiscard]] inline Answer refused(std::string text) { return {bregma_wire_COMMAND_REFUSED, std::move(text)}; }

template <class Message> void Session::Impl::send_all(const Message &message) {
  ports_.send(NavigationMessage(message));
  ports_.send(RegistrationMessage(message));
  ports_.send(MonitoringMessage(message));
}

// The DDS message for a sample.
template <class Sample>
[[nodiscard]] wire::CapturedPoint captured_point(const Sample &sample, wire::CaptureKind kind, std::string_view point) {
  wire::CapturedPoint out{};
  std::copy(std::begin(sample.tool), std::end(sample.tool), out.tool);
  out.kind = kind;
  out.frame = sample.frame;
  out.acquired_time_ns = sample.acquired_time_ns;
  (void)wire::set_name(out.point, point); // it was a valid name before
  std::copy(sample.position_mm.begin(), sample.position_mm.end(), out.position_mm);
  std::copy(sample.covariance_mm2.begin(), sample.covariance_mm2.end(), out.covariance_mm2);
  return out;
}

} // namespace bregma::server
