// The session: one case from loading to navigation. It receives commands, decides by the state machine and the data,
// sends messages to the loops, and answers every command exactly once.
//
// The class uses no DDS and has no threads, and the caller passes the time. It runs on the control thread, or in
// virtual time in a test. It never waits: other threads load cases and write snapshots (Executor). Every change is on
// disk before its reply is published, so only such replies wait for the disk; alarms and changes of the state do not.
// All answers are sent through SessionPorts, some at once, some from a later poll().
//
// A command that is sent again (same client, id, kind and sent_time_ns) gets its first answer again and is not executed
// again.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "server/session/case_loading.hpp"
#include "server/session/messages.hpp"
#include "server/session/snapshot.hpp"
#include "server/session/work.hpp"

namespace bregma::server {

// Receives the session's decisions. All calls come from the thread that called the session.
class SessionPorts {
public:
  virtual ~SessionPorts() = default;

  // Builds what use_case() needs. The function runs on a loading thread and may outlive the ports.
  [[nodiscard]] virtual PrepareCase preparation() = 0;
  // Called before any message about the case; both are null if the case was closed.
  virtual void use_case(std::shared_ptr<const casefile::Case> loaded, std::shared_ptr<PreparedCase> prepared) = 0;
  // The order is kept and no message is lost: if the ring is full, the port keeps a backlog. A restore sends all
  // samples.
  virtual void send(const NavigationMessage &message) = 0;
  virtual void send(const RegistrationMessage &message) = 0;
  virtual void send(const MonitoringMessage &message) = 0;
  // A command of the scanner's procedure, or about the motion of an arm; its stage answers by a StageAnswer.
  virtual void send_to_scanner(const wire::Command &command) = 0;
  virtual void send_to_arm(const wire::Command &command) = 0;
  virtual void send(const ScanRequest &request) = 0;

  virtual void publish(const wire::CommandReply &reply) = 0;
  virtual void publish(const wire::Alarm &alarm) = 0;
  // A sample that joined the session's set, or a check; with the field ended set: the tool's samples are void.
  virtual void publish(const wire::CapturedPoint &point) = 0;
  virtual void log(const std::string &line) = 0;
};

struct SessionConfig {
  std::filesystem::path state_directory;
  double capture_window_ms = 300.0;
  double capture_max_motion_mm = 1.0;
  double trace_spacing_mm = 3.0;
  std::size_t trace_max_samples = 2000;
  double pivot_min_rotation_rad = 0.5;
  std::size_t pivot_max_samples = 3000;
  double tracker_sigma_mm =
      0.3; // standard deviation of a tool's position per coordinate, compared with a pivot's residual
  std::size_t min_checks = 3; // check touches at different landmarks, required for a verification
  // In a case without a tracker a verification ends when the last check touch is older.
  double check_valid_min = 15.0;
  double answer_timeout_ms = 2000.0;   // the command fails if a loop has not answered within this time
  double motion_timeout_ms = 15'000.0; // the same for motions of an arm, whose path is planned and checked first
  double load_timeout_ms = 30'000.0;   // a case that is not loaded within this time is refused
};

class Session {
public:
  Session(SessionConfig config, SessionPorts &ports, Executor executor = {});
  ~Session();
  Session(const Session &) = delete;
  Session &operator=(const Session &) = delete;

  // Restores the snapshot of the last process. Call it first. An accepted registration is restored as Registered;
  // without one, the case and the samples are restored. Invalid content is logged, and the session starts as Idle. With
  // an executor the session is Idle until its case is loaded, and refuses to load another one in the meantime. If the
  // folder cannot be read, an alarm is raised and the session stays Idle; it is tried again until it is there (and the
  // case unchanged) or another case is loaded.
  void restore(std::int64_t now_ns);

  void handle(const wire::Command &command, std::int64_t now_ns);
  void on(const NavigationEvent &event, std::int64_t now_ns);
  void on(const RegistrationEstimate &estimate, std::int64_t now_ns);
  void on(const AlarmCondition &condition, std::int64_t now_ns);
  void on(const StageAnswer &answer, std::int64_t now_ns);
  // Sends answers that wait for a loop, a worker or a timeout. Call it at 10 Hz or more.
  void poll(std::int64_t now_ns);

  // Sets the current recording; it is kept in the snapshot.
  void recording_to(const std::filesystem::path &file);

  [[nodiscard]] wire::SessionState state() const;
  // Null if no case is loaded.
  [[nodiscard]] std::shared_ptr<const casefile::Case> loaded_case() const;
  [[nodiscard]] const SessionData &data() const;

private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

} // namespace bregma::server
