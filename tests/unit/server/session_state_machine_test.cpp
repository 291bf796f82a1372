// Every state against every command, from a table that is written down here a second time.
#include "server/session/state_machine.hpp"

#include <array>
#include <map>

#include <gtest/gtest.h>

namespace bregma::server {
namespace {

constexpr wire::SessionState I = bregma_wire_SESSION_IDLE;
constexpr wire::SessionState C = bregma_wire_SESSION_CASE_LOADED;
constexpr wire::SessionState G = bregma_wire_SESSION_REGISTERING;
constexpr wire::SessionState R = bregma_wire_SESSION_REGISTERED;
constexpr wire::SessionState V = bregma_wire_SESSION_VERIFIED;
constexpr wire::SessionState N = bregma_wire_SESSION_NAVIGATING;
constexpr wire::SessionState X = bregma_wire_SESSION_FAULT; // here: refused
constexpr std::array kStages{I, C, G, R, V, N};
constexpr wire::SessionState kDegraded = bregma_wire_SESSION_DEGRADED;

struct Expected {
  const char *name;
  std::array<wire::SessionState, 6> next; // by stage
  bool while_degraded;
};

// In the order of wire::CommandKind.
constexpr std::array<Expected, 15> kExpected{{
    {"LOAD_CASE", {C, X, X, X, X, X}, true},
    {"START_PIVOT", {X, C, G, R, V, X}, false},
    {"FINISH_PIVOT", {X, C, G, R, V, X}, true},
    {"START_REGISTRATION", {X, G, G, G, G, X}, true},
    {"CAPTURE_FIDUCIAL", {X, X, G, X, X, X}, false},
    {"REMOVE_FIDUCIAL", {X, X, G, X, X, X}, true},
    {"START_TRACE", {X, X, G, X, X, X}, false},
    {"STOP_TRACE", {X, X, G, X, X, X}, true},
    {"ACCEPT_REGISTRATION", {X, X, R, X, X, X}, true},
    {"CHECK_TOUCH", {X, X, X, R, V, N}, false},
    {"CONFIRM_VERIFICATION", {X, X, X, V, X, X}, false},
    {"START_NAVIGATION", {X, X, X, X, N, X}, false},
    {"STOP_NAVIGATION", {X, X, X, X, X, V}, true},
    {"ACKNOWLEDGE_ALARM", {I, C, G, R, V, N}, true},
    {"CLOSE_CASE", {X, I, I, I, I, X}, true},
}};

StateMachine at(wire::SessionState stage) {
  StateMachine machine;
  for (const auto kind :
       {bregma_wire_COMMAND_LOAD_CASE, bregma_wire_COMMAND_START_REGISTRATION, bregma_wire_COMMAND_ACCEPT_REGISTRATION,
        bregma_wire_COMMAND_CONFIRM_VERIFICATION, bregma_wire_COMMAND_START_NAVIGATION}) {
    if (machine.stage() != stage) {
      machine.done(kind);
    }
  }
  return machine;
}

TEST(StateMachine, EveryCommandInEveryState) {
  for (std::size_t k = 0; k < kExpected.size(); ++k) {
    const auto kind = static_cast<wire::CommandKind>(k);
    EXPECT_EQ(command_name(kind), kExpected[k].name);
    for (std::size_t s = 0; s < kStages.size(); ++s) {
      SCOPED_TRACE(std::string(kExpected[k].name) + " in " + std::string(state_name(kStages[s])));
      StateMachine machine = at(kStages[s]);
      ASSERT_EQ(machine.state(), kStages[s]);
      EXPECT_EQ(machine.refusal(kind).has_value(), kExpected[k].next[s] == X);

      StateMachine degraded = machine;
      degraded.degrade("tracker_lost Tracker");
      EXPECT_EQ(degraded.refusal(kind).has_value(), kExpected[k].next[s] == X || !kExpected[k].while_degraded);

      StateMachine fault = machine;
      fault.fault("out of memory");
      const bool leaves_fault = kind == bregma_wire_COMMAND_CLOSE_CASE;
      EXPECT_EQ(fault.refusal(kind).has_value(), !leaves_fault && kind != bregma_wire_COMMAND_ACKNOWLEDGE_ALARM);

      if (kExpected[k].next[s] != X) {
        machine.done(kind);
        EXPECT_EQ(machine.state(), kExpected[k].next[s]);
      }
    }
  }
}

TEST(StateMachine, RefusalsSayWhatIsMissing) {
  const auto says = [](wire::SessionState stage, wire::CommandKind kind) { return *at(stage).refusal(kind); };
  EXPECT_EQ(says(G, bregma_wire_COMMAND_CHECK_TOUCH),
            "cannot check a landmark while Registering: accept a registration first");
  EXPECT_EQ(says(I, bregma_wire_COMMAND_START_PIVOT), "cannot start a pivot calibration while Idle: load a case first");
  EXPECT_EQ(says(C, bregma_wire_COMMAND_CAPTURE_FIDUCIAL),
            "cannot capture a fiducial while CaseLoaded: start a registration first");
  EXPECT_EQ(says(R, bregma_wire_COMMAND_CAPTURE_FIDUCIAL),
            "cannot capture a fiducial while Registered: start a new registration first");
  EXPECT_EQ(says(R, bregma_wire_COMMAND_START_NAVIGATION),
            "cannot start the navigation while Registered: verify the registration first");
  EXPECT_EQ(says(V, bregma_wire_COMMAND_STOP_NAVIGATION),
            "cannot stop the navigation while Verified: no navigation is running");
  EXPECT_EQ(says(V, bregma_wire_COMMAND_CONFIRM_VERIFICATION),
            "cannot confirm the verification while Verified: the registration is verified");
  EXPECT_EQ(says(N, bregma_wire_COMMAND_START_REGISTRATION),
            "cannot start a registration while Navigating: stop the navigation first");
  EXPECT_EQ(says(C, bregma_wire_COMMAND_LOAD_CASE),
            "cannot load a case while CaseLoaded: close the present case first");

  StateMachine machine = at(V);
  machine.degrade("tracker_lost Tracker");
  machine.degrade("reference_hidden Reference");
  EXPECT_EQ(*machine.refusal(bregma_wire_COMMAND_CHECK_TOUCH),
            "cannot check a landmark while Degraded (reference_hidden Reference, tracker_lost Tracker): the session "
            "resumes by itself when that is over");
  EXPECT_EQ(*machine.refusal(bregma_wire_COMMAND_LOAD_CASE),
            "cannot load a case while Degraded, before that Verified: close the present case first");
  machine.fault("no memory");
  EXPECT_EQ(*machine.refusal(bregma_wire_COMMAND_CHECK_TOUCH),
            "cannot check a landmark while in Fault (no memory): close the case or restart the daemon");
}

TEST(StateMachine, DegradedResumesWhereItWasWhenTheLastCauseIsGone) {
  for (const auto stage : kStages) {
    StateMachine machine = at(stage);
    machine.degrade("a");
    machine.degrade("b");
    machine.degrade("a");
    EXPECT_EQ(machine.state(), kDegraded);
    EXPECT_EQ(machine.stage(), stage);
    EXPECT_EQ(machine.verified(), stage >= V);
    machine.recover("a");
    EXPECT_EQ(machine.state(), kDegraded);
    machine.recover("b");
    EXPECT_EQ(machine.state(), stage);
  }
}

TEST(StateMachine, DriftDemotesAlsoUnderDegraded) {
  for (const auto stage : kStages) {
    StateMachine machine = at(stage);
    machine.degrade("tracker_lost Tracker");
    EXPECT_EQ(machine.demote(), stage >= V);
    machine.recover("tracker_lost Tracker");
    EXPECT_EQ(machine.state(), std::min(stage, R)) << "nothing resumes as Verified by itself";
    EXPECT_FALSE(machine.verified());
  }
}

TEST(StateMachine, FaultIsLeftOnlyByClosingTheCase) {
  StateMachine machine = at(N);
  machine.fault("navigation loop stopped");
  EXPECT_EQ(machine.state(), bregma_wire_SESSION_FAULT);
  EXPECT_FALSE(machine.verified());
  machine.recover("navigation loop stopped");
  EXPECT_EQ(machine.state(), bregma_wire_SESSION_FAULT);
  machine.done(bregma_wire_COMMAND_CLOSE_CASE);
  EXPECT_EQ(machine.state(), I);
}

TEST(StateMachine, NothingIsRestoredBeyondRegistered) {
  for (const auto stage : kStages) {
    StateMachine machine;
    machine.restore(stage);
    EXPECT_EQ(machine.state(), std::min(stage, R));
  }
}

} // namespace
} // namespace bregma::server
