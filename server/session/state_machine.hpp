// The states of a session and the commands allowed in each, defined by one table in state_machine.cpp.
//
// A session is in one of the stages Idle to Navigating. Degraded is an overlay that keeps the stage: after the last
// cause ends, the session resumes in it automatically. It is not shown while Idle. A demotion (drift) lowers the stage
// to at most Registered, also while Degraded. So a session resumes as Verified only if the operator has verified it.
// Only CLOSE_CASE leaves Fault.
// Threads: none, one caller.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "idl/topics.hpp"

namespace bregma::server {

[[nodiscard]] std::string_view state_name(wire::SessionState state); // "Registering"
// A stage, Idle to Navigating, from its name; empty for any other text.
[[nodiscard]] std::optional<wire::SessionState> stage_named(std::string_view name);

class StateMachine {
public:
  // The state shown to clients.
  [[nodiscard]] wire::SessionState state() const;
  // The stage in which a Degraded session resumes; otherwise the state itself (the last stage in Fault).
  [[nodiscard]] wire::SessionState stage() const { return stage_; }
  [[nodiscard]] bool verified() const;

  // False for a command that is not for a session, such as one for a robot.
  [[nodiscard]] static bool carries_out(wire::CommandKind kind);
  // Only for commands of a session. Empty if the command is allowed, otherwise the reason of the refusal with advice.
  [[nodiscard]] std::optional<std::string> refusal(wire::CommandKind kind) const;
  // The command was executed: moves to the next state. Precondition: refusal() was empty.
  void done(wire::CommandKind kind);

  // cause: a key that recover() repeats, for example "tracker_lost Tracker".
  void degrade(std::string cause);
  void recover(const std::string &cause);
  // Changes Verified and Navigating to Registered. True if the stage changed.
  bool demote();
  void fault(std::string reason);
  // At start: sets a stage from the snapshot, at most Registered.
  void restore(wire::SessionState stage);

private:
  wire::SessionState stage_ = bregma_wire_SESSION_IDLE;
  std::set<std::string> causes_;
  std::string fault_;
};

} // namespace bregma::server
