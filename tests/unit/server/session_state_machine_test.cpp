// Every command in every state, compared with an independent copy of the table.
#include "server/session/state_machine.hpp"

#include <array>
#include <map>

#include <gtest/gtest.h>

#include "idl/commands.hpp"

namespace bregma::server {
namespace {

// One letter per state, which makes the table below readable.
constexpr wire::SessionState kI = bregma_wire_SESSION_IDLE;
constexpr wire::SessionState kC = bregma_wire_SESSION_CASE_LOADED;
constexpr wire::SessionState kG = bregma_wire_SESSION_REGISTERING;
constexpr wire::SessionState kR = bregma_wire_SESSION_REGISTERED;
constexpr wire::SessionState kV = bregma_wire_SESSION_VERIFIED;
constexpr wire::SessionState kN = bregma_wire_SESSION_NAVIGATING;
constexpr wire::SessionState kDegraded = bregma_wire_SESSION_DEGRADED;
constexpr wire::SessionState kX = bregma_wire_SESSION_FAULT; // here: refused
constexpr std::array kStages{kI, kC, kG, kR, kV, kN};

struct Expected {
  const char *name;
  std::array<wire::SessionState, 6> next; // by stage
  bool while_degraded;
};

// In the order of wire::CommandKind.
constexpr std::array<Expected, 15> kExpected{{
    {"LOAD_CASE", {kC, kX, kX, kX, kX, kX}, true},
    {"START_PIVOT", {kX, kC, kG, kR, kV, kX}, false},
    {"FINISH_PIVOT", {kX, kC, kG, kR, kV, kX}, true},
    {"START_REGISTRATION", {kX, kG, kG, kG, kG, kX}, true},
    {"CAPTURE_FIDUCIAL", {kX, kX, kG, kX, kX, kX}, false},
    {"REMOVE_FIDUCIAL", {kX, kX, kG, kX, kX, kX}, true},
    {"START_TRACE", {kX, kX, kG, kR, kV, kN}, false},
    {"STOP_TRACE", {kX, kX, kG, kR, kV, kN}, true},
    {"ACCEPT_REGISTRATION", {kX, kX, kR, kX, kX, kX}, true},
    {"CHECK_TOUCH", {kX, kX, kX, kR, kV, kN}, false},
    {"CONFIRM_VERIFICATION", {kX, kX, kX, kV, kX, kX}, false},
    {"START_NAVIGATION", {kX, kX, kX, kX, kN, kX}, false},
    {"STOP_NAVIGATION", {kX, kX, kX, kX, kX, kV}, true},
    {"ACKNOWLEDGE_ALARM", {kI, kC, kG, kR, kV, kN}, true},
    {"CLOSE_CASE", {kX, kI, kI, kI, kI, kX}, true},
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
    const auto kind = static_cast<wire::CommandKind>(k + 1); // 0 is no command
    EXPECT_EQ(wire::command_name(kind), kExpected[k].name);
    ASSERT_TRUE(StateMachine::carries_out(kind));
    for (std::size_t s = 0; s < kStages.size(); ++s) {
      SCOPED_TRACE(std::string(kExpected[k].name) + " in " + std::string(state_name(kStages[s])));
      StateMachine machine = at(kStages[s]);
      ASSERT_EQ(machine.state(), kStages[s]);
      EXPECT_EQ(machine.refusal(kind).has_value(), kExpected[k].next[s] == kX);

      StateMachine degraded = machine;
      degraded.degrade("tracker_lost Tracker");
      EXPECT_EQ(degraded.refusal(kind).has_value(), kExpected[k].next[s] == kX || !kExpected[k].while_degraded);

      StateMachine fault = machine;
      fault.fault("out of memory");
      const bool leaves_fault = kind == bregma_wire_COMMAND_CLOSE_CASE;
      EXPECT_EQ(fault.refusal(kind).has_value(), !leaves_fault && kind != bregma_wire_COMMAND_ACKNOWLEDGE_ALARM);

      if (kExpected[k].next[s] != kX) {
        machine.done(kind);
        EXPECT_EQ(machine.state(), kExpected[k].next[s]);
      }
    }
  }
}

TEST(StateMachine, AnArmIsStoppedInEveryStateAndMovedOnlyWhenVerified) {
  for (const wire::SessionState stage : kStages) {
    StateMachine machine = at(stage);
    EXPECT_EQ(machine.refusal(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY).has_value(), stage != kV && stage != kN);
    EXPECT_FALSE(machine.refusal(bregma_wire_COMMAND_RESET_ROBOT));
    machine.degrade("robot_lost Robot");
    EXPECT_TRUE(machine.refusal(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY));
    machine.fault("out of memory");
    EXPECT_TRUE(machine.refusal(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY));
    for (const auto kind : {bregma_wire_COMMAND_STOP_ROBOT, bregma_wire_COMMAND_HOLD_ROBOT}) {
      EXPECT_FALSE(machine.refusal(kind)) << wire::command_name(kind);
      machine.done(kind);
      EXPECT_EQ(machine.stage(), stage);
    }
  }
}

TEST(StateMachine, RefusalsNameTheMissingStep) {
  const auto says = [](wire::SessionState stage, wire::CommandKind kind) { return *at(stage).refusal(kind); };
  EXPECT_EQ(says(kG, bregma_wire_COMMAND_CHECK_TOUCH),
            "cannot check a landmark while Registering: accept a registration first");
  EXPECT_EQ(says(kI, bregma_wire_COMMAND_START_PIVOT),
            "cannot start a pivot calibration while Idle: load a case first");
  EXPECT_EQ(says(kC, bregma_wire_COMMAND_CAPTURE_FIDUCIAL),
            "cannot capture a fiducial while CaseLoaded: start a registration first");
  EXPECT_EQ(says(kR, bregma_wire_COMMAND_CAPTURE_FIDUCIAL),
            "cannot capture a fiducial while Registered: start a new registration first");
  EXPECT_EQ(says(kR, bregma_wire_COMMAND_START_NAVIGATION),
            "cannot start the navigation while Registered: verify the registration first");
  EXPECT_EQ(says(kV, bregma_wire_COMMAND_STOP_NAVIGATION),
            "cannot stop the navigation while Verified: no navigation is running");
  EXPECT_EQ(says(kV, bregma_wire_COMMAND_CONFIRM_VERIFICATION),
            "cannot confirm the verification while Verified: the registration is verified");
  EXPECT_EQ(says(kN, bregma_wire_COMMAND_START_REGISTRATION),
            "cannot start a registration while Navigating: stop the navigation first");
  EXPECT_EQ(says(kC, bregma_wire_COMMAND_LOAD_CASE),
            "cannot load a case while CaseLoaded: close the present case first");

  StateMachine machine = at(kV);
  machine.degrade("tracker_lost Tracker");
  machine.degrade("reference_hidden Reference");
  EXPECT_EQ(*machine.refusal(bregma_wire_COMMAND_CHECK_TOUCH),
            "cannot check a landmark while Degraded (reference_hidden Reference, tracker_lost Tracker): the session "
            "resumes by itself when that is over");
  EXPECT_EQ(*machine.refusal(bregma_wire_COMMAND_LOAD_CASE),
            "cannot load a case while Degraded, before that Verified: close the present case first");
  StateMachine without_a_case;
  without_a_case.degrade("tracker_lost Tracker");
  EXPECT_EQ(*without_a_case.refusal(bregma_wire_COMMAND_START_PIVOT),
            "cannot start a pivot calibration while Idle: load a case first");
  machine.fault("no memory");
  EXPECT_EQ(*machine.refusal(bregma_wire_COMMAND_CHECK_TOUCH),
            "cannot check a landmark while in Fault (no memory): close the case or restart the daemon");
}

TEST(StateMachine, DegradedResumesItsStageAfterTheLastCauseEnds) {
  for (const auto stage : kStages) {
    const auto with_a_cause = stage == kI ? kI : kDegraded; // without a case there is nothing to resume
    StateMachine machine = at(stage);
    machine.degrade("a");
    machine.degrade("b");
    machine.degrade("a");
    EXPECT_EQ(machine.state(), with_a_cause);
    EXPECT_EQ(machine.stage(), stage);
    EXPECT_EQ(machine.verified(), stage >= kV);
    machine.recover("a");
    EXPECT_EQ(machine.state(), with_a_cause);
    machine.recover("b");
    EXPECT_EQ(machine.state(), stage);
  }
}

TEST(StateMachine, DriftDemotesAlsoWhileDegraded) {
  for (const auto stage : kStages) {
    StateMachine machine = at(stage);
    machine.degrade("tracker_lost Tracker");
    EXPECT_EQ(machine.demote(), stage >= kV);
    machine.recover("tracker_lost Tracker");
    EXPECT_EQ(machine.state(), std::min(stage, kR)) << "nothing resumes as Verified by itself";
    EXPECT_FALSE(machine.verified());
  }
}

TEST(StateMachine, OnlyClosingTheCaseEndsAFault) {
  StateMachine machine = at(kN);
  machine.fault("navigation loop stopped");
  EXPECT_EQ(machine.state(), bregma_wire_SESSION_FAULT);
  EXPECT_FALSE(machine.verified());
  machine.recover("navigation loop stopped");
  EXPECT_EQ(machine.state(), bregma_wire_SESSION_FAULT);
  machine.done(bregma_wire_COMMAND_CLOSE_CASE);
  EXPECT_EQ(machine.state(), kI);
}

TEST(StateMachine, ARestoredStageIsAtMostRegistered) {
  for (const auto stage : kStages) {
    StateMachine machine;
    machine.restore(stage);
    EXPECT_EQ(machine.state(), std::min(stage, kR));
  }
}

} // namespace
} // namespace bregma::server
