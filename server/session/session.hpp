// The session: one case from loading to navigation. It takes commands, decides by the state machine and the data, tells
// the loops, and answers every command exactly once.
//
// Plain class: no DDS, no threads of its own, time is passed in; it runs on the control thread, or in virtual time in a
// test. It blocks for the disk (loading a case, writing the snapshot) and for nothing else. Every change is on disk
// before its reply is published. All answers leave through SessionPorts, some at once, some from a later poll().
//
// A command that is sent again (same client, id and sent_time_ns) gets its first answer again and is not carried out
// twice.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "casefile/case.hpp"
#include "server/session/messages.hpp"
#include "server/session/snapshot.hpp"

namespace bregma::server {

// Where a session's decisions go. All calls come from the thread that called the session.
class SessionPorts {
public:
  virtual ~SessionPorts() = default;

  // Before any message about it; nullptr: the case was closed. An error refuses the case.
  [[nodiscard]] virtual base::Result<void> use_case(std::shared_ptr<const casefile::Case> loaded) = 0;
  // Order is kept and nothing is lost: where the ring is full the port keeps a backlog. A restore sends every sample.
  virtual void send(const NavigationMessage &message) = 0;
  virtual void send(const RegistrationMessage &message) = 0;
  virtual void send(const MonitoringMessage &message) = 0;

  virtual void publish(const wire::CommandReply &reply) = 0;
  virtual void publish(const wire::Alarm &alarm) = 0;
  virtual void publish(const wire::CapturedPoint &point) = 0; // a sample the session has taken into its set, or a check
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
      0.3; // of a tool's pose at its origin, 1-sigma a coordinate: what a pivot's residual is held against
  std::size_t min_checks = 3;        // check touches, at different landmarks, before a verification
  double answer_timeout_ms = 2000.0; // a loop that has not answered by then fails the command
};

class Session {
public:
  // Runs a job elsewhere; empty: inline, so that virtual time stays deterministic.
  using Executor = std::function<void(std::function<void()>)>;

  Session(SessionConfig config, SessionPorts &ports, Executor executor = {});
  ~Session();
  Session(const Session &) = delete;
  Session &operator=(const Session &) = delete;

  // At start, before anything else: what the last process left behind. A registration that had been accepted comes back
  // as Registered; without one the case and the samples come back. Whatever does not hold is logged and starts Idle.
  void restore(std::int64_t now_ns);

  void handle(const wire::Command &command, std::int64_t now_ns);
  void on(const NavigationEvent &event, std::int64_t now_ns);
  void on(const wire::RegistrationState &estimate, std::int64_t now_ns);
  void on(const AlarmCondition &condition, std::int64_t now_ns);
  // At least ten times a second: answers that wait for a loop, a worker or a timeout.
  void poll(std::int64_t now_ns);

  // The file that is being recorded to; kept in the snapshot.
  void recording_to(const std::filesystem::path &file);

  [[nodiscard]] wire::SessionState state() const;
  // Null when no case is loaded.
  [[nodiscard]] std::shared_ptr<const casefile::Case> loaded_case() const;
  [[nodiscard]] const SessionData &data() const;

private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

} // namespace bregma::server
