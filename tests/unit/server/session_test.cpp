// The session against loops that answer at once: the course of a biopsy, what it tells the loops, and what interrupts
// it.
#include "session_fakes.hpp"

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
  Desk desk{folder.path(), loops};
};

TEST_F(SessionTest, TheCourseOfABiopsy) {
  desk.up_to(kCaseLoaded, ball);
  ASSERT_NE(loops.the_case, nullptr);
  EXPECT_STREQ(loops.replies.back().text, "case ball: 6 fiducials, 5 check landmarks, 1 targets, 1 trajectories, tools "
                                          "Reference, Stylus, Probe");
  EXPECT_EQ(FakeLoops::count<ToolTip>(loops.navigation), 0U) << "a nominal tip is not a calibrated one";

  desk.up_to(kRegistering, ball);
  const auto tip = FakeLoops::last<ToolTip>(loops.navigation);
  EXPECT_EQ(wire::view(tip.tool), "Stylus");
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(tip.tip_mm[i], loops.tip_mm[static_cast<Eigen::Index>(i)], 5.0 * std::sqrt(tip.covariance_mm2[4 * i]));
    EXPECT_GT(tip.covariance_mm2[4 * i], 0.0);
  }

  desk.up_to(kRegistered, ball);
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

  desk.up_to(kVerified, ball);
  EXPECT_EQ(FakeLoops::count<CheckTouch>(loops.monitoring), 3U);
  EXPECT_TRUE(FakeLoops::last<SessionChanged>(loops.navigation).verified);

  desk.up_to(kNavigating, ball);
  EXPECT_EQ(wire::view(FakeLoops::last<PlanSelected>(loops.navigation).trajectory), "Plan");
  desk.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L4"); // a check is welcome at any time
  desk.done(bregma_wire_COMMAND_STOP_NAVIGATION);
  EXPECT_EQ(desk.session->state(), kVerified);
  EXPECT_FALSE(FakeLoops::last<PlanSelected>(loops.navigation).on);
  desk.done(bregma_wire_COMMAND_CLOSE_CASE);
  EXPECT_EQ(desk.session->state(), kIdle);
  EXPECT_EQ(loops.the_case, nullptr);
  EXPECT_EQ(FakeLoops::count<RegistrationReset>(loops.navigation), 3U);
  for (const wire::CommandReply &reply : loops.replies) {
    EXPECT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
  }
}

TEST_F(SessionTest, ACheckTouchSaysTheDistanceAndItsBound) {
  desk.up_to(kRegistered, ball);
  loops.miss_mm = {0.6, 0.0, -0.8};
  const auto reply = desk.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L2");
  EXPECT_NEAR(reply.value_mm, 1.0, 1e-9);
  const auto check = FakeLoops::last<CheckTouch>(loops.monitoring);
  EXPECT_EQ(check.landmark_index, 1U);
  EXPECT_NEAR(check.error_mm[0], 0.6, 1e-9);
  EXPECT_NEAR(check.error_mm[2], -0.8, 1e-9);
  // Registration 0.2 mm and 0.002 rad at 80 mm, landmark 0.5, touch 0.3, tip: about 0.65 a coordinate, chi(3) at 95 %
  // is 2.8 times that.
  EXPECT_GT(check.limit_mm, 1.4);
  EXPECT_LT(check.limit_mm, 2.2);
  char expected[96];
  std::snprintf(expected, sizeof expected, "L2 is shown 1.00 mm off, 95 %% bound %.2f mm", check.limit_mm);
  EXPECT_STREQ(reply.text, expected);
}

TEST_F(SessionTest, AnEstimateThatLacksTheLastSampleIsNotAccepted) {
  desk.up_to(kRegistering, ball);
  for (const char *fiducial : {"F1", "F2", "F3"}) {
    desk.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", fiducial);
  }
  desk.done(bregma_wire_COMMAND_REMOVE_FIDUCIAL, "F2");
  EXPECT_EQ(wire::view(FakeLoops::last<FiducialRemoved>(loops.registration).point), "F2");
  // The registration loop has not come round yet: the session waits for it.
  desk.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F2");
  auto old = loops.estimate();
  old.revision -= 1;
  desk.answering = false;
  desk.session->on(old, desk.now_ns);
  EXPECT_FALSE(desk.send(desk.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION)));
  EXPECT_EQ(desk.session->state(), kRegistering);
  desk.session->on(loops.estimate(), desk.now_ns);
  EXPECT_EQ(loops.replies.back().result, bregma_wire_COMMAND_DONE) << loops.replies.back().text;
  EXPECT_EQ(desk.session->state(), kRegistered);
  EXPECT_EQ(desk.session->data().accepted->revision, loops.revision);
}

TEST_F(SessionTest, ALostTrackerDegradesAndResumesByItself) {
  desk.up_to(kNavigating, ball);
  desk.condition(alarm::kTrackerLost, "Tracker", true, SessionEffect::kDegrade);
  EXPECT_EQ(desk.session->state(), kDegraded);
  EXPECT_EQ(FakeLoops::last<SessionChanged>(loops.navigation).state, kDegraded);
  EXPECT_TRUE(FakeLoops::last<SessionChanged>(loops.navigation).verified) << "the registration is as good as it was";
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_RAISED);
  EXPECT_EQ(desk.ask(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L1").result, bregma_wire_COMMAND_REFUSED_BY_STATE);
  desk.condition(alarm::kTrackerLost, "Tracker", false, SessionEffect::kDegrade);
  EXPECT_EQ(desk.session->state(), kNavigating);
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_CLEARED);
  EXPECT_TRUE(FakeLoops::last<PlanSelected>(loops.navigation).on);
}

TEST_F(SessionTest, DriftDemotesAndAPersonHasToVerifyAgain) {
  desk.up_to(kNavigating, ball);
  desk.condition(alarm::kTrackerLost, "Tracker", true, SessionEffect::kDegrade);
  desk.condition(alarm::kDrift, "Reference", true, SessionEffect::kDemote, "the reference seems to have moved by 2 mm");
  desk.condition(alarm::kTrackerLost, "Tracker", false, SessionEffect::kDegrade);
  EXPECT_EQ(desk.session->state(), kRegistered) << "it must not resume as Navigating";
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops.navigation).verified);
  EXPECT_FALSE(FakeLoops::last<PlanSelected>(loops.navigation).on);
  desk.check_landmarks();
  const auto refused = desk.ask(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  EXPECT_STREQ(refused.text, "a drift alarm is not acknowledged: acknowledge it, then check the landmarks again");
  desk.done(bregma_wire_COMMAND_ACKNOWLEDGE_ALARM, alarm::kDrift, "Reference");
  EXPECT_EQ(FakeLoops::count<DriftRestart>(loops.monitoring), 1U);
  desk.condition(alarm::kDrift, "Reference", false, SessionEffect::kDemote);
  EXPECT_EQ(desk.session->state(), kRegistered) << "the end of the alarm verifies nothing";
  desk.done(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  EXPECT_EQ(desk.session->state(), kVerified);
  EXPECT_EQ(wire::view(loops.alarms.back().kind), "verification");
  EXPECT_EQ(loops.alarms.back().state, bregma_wire_ALARM_CLEARED);
}

TEST_F(SessionTest, AFaultIsLeftByClosingTheCase) {
  desk.up_to(kVerified, ball);
  desk.condition("loop_stopped", "navigation", true, SessionEffect::kFault, "no step for 2 s");
  EXPECT_EQ(desk.session->state(), kFault);
  EXPECT_FALSE(FakeLoops::last<SessionChanged>(loops.navigation).verified);
  EXPECT_STREQ(
      desk.ask(bregma_wire_COMMAND_START_NAVIGATION, "Stylus", "Plan").text,
      "cannot start the navigation while in Fault (loop_stopped navigation: no step for 2 s): close the case or "
      "restart the daemon");
  desk.done(bregma_wire_COMMAND_CLOSE_CASE);
  EXPECT_EQ(desk.session->state(), kIdle);
}

TEST_F(SessionTest, ACommandSentAgainIsAnsweredAgainAndNotCarriedOutAgain) {
  desk.up_to(kRegistering, ball);
  const auto command = desk.command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  desk.answering = false;
  EXPECT_FALSE(desk.send(command));
  EXPECT_FALSE(desk.send(command)) << "under way: one answer is enough";
  desk.answering = true;
  desk.run(100.0);
  const auto first = loops.replies.back();
  const std::size_t replies = loops.replies.size();
  const auto again = desk.send(command);
  ASSERT_TRUE(again);
  EXPECT_EQ(loops.replies.size(), replies + 1);
  EXPECT_STREQ(again->text, first.text);
  EXPECT_EQ(FakeLoops::count<CaptureRequest>(loops.navigation), 1U);
  EXPECT_EQ(FakeLoops::count<FiducialSample>(loops.registration), 1U);

  auto restarted = command; // a client that counts from one again sends at another time
  restarted.sent_time_ns += 1;
  EXPECT_TRUE(desk.send(restarted));
  EXPECT_EQ(FakeLoops::count<FiducialSample>(loops.registration), 2U);
}

TEST_F(SessionTest, APivotOnAWorkerKeepsTheSessionResponsive) {
  std::vector<std::function<void()>> jobs;
  Desk worker(folder.path() / "other", loops, [&jobs](std::function<void()> job) { jobs.push_back(std::move(job)); });
  worker.done(bregma_wire_COMMAND_LOAD_CASE, ball.string());
  worker.done(bregma_wire_COMMAND_START_PIVOT, "Probe");
  for (const PivotPose &pose : loops.pivot(FakeLoops::last<PivotRequest>(loops.navigation).id, 0.1, 0.6, 3)) {
    worker.session->on(NavigationEvent(pose), worker.now_ns);
  }
  const auto finish = worker.command(bregma_wire_COMMAND_FINISH_PIVOT, "Probe");
  EXPECT_FALSE(worker.send(finish));
  worker.done(bregma_wire_COMMAND_START_REGISTRATION); // gives the pivot up
  EXPECT_EQ(loops.replies[loops.replies.size() - 2].id, finish.id);
  EXPECT_STREQ(loops.replies[loops.replies.size() - 2].text, "given up: the registration was started anew");
  ASSERT_EQ(jobs.size(), 1U);
  jobs[0](); // finishes into the void
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
  desk.up_to(kVerified, ball);
  desk.pivot("Probe");
  EXPECT_EQ(desk.session->state(), kVerified) << "no check was made with the probe";
  desk.pivot("Stylus");
  EXPECT_EQ(desk.session->state(), kRegistered);
  EXPECT_NE(std::string(loops.replies.back().text).find("verify again"), std::string::npos)
      << loops.replies.back().text;
}

TEST_F(SessionTest, ATraceAfterTheAcceptanceChecksForDriftAndChangesNoSample) {
  desk.up_to(kVerified, ball);
  desk.done(bregma_wire_COMMAND_START_TRACE, "Stylus");
  desk.trace("Stylus", 7);
  const auto reply = desk.done(bregma_wire_COMMAND_STOP_TRACE, "Stylus");
  EXPECT_STREQ(reply.text, "7 surface samples traced, 20 in the registration");
  EXPECT_EQ(FakeLoops::count<SurfaceSample>(loops.monitoring), 7U);
  EXPECT_EQ(FakeLoops::count<SurfaceSample>(loops.registration), 20U);
  EXPECT_EQ(desk.session->data().revision, desk.session->data().accepted->revision);
}

TEST_F(SessionTest, TheTraceEndsWhenItIsFull) {
  desk.config.trace_max_samples = 30;
  desk.session = std::make_unique<Session>(desk.config, loops);
  desk.up_to(kRegistering, ball);
  desk.done(bregma_wire_COMMAND_START_TRACE, "Stylus");
  desk.trace("Probe", 5); // another tool's are not asked for
  desk.trace("Stylus", 40);
  EXPECT_EQ(desk.session->data().surface.size(), 30U);
  EXPECT_FALSE(FakeLoops::last<TraceRequest>(loops.navigation).on);
  EXPECT_STREQ(desk.ask(bregma_wire_COMMAND_START_TRACE, "Stylus").text,
               "there are 30 surface samples, the most that are kept");
}

} // namespace
} // namespace bregma::server::testing
