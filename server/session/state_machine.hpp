// The states of a session and which command fits which: one table (state_machine.cpp), nothing else.
//
// A session stands in one of Idle .. Navigating (its stage). Degraded lies over a stage and remembers it: when the last
// cause is gone the session resumes there by itself. A demotion (drift) changes the stage to Registered at most, also
// under Degraded, so that nothing resumes as Verified that a person has not verified. Fault is left only by CLOSE_CASE.
// Threads: none of its own, one caller.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "idl/topics.hpp"

namespace bregma::server {

[[nodiscard]] std::string_view state_name(wire::SessionState state); // "Registering"
// Idle .. Navigating by its name; nothing for any other text.
[[nodiscard]] std::optional<wire::SessionState> stage_named(std::string_view name);

class StateMachine {
public:
  // What clients are shown.
  [[nodiscard]] wire::SessionState state() const;
  // Where a Degraded session resumes; otherwise the state itself (the last stage in Fault).
  [[nodiscard]] wire::SessionState stage() const { return stage_; }
  [[nodiscard]] bool verified() const;

  // False for a command that is no session's, such as one to a robot.
  [[nodiscard]] static bool carries_out(wire::CommandKind kind);
  // Only for commands that a session carries out. Nothing when the command fits, else the sentence that refuses it and
  // says what to do.
  [[nodiscard]] std::optional<std::string> refusal(wire::CommandKind kind) const;
  // The command was carried out: moves to the state it leads to. Only after refusal() returned nothing.
  void done(wire::CommandKind kind);

  // cause: a key that recover() repeats, for example "tracker_lost Tracker".
  void degrade(std::string cause);
  void recover(const std::string &cause);
  // Verified and Navigating become Registered. True when something changed.
  bool demote();
  void fault(std::string reason);
  // At start: a stage from the snapshot, at most Registered.
  void restore(wire::SessionState stage);

private:
  wire::SessionState stage_ = bregma_wire_SESSION_IDLE;
  std::set<std::string> causes_;
  std::string fault_;
};

} // namespace bregma::server
