// Refusals of a session and their texts.
#include "session_fakes.hpp"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>

#include <gtest/gtest.h>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "idl/version.hpp"

namespace bregma::server::testing {
namespace {

const std::string kOwnWire = wire::text_of(wire::kWireVersion);

class RefusalTest : public ::testing::Test {
protected:
  void expect_refused(const std::string &text, wire::CommandKind kind, const std::string &first = "",
                      const std::string &second = "") {
    const auto before = harness.session->state();
    const auto reply = harness.ask(kind, first, second);
    EXPECT_EQ(reply.result, bregma_wire_COMMAND_REFUSED) << reply.text;
    EXPECT_EQ(std::string(reply.text), text);
    EXPECT_EQ(harness.session->state(), before);
    EXPECT_TRUE(std::isnan(reply.value_mm));
  }
  TemporaryFolder folder;
  std::filesystem::path ball = write_case(folder.path());
  FakeLoops loops;
  SessionHarness harness{folder.path(), loops};
};

TEST_F(RefusalTest, ACaseThatDoesNotExist) {
  const std::string missing = (folder.path() / "nowhere").string();
  expect_refused(missing + ": is not a folder; a case is a folder with case.toml", bregma_wire_COMMAND_LOAD_CASE,
                 missing);
  wire::Command nameless = harness.command(bregma_wire_COMMAND_LOAD_CASE, "somewhere");
  wire::set_text(nameless.body._u.folder.folder, "");
  EXPECT_STREQ(harness.send(nameless).value().text, "\"\" is no case folder");
  std::filesystem::remove(ball / "image.nii.gz");
  EXPECT_NE(std::string(harness.ask(bregma_wire_COMMAND_LOAD_CASE, ball.string()).text).find("image"),
            std::string::npos);
  EXPECT_EQ(harness.session->loaded_case(), nullptr);
}

TEST_F(RefusalTest, NamesThatTheCaseDoesNotContain) {
  harness.up_to(kRegistering, ball);
  expect_refused("fiducial \"Nasion\" is not in case ball; it has F1, F2, F3, F4, F5, F6",
                 bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "Nasion");
  expect_refused("tool \"Stilus\" is not in case ball; it has Reference, Stylus, Probe",
                 bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stilus", "F1");
  expect_refused("fiducial \"L1\" is not in case ball; it has F1, F2, F3, F4, F5, F6",
                 bregma_wire_COMMAND_REMOVE_FIDUCIAL, "L1");
  harness.up_to(kRegistered, ball);
  expect_refused("landmark \"F1\" is not in case ball; it has L1, L2, L3, L4, L5", bregma_wire_COMMAND_CHECK_TOUCH,
                 "Stylus", "F1");
  harness.up_to(kVerified, ball);
  expect_refused("trajectory \"plan\" is not in case ball; it has Plan", bregma_wire_COMMAND_START_NAVIGATION, "Stylus",
                 "plan");
}

TEST_F(RefusalTest, ToolsWithoutATip) {
  harness.up_to(kCaseLoaded, ball);
  expect_refused("Reference is the reference: it has no tip", bregma_wire_COMMAND_START_PIVOT, "Reference");
  harness.up_to(kRegistering, ball);
  expect_refused("Probe has no tip: calibrate it by a pivot first", bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Probe",
                 "F1");
  expect_refused("Probe has no tip: calibrate it by a pivot first", bregma_wire_COMMAND_START_TRACE, "Probe");
  harness.up_to(kVerified, ball);
  expect_refused("Probe has no tip: calibrate it by a pivot first", bregma_wire_COMMAND_START_NAVIGATION, "Probe",
                 "Plan");
}

TEST_F(RefusalTest, PivotsWithoutAUsableMeasurement) {
  harness.up_to(kCaseLoaded, ball);
  expect_refused("no pivot calibration of \"Stylus\" is running", bregma_wire_COMMAND_FINISH_PIVOT, "Stylus");
  harness.done(bregma_wire_COMMAND_START_PIVOT, "Stylus");
  expect_refused("a pivot calibration of Stylus is running: finish it first", bregma_wire_COMMAND_START_PIVOT, "Probe");
  expect_refused("no pivot calibration of \"Probe\" is running; one of Stylus is", bregma_wire_COMMAND_FINISH_PIVOT,
                 "Probe");
  const auto attempt = [&](double sigma, double angle) {
    harness.done(bregma_wire_COMMAND_START_PIVOT, "Stylus");
    for (const PivotPose &pose : loops.pivot(FakeLoops::last<PivotRequest>(loops.navigation).id, sigma, angle, 5)) {
      harness.session->on(NavigationEvent(pose), harness.now_ns);
    }
    const auto reply = harness.ask(bregma_wire_COMMAND_FINISH_PIVOT, "Stylus");
    EXPECT_EQ(reply.result, bregma_wire_COMMAND_REFUSED) << reply.text;
    EXPECT_EQ(std::string(reply.text).rfind("Stylus is not calibrated: ", 0), 0U) << reply.text;
    return std::string(reply.text);
  };
  const std::string still = attempt(0.05, 0.0);
  const std::string little = attempt(0.05, 0.1);
  const std::string noisy = attempt(4.0, 0.6);
  EXPECT_NE(still, little);
  EXPECT_NE(little, noisy);
  EXPECT_TRUE(harness.session->data().tips.empty());
  EXPECT_EQ(FakeLoops::count<ToolTip>(loops.navigation), 0U);
}

TEST_F(RefusalTest, TouchesThatFail) {
  harness.up_to(kRegistering, ball);
  const auto expect = [&](CaptureStatus status, const char *text) {
    loops.capture_status = status;
    expect_refused(text, bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  };
  expect(CaptureStatus::kMoved, "Stylus was not held still: its tip strayed 0.12 mm from its mean, limit 1.00 mm");
  expect(CaptureStatus::kToolHidden, "Stylus was hidden: 60 of 75 frames could be used");
  expect(CaptureStatus::kReferenceHidden, "the reference was hidden: 60 of 75 frames could be used");
  expect(CaptureStatus::kNoFrames, "no tracker frame came while Stylus was held");
  expect(CaptureStatus::kNotCalibrated, "Stylus has no tip: calibrate it by a pivot first");
  loops.capture_status = CaptureStatus::kOk;
  loops.miss_mm.x() = std::numeric_limits<double>::quiet_NaN();
  expect_refused("the position of Stylus is not finite", bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  EXPECT_TRUE(harness.session->data().fiducials.empty());
  expect_refused("F1 has not been touched", bregma_wire_COMMAND_REMOVE_FIDUCIAL, "F1");
}

TEST_F(RefusalTest, OneMeasurementAtATime) {
  harness.up_to(kRegistering, ball);
  harness.done(bregma_wire_COMMAND_START_TRACE, "Stylus");
  expect_refused("a trace with Stylus is running: stop it first", bregma_wire_COMMAND_START_TRACE, "Stylus");
  expect_refused("a trace with Stylus is running: stop it first", bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  expect_refused("no trace with \"Probe\" is running; one with Stylus is", bregma_wire_COMMAND_STOP_TRACE, "Probe");
  harness.done(bregma_wire_COMMAND_STOP_TRACE, "Stylus");
  expect_refused("no trace with \"Stylus\" is running", bregma_wire_COMMAND_STOP_TRACE, "Stylus");

  harness.answering = false;
  EXPECT_FALSE(harness.send(harness.command(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1")));
  expect_refused("another touch is being captured: F1", bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F2");
  expect_refused("a touch is being captured: wait for it", bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  harness.run(3000.0);
  EXPECT_STREQ(loops.replies.back().text, "the navigation loop has not answered");
  harness.answering = true;
  harness.run(100.0);
  EXPECT_TRUE(harness.session->data().fiducials.empty()) << "an answer after its command was given up";
}

TEST_F(RefusalTest, APivotUnderSamplesOfTheOldTip) {
  harness.up_to(kRegistering, ball);
  harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  expect_refused("samples of this registration were made with the present tip of Stylus: start the registration anew, "
                 "then calibrate",
                 bregma_wire_COMMAND_START_PIVOT, "Stylus");
  harness.pivot("Probe");
  harness.done(bregma_wire_COMMAND_START_REGISTRATION);
  harness.pivot("Stylus");
}

TEST_F(RefusalTest, RegistrationsThatMustNotBeAccepted) {
  harness.up_to(kRegistering, ball);
  expect_refused("there are no samples: touch the fiducials first", bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  loops.registration_status = bregma_wire_REGISTRATION_REFUSED;
  loops.registration_text = "1 fiducial is touched, 3 are needed";
  harness.run(100.0);
  expect_refused("1 fiducial is touched, 3 are needed", bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  loops.registration_status = bregma_wire_REGISTRATION_CANDIDATE;
  loops.registration_sigma_mm = 1.5;
  harness.run(100.0);
  expect_refused("the predicted TRE at Deep is 2.60 mm, more than the limit of 2.00 mm: touch more fiducials or trace "
                 "more surface",
                 bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  loops.registration_sigma_mm = std::numeric_limits<double>::quiet_NaN();
  harness.run(100.0);
  expect_refused("the estimate is not finite", bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  EXPECT_EQ(FakeLoops::count<RegistrationAccepted>(loops.navigation), 0U);

  loops.registration_sigma_mm = 0.2;
  harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F2");
  harness.answering = false;
  harness.trace("Stylus", 1); // not tracing: no sample
  loops.revision += 1;        // the loop permanently has another set
  EXPECT_TRUE(harness.send(harness.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION)))
      << "the estimate of the present set is known already";
}

TEST_F(RefusalTest, ALoopThatDoesNotAnswer) {
  harness.up_to(kRegistering, ball);
  harness.done(bregma_wire_COMMAND_CAPTURE_FIDUCIAL, "Stylus", "F1");
  harness.done(bregma_wire_COMMAND_START_TRACE, "Stylus");
  harness.answering = false;
  harness.trace("Stylus", 3);
  harness.done(bregma_wire_COMMAND_STOP_TRACE, "Stylus");
  EXPECT_FALSE(harness.send(harness.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION)));
  harness.run(2500.0);
  EXPECT_STREQ(loops.replies.back().text, "the registration loop has not answered: no estimate of the latest samples");
}

TEST_F(RefusalTest, VerificationsThatMustNotBeConfirmed) {
  harness.up_to(kRegistered, ball);
  harness.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L1");
  harness.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L3");
  harness.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L1"); // the same landmark counts once
  expect_refused(
      "2 of at least 3 landmarks checked since the registration was accepted or lost its verification; not checked: "
      "L2, L4, L5",
      bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  loops.miss_mm = {0.0, 3.5, 0.0};
  harness.done(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L2");
  const auto far = harness.ask(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  EXPECT_EQ(std::string(far.text).rfind("L2 is off by 3.50 mm (95 % bound ", 0), 0U) << far.text;
  EXPECT_NE(std::string(far.text).find("more than the limit of 3.00 mm: check it again, or register anew"),
            std::string::npos);
  // Each error is within the limit of 3 mm, but together they contradict the predicted error.
  loops.miss_mm = {0.0, 2.6, 0.0};
  harness.check_landmarks();
  const auto joint = harness.ask(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
  EXPECT_EQ(joint.result, bregma_wire_COMMAND_REFUSED);
  EXPECT_EQ(std::string(joint.text).rfind("the checks contradict the registration (probability ", 0), 0U) << joint.text;
  loops.miss_mm = {0.0, 0.4, 0.0};
  harness.check_landmarks();
  harness.done(bregma_wire_COMMAND_CONFIRM_VERIFICATION);
}

TEST_F(RefusalTest, AlarmsThatAreNotRaised) {
  harness.condition(alarm::kTrackerLost, "Tracker", true, SessionEffect::kDegrade);
  expect_refused("no alarm drift is raised; raised: tracker_lost of Tracker", bregma_wire_COMMAND_ACKNOWLEDGE_ALARM,
                 "drift");
}

TEST_F(RefusalTest, CommandsThatThisDaemonCannotCarryOut) {
  const auto expect = [&](const wire::Command &command, const std::string &text) {
    const auto reply = harness.send(command);
    ASSERT_TRUE(reply);
    EXPECT_EQ(reply->result, bregma_wire_COMMAND_UNSUPPORTED);
    EXPECT_EQ(reply->kind, command.kind);
    EXPECT_EQ(reply->text, text);
  };
  auto command = harness.command(bregma_wire_COMMAND_CLOSE_CASE);
  command.kind = 77; // a command of a later revision with another body
  command.body._d = 40;
  expect(command, "command kind 77 is not known: this daemon speaks wire " + kOwnWire);
  command.kind = bregma_wire_COMMAND_UNKNOWN;
  expect(command, "command kind 0 is not known: this daemon speaks wire " + kOwnWire);
  expect(harness.command(bregma_wire_COMMAND_ACQUIRE_SERIES, "Scanner", "T1"),
         "this daemon cannot acquire a series (ACQUIRE_SERIES): it has no part that does it");
}

TEST_F(RefusalTest, AScanNeedsACaseWithAnArm) {
  harness.up_to(kRegistering, ball);
  const auto reply = harness.send(harness.command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, "Robot"));
  ASSERT_TRUE(reply);
  EXPECT_STREQ(reply->text, "no scan with arm \"Robot\" is running");
  wire::Command start = harness.command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, "Robot");
  ASSERT_EQ(wire::fill_command(start, bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"}), "");
  const auto refused = harness.send(start);
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->result, bregma_wire_COMMAND_REFUSED);
  EXPECT_STREQ(refused->text, "case ball has no arm: [robot] in its case.toml names one");
  EXPECT_TRUE(loops.to_scan.empty());
}

TEST_F(RefusalTest, ACommandOfTheScannerIsAnsweredByItsStageOrByTheTimeOut) {
  const auto command = harness.command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, "Scanner");
  EXPECT_FALSE(harness.send(command));
  ASSERT_EQ(loops.to_scanner.size(), 1U);
  EXPECT_STREQ(loops.to_scanner[0].body._u.device.device, "Scanner");
  StageAnswer answer{};
  (void)wire::set_name(answer.client, wire::view(command.client));
  answer.id = command.id;
  answer.sent_time_ns = command.sent_time_ns;
  answer.kind = command.kind;
  answer.result = bregma_wire_COMMAND_DONE;
  wire::set_text(answer.text, "the phantom is scanned");
  harness.session->on(answer, harness.now_ns);
  ASSERT_FALSE(loops.replies.empty());
  EXPECT_EQ(loops.replies.back().id, command.id);
  EXPECT_EQ(loops.replies.back().result, bregma_wire_COMMAND_DONE);
  EXPECT_STREQ(loops.replies.back().text, "the phantom is scanned");

  const auto silent = harness.command(bregma_wire_COMMAND_CONFIRM_SCANNER_STEP, "Scanner", "swap");
  EXPECT_FALSE(harness.send(silent));
  harness.run(3000.0);
  EXPECT_EQ(loops.replies.back().id, silent.id);
  EXPECT_EQ(loops.replies.back().result, bregma_wire_COMMAND_REFUSED);
  EXPECT_STREQ(loops.replies.back().text,
               "cannot confirm a step of the scanner's registration: the stage that does it has not answered");
}

TEST_F(RefusalTest, ACommandThatADeviceHasAnsweredIsNotAnsweredAgain) {
  const auto command = harness.command(bregma_wire_COMMAND_STOP_ROBOT, "Robot");
  EXPECT_FALSE(harness.send(command)); // in every state, without a case
  ASSERT_EQ(loops.to_arm.size(), 1U);
  EXPECT_STREQ(loops.to_arm[0].body._u.device.device, "Robot");
  EXPECT_EQ(wire::view(loops.to_arm[0].client), wire::view(command.client));
  StageAnswer answer{};
  (void)wire::set_name(answer.client, wire::view(command.client));
  answer.id = command.id;
  answer.sent_time_ns = command.sent_time_ns;
  answer.kind = command.kind;
  answer.result = bregma_wire_COMMAND_DONE;
  wire::set_text(answer.text, "the stop is latched");
  answer.by_device = true;
  const std::size_t before = loops.replies.size();
  harness.session->on(answer, harness.now_ns);
  EXPECT_EQ(loops.replies.size(), before) << "the driver has published it";
  const auto again = harness.send(command); // sent again: not carried out again
  ASSERT_TRUE(again);
  EXPECT_STREQ(again->text, "the stop is latched");
  EXPECT_EQ(loops.to_arm.size(), 1U);

  wire::Command move = harness.command(bregma_wire_COMMAND_STOP_ROBOT, "Robot");
  ASSERT_EQ(wire::fill_command(move, bregma_wire_COMMAND_MOVE_TO_TRAJECTORY, {"Robot", "Biopsy", "50", "20"}), "");
  const auto refused = harness.send(move);
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->result, bregma_wire_COMMAND_REFUSED_BY_STATE);
  EXPECT_EQ(loops.to_arm.size(), 1U);
}

TEST_F(RefusalTest, ACommandToAnotherReceiverIsLeftToIt) {
  auto command = harness.command(bregma_wire_COMMAND_CLOSE_CASE);
  ASSERT_TRUE(wire::set_name(command.receiver, "Coils"));
  EXPECT_FALSE(harness.send(command));
  ASSERT_TRUE(wire::set_name(command.receiver, "bregmad"));
  EXPECT_TRUE(harness.send(command));
}

TEST_F(RefusalTest, MalformedCommands) {
  const auto expect = [&](const wire::Command &command, const char *text) {
    const auto reply = harness.send(command);
    ASSERT_TRUE(reply);
    EXPECT_EQ(reply->result, bregma_wire_COMMAND_MALFORMED);
    EXPECT_EQ(reply->kind, command.kind);
    EXPECT_STREQ(reply->text, text);
  };
  auto command = harness.command(bregma_wire_COMMAND_CLOSE_CASE);
  command.body._d = bregma_wire_FORM_TOOL;
  expect(command, "CLOSE_CASE has a body of form 3, not 1");
  command = harness.command(bregma_wire_COMMAND_CHECK_TOUCH, "Stylus", "L1");
  std::memset(command.body._u.touch.point, 'x', sizeof(wire::Name));
  expect(command, "point is too long for a name");
  command = harness.command(bregma_wire_COMMAND_START_PIVOT, "Stylus");
  std::memset(command.body._u.tool.tool, 'x', sizeof(wire::Name));
  expect(command, "tool is too long for a name");
  command = harness.command(bregma_wire_COMMAND_CLOSE_CASE);
  command.client[0] = '\0';
  EXPECT_FALSE(harness.send(command));
  EXPECT_EQ(loops.lines.back(), "a command without a client's name was dropped: there is no client to answer");
}

} // namespace
} // namespace bregma::server::testing
