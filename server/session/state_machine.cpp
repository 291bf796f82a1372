#include "server/session/state_machine.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

#include "idl/commands.hpp"

namespace bregma::server {
namespace {

using wire::CommandKind;
using wire::SessionState;

constexpr SessionState kIdle = bregma_wire_SESSION_IDLE;
constexpr SessionState kCaseLoaded = bregma_wire_SESSION_CASE_LOADED;
constexpr SessionState kRegistering = bregma_wire_SESSION_REGISTERING;
constexpr SessionState kRegistered = bregma_wire_SESSION_REGISTERED;
constexpr SessionState kVerified = bregma_wire_SESSION_VERIFIED;
constexpr SessionState kNavigating = bregma_wire_SESSION_NAVIGATING;
constexpr SessionState kSame = bregma_wire_SESSION_FAULT; // as a row's next stage: the stage does not change

struct Row {
  CommandKind kind;
  SessionState first, last; // first and last stage in which it is allowed
  SessionState next;
  bool needs_tracking;  // needs current measurements: refused while Degraded
  const char *too_late; // advice if the stage is past `last`
};

constexpr Row kTable[] = {
    {bregma_wire_COMMAND_LOAD_CASE, kIdle, kIdle, kCaseLoaded, false, "close the present case first"},
    {bregma_wire_COMMAND_START_PIVOT, kCaseLoaded, kVerified, kSame, true, "stop the navigation first"},
    {bregma_wire_COMMAND_FINISH_PIVOT, kCaseLoaded, kVerified, kSame, false, "stop the navigation first"},
    {bregma_wire_COMMAND_START_REGISTRATION, kCaseLoaded, kVerified, kRegistering, false, "stop the navigation first"},
    {bregma_wire_COMMAND_CAPTURE_FIDUCIAL, kRegistering, kRegistering, kSame, true, "start a new registration first"},
    {bregma_wire_COMMAND_REMOVE_FIDUCIAL, kRegistering, kRegistering, kSame, false, "start a new registration first"},
    {bregma_wire_COMMAND_START_TRACE, kRegistering, kNavigating, kSame, true, ""},
    {bregma_wire_COMMAND_STOP_TRACE, kRegistering, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_START_SURFACE_SCAN, kRegistering, kNavigating, kSame, true, ""},
    {bregma_wire_COMMAND_STOP_SURFACE_SCAN, kRegistering, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_MOVE_TO_TRAJECTORY, kVerified, kNavigating, kSame, true, ""},
    // Passed on to the arm's driver in every state; they need no case.
    {bregma_wire_COMMAND_HOLD_ROBOT, kIdle, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_STOP_ROBOT, kIdle, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_RESET_ROBOT, kIdle, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_ACCEPT_REGISTRATION, kRegistering, kRegistering, kRegistered, false,
     "one is accepted; start a new registration to replace it"},
    {bregma_wire_COMMAND_CHECK_TOUCH, kRegistered, kNavigating, kSame, true, ""},
    {bregma_wire_COMMAND_CONFIRM_VERIFICATION, kRegistered, kRegistered, kVerified, true,
     "the registration is verified"},
    {bregma_wire_COMMAND_START_NAVIGATION, kVerified, kVerified, kNavigating, true,
     "stop the present navigation first"},
    {bregma_wire_COMMAND_STOP_NAVIGATION, kNavigating, kNavigating, kVerified, false, ""},
    {bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, kIdle, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_CLOSE_CASE, kCaseLoaded, kVerified, kIdle, false, "stop the navigation first"},
    // The scanner's stage decides about these; they need no case.
    {bregma_wire_COMMAND_START_SCANNER_REGISTRATION, kIdle, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_CONFIRM_SCANNER_STEP, kIdle, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, kIdle, kNavigating, kSame, false, ""},
    {bregma_wire_COMMAND_RESET_SCANNER_REGISTRATION, kIdle, kNavigating, kSame, false, ""}};

// nullptr: no command of the session.
const Row *find_row(CommandKind kind) {
  const auto *found =
      std::find_if(std::begin(kTable), std::end(kTable), [kind](const Row &row) { return row.kind == kind; });
  return found != std::end(kTable) ? found : nullptr;
}

// The missing step if the stage is too early for a command.
const char *missing_step(SessionState stage) {
  switch (stage) {
  case kIdle:
    return "load a case first";
  case kCaseLoaded:
    return "start a registration first";
  case kRegistering:
    return "accept a registration first";
  case kRegistered:
    return "verify the registration first";
  default:
    return "no navigation is running";
  }
}

} // namespace

std::string_view state_name(SessionState state) {
  constexpr std::array<const char *, 9> kNames{"Unknown",  "Idle",       "CaseLoaded", "Registering", "Registered",
                                               "Verified", "Navigating", "Degraded",   "Fault"};
  return kNames[static_cast<std::size_t>(state)];
}

std::optional<SessionState> stage_named(std::string_view name) {
  for (SessionState stage = kIdle; stage <= kNavigating; ++stage) {
    if (state_name(stage) == name) {
      return stage;
    }
  }
  return std::nullopt;
}

SessionState StateMachine::state() const {
  if (!fault_.empty()) {
    return bregma_wire_SESSION_FAULT;
  }
  // Without a case nothing is degraded, and nothing resumes: the alarms state what is missing.
  return causes_.empty() || stage_ == kIdle ? stage_ : bregma_wire_SESSION_DEGRADED;
}

bool StateMachine::carries_out(CommandKind kind) { return find_row(kind) != nullptr; }

bool StateMachine::verified() const { return fault_.empty() && stage_ >= kVerified; }

std::optional<std::string> StateMachine::refusal(CommandKind kind) const {
  const Row &command = *find_row(kind);
  const std::string opening = std::string("cannot ") + wire::find_command(kind)->deed + " while ";
  if (kind == bregma_wire_COMMAND_ACKNOWLEDGE_ALARM || kind == bregma_wire_COMMAND_STOP_ROBOT ||
      kind == bregma_wire_COMMAND_HOLD_ROBOT) {
    return std::nullopt; // also in Fault
  }
  if (!fault_.empty()) {
    if (kind == bregma_wire_COMMAND_CLOSE_CASE) {
      return std::nullopt;
    }
    return opening + "in Fault (" + fault_ + "): close the case or restart the daemon";
  }
  if (stage_ < command.first || stage_ > command.last) {
    const std::string degraded = state() == stage_ ? "" : "Degraded, before that ";
    return opening + degraded + std::string(state_name(stage_)) + ": " +
           (stage_ < command.first ? missing_step(stage_) : command.too_late);
  }
  if (command.needs_tracking && !causes_.empty()) {
    std::string causes;
    for (const std::string &cause : causes_) {
      causes += (causes.empty() ? "" : ", ") + cause;
    }
    return opening + "Degraded (" + causes + "): the session resumes by itself when that is over";
  }
  return std::nullopt;
}

void StateMachine::done(CommandKind kind) {
  const Row &command = *find_row(kind);
  if (command.next != kSame) {
    stage_ = command.next;
  }
  if (kind == bregma_wire_COMMAND_CLOSE_CASE) {
    fault_.clear();
  }
}

void StateMachine::degrade(std::string cause) { causes_.insert(std::move(cause)); }

void StateMachine::recover(const std::string &cause) { causes_.erase(cause); }

bool StateMachine::demote() {
  if (stage_ < kVerified) {
    return false;
  }
  stage_ = kRegistered;
  return true;
}

void StateMachine::fault(std::string reason) { fault_ = reason.empty() ? "no reason given" : std::move(reason); }

void StateMachine::restore(SessionState stage) { stage_ = std::min(stage, kRegistered); }

} // namespace bregma::server
