// The session with loops that answer at once: the steps of a biopsy, messages to the loops, and interruptions.
#include "session_fakes.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdio>

#include <gtest/gtest.h>

#include "idl/names.hpp"

namespace bregma::server::testing {
namespace {

class SessionTest : public ::testing::Test {
protected:
  TemporaryFolder folder;
  std::filesystem::path ball = write_case(folder.path());
  FakeLoops loops;
  SessionHarness harness{folder.path(), loops};
};

TEST_F(SessionTest, ACompleteBiopsy) {
  harness.up_to(kCaseLoaded, ball);
  ASSERT_NE(loops.the_case, nullptr);
  EXPECT_STREQ(loops.replies.back().text, "case ball: 6 fiducials, 5 check landmarks, 1 targets, 1 trajectories, tools "
                                          "Reference, Stylus, Probe");
  EXPECT_EQ(FakeLoops::count<ToolTip>(loops.navigation), 0U) << "a nominal tip is not a calibrated one";

  harness.up_to(kRegistering, ball);
  const auto tip = FakeLoops::last<ToolTip>(loops.navigation);
  EXPECT_EQ(wire::view(tip.tool), "Stylus");
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(tip.tip_mm[i], loops.tip_mm[static_cast<Eigen::Index>(i)], 5.0 * std::sqrt(tip.covariance_mm2[4 * i]));
    EXPECT_GT(tip.covariance_mm2[4 * i], 0.0);
  }

  harness.up_to(kRegistered, ball);
  EXPECT_EQ(FakeLoops::count<FiducialSample>(loops.registration), 4U);
  EXPECT_EQ(FakeLoops::count<SurfaceSample>(loops.registration), 20U);
  const auto fiducial = FakeLoops::last<FiducialSample>(loops.registration);
  EXPECT_EQ(fiducial.position_mm, loops.in_reference(loops.the_case->fiducial("F4")->position_mm));
  EXPECT_EQ(loops.captured.size(), 24U);
  const auto accepted = FakeLoops::last<RegistrationAccepted>(loops.navigation);
  EXPECT_EQ(accepted.revision, loops.revision);
  const auto estimate = loops.estimate();
  using Bytes = std::array<std::byte, sizeof(wire::Pose)>;
  EXPECT_EQ(std::bit_cast<Bytes>(accepted.T_image_reference), std::bit_cast<Bytes>(estimate.T_image_reference));
  EXPECT_EQ(FakeLoops::count<RegistrationAccepted>(loops.monitoring), 1U);
  EXPECT_EQ(FakeLoops::count<RegistrationAccepted>(loops.registration), 1U);
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops.navigation).verified);

  harness.up_to(kVerified, ball);
  EXPECT_EQ(FakeLoops::count<JudgedCheck>(loops.monitoring), 3U);
  EXPECT_TRUE(FakeLoops::last<SessionChanged>(loops.navigation).verified);

  harness.up_to(kNavigating, ball);
  EXPECT_EQ(wire::view(FakeLoops::last<PlanSelected>(loops.navigation).trajectory), "Plan");
  harness.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L4"); // a check is allowed at any time
  harness.done(bregma_wire_COMMAND_STOP_NAVIGATION);
  EXPECT_EQ(harness.session->state(), kVerified);
  EXPECT_FALSE(FakeLoops::last<PlanSelected>(loops.navigation).on);
  harness.done(bregma_wire_COMMAND_CLOSE_CASE);
  EXPECT_EQ(harness.session->state(), kIdle);
  EXPECT_EQ(loops.the_case, nullptr);
  EXPECT_EQ(FakeLoops::count<RegistrationReset>(loops.navigation), 3U);
  for (const wire::CommandReply &reply : loops.replies) {
    EXPECT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
  }
}

TEST_F(SessionTest, ACheckTouchReportsTheDistanceAndItsBound) {
  harness.up_to(kRegistered, ball);
  loops.miss_mm = {0.6, 0.0, -0.8};
  const auto reply = harness.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L2");
  EXPECT_NEAR(reply.value_mm, 1.0, 1e-9);
  const auto check = FakeLoops::last<JudgedCheck>(loops.monitoring);
  EXPECT_EQ(check.landmark_index, 1U);
  EXPECT_NEAR(check.error_mm[0], 0.6, 1e-9);
  EXPECT_NEAR(check.error_mm[2], -0.8, 1e-9);
  // Registration 0.2 mm and 0.002 rad at 80 mm, landmark 0.5, touch 0.3, tip: about 0.65 mm per coordinate. The 95 %
  // bound of chi(3) is 2.8 times that.
  EXPECT_GT(check.limit_mm, 1.4);
  EXPECT_LT(check.limit_mm, 2.2);
  char expected[96];
  std::snprintf(expected, sizeof expected, "L2 is shown 1.00 mm off, 95 %% bound %.2f mm", check.limit_mm);
  EXPECT_STREQ(reply.text, expected);
}

TEST_F(SessionTest, AnEstimateThatLacksTheLastSampleIsNotAccepted) {
  harness.up_to(kRegistering, ball);
  for (const char *fiducial : {"F1", "F2", "F3"}) {
    harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", fiducial);
  }
  harness.done(bregma_wire_COMMAND_REMOVE_FIDUCIAL, "F2");
  EXPECT_EQ(wire::view(FakeLoops::last<FiducialRemoved>(loops.registration).point), "F2");
  // The registration loop has not answered yet: the session waits for it.
  harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F2");
  auto old = loops.estimate();
  old.revision -= 1;
  harness.answering = false;
  harness.session->on(old, harness.now_ns);
  EXPECT_FALSE(harness.send(harness.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION)));
  EXPECT_EQ(harness.session->state(), kRegistering);
  harness.session->on(loops.estimate(), harness.now_ns);
  EXPECT_EQ(loops.replies.back().result, bregma_wire_COMMAND_DONE) << loops.replies.back().text;
  EXPECT_EQ(harness.session->state(), kRegistered);
  EXPECT_EQ(harness.session->data().accepted->revision, loops.revision);
}

TEST_F(SessionTest, ARemovedFiducialIsNoCapturedPointAnyMore) {
  harness.up_to(kRegistering, ball);
  for (const char *fiducial : {"F1", "F2", "F3"}) {
    harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", fiducial);
  }
  loops.captured.clear();
  harness.done(bregma_wire_COMMAND_REMOVE_FIDUCIAL, "F2");
  ASSERT_EQ(loops.captured.size(), 3U);
  EXPECT_TRUE(loops.captured[0].ended) << "the instance of the tool";
  EXPECT_EQ(wire::view(loops.captured[1].point), "F1");
  EXPECT_EQ(wire::view(loops.captured[2].point), "F3");
}

TEST_F(SessionTest, ALostTrackerDegradesAndTheSessionResumesAutomatically) {
  harness.up_to(kNavigating, ball);
  harness.condition(alarm::kTrackerLost, "Tracker", true, SessionEffect::kDegrade);
  EXPECT_EQ(harness.session->state(), kDegraded);
  EXPECT_EQ(FakeLoops::last<SessionChanged>(loops.navigation).state, kDegraded);
  EXPECT_TRUE(FakeLoops::last<SessionChanged>(loops.navigation).verified) << "the registration is as good as it was";
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_RAISED);
  EXPECT_EQ(harness.ask(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L1").result, bregma_wire_COMMAND_REFUSED_BY_STATE);
  harness.condition(alarm::kTrackerLost, "Tracker", false, SessionEffect::kDegrade);
  EXPECT_EQ(harness.session->state(), kNavigating);
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_CLEARED);
  EXPECT_TRUE(FakeLoops::last<PlanSelected>(loops.navigation).on);
}

TEST_F(SessionTest, DriftDemotesAndTheOperatorMustVerifyAgain) {
  harness.up_to(kNavigating, ball);
  harness.condition(alarm::kTrackerLost, "Tracker", true, SessionEffect::kDegrade);
  harness.condition(alarm::kDrift, "Reference", true, SessionEffect::kDemote,
                    "the reference seems to have moved by 2 mm");
  harness.condition(alarm::kTrackerLost, "Tracker", false, SessionEffect::kDegrade);
  EXPECT_EQ(harness.session->state(), kRegistered) << "it must not resume as Navigating";
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops.navigation).verified);
  EXPECT_FALSE(FakeLoops::last<PlanSelected>(loops.navigation).on);
  harness.check_landmarks();
  const auto refused = harness.ask(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  EXPECT_STREQ(refused.text, "a drift alarm is not acknowledged: acknowledge it, then check the landmarks again");
  harness.done(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, alarm::kDrift, "Reference");
  EXPECT_EQ(FakeLoops::count<DriftRestart>(loops.monitoring), 1U);
  harness.condition(alarm::kDrift, "Reference", false, SessionEffect::kDemote);
  EXPECT_EQ(harness.session->state(), kRegistered) << "the end of the alarm verifies nothing";
  harness.done(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  EXPECT_EQ(harness.session->state(), kVerified);
  EXPECT_EQ(wire::view(loops.alarms.back().kind), "verification");
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_CLEARED);
}

TEST_F(SessionTest, ClosingTheCaseEndsAFault) {
  harness.up_to(kVerified, ball);
  harness.condition("loop_stopped", "navigation", true, SessionEffect::kFault, "no step for 2 s");
  EXPECT_EQ(harness.session->state(), kFault);
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops.navigation).verified);
  EXPECT_STREQ(
      harness.ask(bregma_wire_COMMAND_START_NAVIGATION, "Stylus", "Plan").text,
      "cannot start the navigation while in Fault (loop_stopped navigation: no step for 2 s): close the case or "
      "restart the daemon");
  harness.done(bregma_wire_COMMAND_CLOSE_CASE);
  EXPECT_EQ(harness.session->state(), kIdle);
}

TEST_F(SessionTest, ARepeatedCommandGetsTheSameReplyAndIsNotExecutedAgain) {
  harness.up_to(kRegistering, ball);
  const auto command = harness.command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  harness.answering = false;
  EXPECT_FALSE(harness.send(command));
  EXPECT_FALSE(harness.send(command)) << "under way: one answer is enough";
  harness.answering = true;
  harness.run(100.0);
  const auto first = loops.replies.back();
  const std::size_t replies = loops.replies.size();
  const auto again = harness.send(command);
  ASSERT_TRUE(again);
  EXPECT_EQ(loops.replies.size(), replies + 1);
  EXPECT_STREQ(again->text, first.text);
  EXPECT_EQ(FakeLoops::count<CaptureRequest>(loops.navigation), 1U);
  EXPECT_EQ(FakeLoops::count<FiducialSample>(loops.registration), 1U);

  auto restarted = command; // a client that restarts its count sends at another time
  restarted.sent_time_ns += 1;
  EXPECT_TRUE(harness.send(restarted));
  EXPECT_EQ(FakeLoops::count<FiducialSample>(loops.registration), 2U);
}

TEST_F(SessionTest, APivotOnAWorkerKeepsTheSessionResponsive) {
  std::vector<std::function<void()>> jobs;
  SessionHarness worker(folder.path() / "other", loops, [&jobs](Work work, std::function<void()> job) {
    if (work == Work::kCompute) {
      jobs.push_back(std::move(job));
    } else {
      job();
    }
  });
  worker.done(bregma_wire_COMMAND_LOAD_CASE, ball.string());
  worker.done(bregma_wire_COMMAND_START_PIVOT, "Probe");
  for (const PivotPose &pose : loops.pivot(FakeLoops::last<PivotRequest>(loops.navigation).id, 0.1, 0.6, 3)) {
    worker.session->on(NavigationEvent(pose), worker.now_ns);
  }
  const auto finish = worker.command(bregma_wire_COMMAND_FINISH_PIVOT, "Probe");
  EXPECT_FALSE(worker.send(finish));
  worker.done(bregma_wire_COMMAND_START_REGISTRATION); // abandons the pivot calibration
  EXPECT_EQ(loops.replies[loops.replies.size() - 2].id, finish.id);
  EXPECT_STREQ(loops.replies[loops.replies.size() - 2].text, "given up: the registration was started anew");
  ASSERT_EQ(jobs.size(), 1U);
  jobs[0](); // finishes without an effect
  worker.run(100.0);
  EXPECT_TRUE(worker.session->data().tips.empty());

  worker.done(bregma_wire_COMMAND_START_PIVOT, "Probe");
  for (const PivotPose &pose : loops.pivot(FakeLoops::last<PivotRequest>(loops.navigation).id, 0.1, 0.6, 3)) {
    worker.session->on(NavigationEvent(pose), worker.now_ns);
  }
  EXPECT_FALSE(worker.send(worker.command(bregma_wire_COMMAND_FINISH_PIVOT, "Probe")));
  jobs[1]();
  worker.run(100.0);
  EXPECT_EQ(loops.replies.back().result, bregma_wire_COMMAND_DONE) << loops.replies.back().text;
  EXPECT_TRUE(worker.session->data().tips.contains("Probe"));
}

TEST_F(SessionTest, ANewTipVoidsTheChecksMadeWithTheOldOne) {
  harness.up_to(kVerified, ball);
  harness.pivot("Probe");
  EXPECT_EQ(harness.session->state(), kVerified) << "no check was made with the probe";
  harness.pivot("Stylus");
  EXPECT_EQ(harness.session->state(), kRegistered);
  EXPECT_NE(std::string(loops.replies.back().text).find("verify again"), std::string::npos)
      << loops.replies.back().text;
}

TEST_F(SessionTest, ATraceAfterAcceptanceChecksForDriftWithoutChangingSamples) {
  harness.up_to(kVerified, ball);
  harness.done(bregma_wire_COMMAND_START_TRACE, "Stylus");
  harness.trace("Stylus", 7);
  const auto reply = harness.done(bregma_wire_COMMAND_STOP_TRACE, "Stylus");
  EXPECT_STREQ(reply.text, "7 surface samples traced, 20 in the registration");
  EXPECT_EQ(FakeLoops::count<SurfaceSample>(loops.monitoring), 7U);
  EXPECT_EQ(FakeLoops::count<SurfaceSample>(loops.registration), 20U);
  EXPECT_EQ(harness.session->data().revision, harness.session->data().accepted->revision);
}

TEST_F(SessionTest, TheTraceEndsAtItsMaximalNumberOfSamples) {
  harness.config.trace_max_samples = 30;
  harness.session = std::make_unique<Session>(harness.config, loops);
  harness.up_to(kRegistering, ball);
  harness.done(bregma_wire_COMMAND_START_TRACE, "Stylus");
  harness.trace("Probe", 5); // samples of another tool are ignored
  harness.trace("Stylus", 40);
  EXPECT_EQ(harness.session->data().surface.size(), 30U);
  EXPECT_FALSE(FakeLoops::last<TraceRequest>(loops.navigation).on);
  EXPECT_STREQ(harness.ask(bregma_wire_COMMAND_START_TRACE, "Stylus").text,
               "there are 30 surface samples, the maximum");
}

TEST_F(SessionTest, ACheckTouchFarFromItsLandmarkIsRefusedAndTheSecondDemotes) {
  harness.up_to(kNavigating, ball);
  const auto confirmations = FakeLoops::count<TrackingConfirmed>(loops.navigation);
  EXPECT_EQ(confirmations, 3U) << "one per check touch within the limit";
  const auto checks = FakeLoops::count<JudgedCheck>(loops.monitoring);
  loops.miss_mm = {0.0, 367.0, 0.0};
  const auto first = harness.ask(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L2");
  EXPECT_EQ(first.result, bregma_wire_COMMAND_REFUSED);
  EXPECT_STREQ(first.text,
               "the tip of Stylus is shown 367.00 mm from L2: that is no touch of it (limit 50.00 mm). Touch "
               "the landmark itself; if you did, the reference has moved");
  EXPECT_EQ(harness.session->state(), kNavigating);
  EXPECT_EQ(harness.ask(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L2").result, bregma_wire_COMMAND_REFUSED);
  EXPECT_EQ(harness.session->state(), kRegistered) << "it may be a reference that was knocked off";
  const auto alarm = std::find_if(loops.alarms.begin(), loops.alarms.end(), [](const wire::Alarm &one) {
    return wire::view(one.kind) == alarm::kCheckMissed && one.state == bregma_wire_ALARM_RAISED;
  });
  ASSERT_NE(alarm, loops.alarms.end());
  EXPECT_EQ(wire::view(alarm->subject), "Reference");
  EXPECT_EQ(alarm->severity, bregma_wire_SEVERITY_CRITICAL);
  EXPECT_EQ(FakeLoops::count<JudgedCheck>(loops.monitoring), checks) << "no touch is no evidence of drift";
  EXPECT_EQ(FakeLoops::count<TrackingConfirmed>(loops.navigation), confirmations);

  loops.miss_mm = Eigen::Vector3d::Zero();
  harness.check_landmarks();
  harness.done(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  EXPECT_TRUE(std::any_of(loops.alarms.begin(), loops.alarms.end(), [](const wire::Alarm &one) {
    return wire::view(one.kind) == alarm::kCheckMissed && one.state == bregma_wire_ALARM_CLEARED;
  }));
  loops.miss_mm = {0.0, 60.0, 0.0};
  EXPECT_EQ(harness.ask(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L2").result, bregma_wire_COMMAND_REFUSED);
  EXPECT_EQ(harness.session->state(), kVerified) << "a good touch in between counts anew";
}

} // namespace
} // namespace bregma::server::testing
