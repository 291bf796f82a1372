// A case without a tracker, end to end at the level of the wire: the arm carries the range sensor over the face, the
// daemon registers its base to the image without a start estimate, check touches with the arm's tip verify, and the tip
// is navigated. Then what goes wrong with arm and sensor.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "idl/validity.hpp"
#include "server/session/messages.hpp"
#include "tests/component/robot/robot_test.hpp"

namespace bregma::test {
namespace {

using geometry::Vector3d;

class RobotScan : public RobotTest {};

TEST_F(RobotScan, RegistersByTheScanAloneAndNavigates) {
  ASSERT_NO_FATAL_FAILURE(begin());
  ASSERT_NO_FATAL_FAILURE(scan());
  ASSERT_GT(room.registration.surface_count, 150U) << room.registration.text;
  EXPECT_GE(room.points.size(), room.registration.surface_count);
  // The published points lie on the face.
  double sum = 0.0;
  const sim::Head head(the_case.loaded().scalp.mesh, 0.0, 15.0, 1);
  for (const Vector3d &point : room.points) {
    const double distance = head.clearance_mm(room.T_base_image().inverse() * point);
    sum += distance * distance;
  }
  const double rms_mm = std::sqrt(sum / static_cast<double>(room.points.size()));
  EXPECT_LT(rms_mm, 2.0);
  EXPECT_NE(std::string(room.registration.text).find("times 1 - cos(tilt): removed"), std::string::npos)
      << room.registration.text;
  EXPECT_EQ(
      std::string(room.command(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Spare", "0", "3"}).text),
      "the registration has points of Range, and its scans are made with one sensor: start the registration anew");
  const wire::CommandReply accepted = room.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  ASSERT_EQ(accepted.result, bregma_wire_COMMAND_DONE) << accepted.text;
  EXPECT_NE(std::string(accepted.text).find("predicted TRE"), std::string::npos) << accepted.text;
  verify();
  room.run(0.2);
  const double predicted_mm = room.accuracy.targets[0].tre_rms_mm;
  const double bound_mm = room.accuracy.targets[0].tre_95.semi_axes_mm[0];
  std::printf(
      "scan: %u points, RMS from the skin %.2f mm, error at the target %.2f mm, predicted RMS %.2f mm, 95 %% %.2f mm\n",
      room.registration.surface_count, rms_mm, target_error_mm(), predicted_mm, bound_mm);
  EXPECT_LT(target_error_mm(), 2.0);
  EXPECT_LT(target_error_mm(), 1.5 * bound_mm);

  expect_done(room.command(bregma_wire_COMMAND_START_NAVIGATION, {"Pointer", "Biopsy"}));
  ASSERT_TRUE(room.run(1.0, [&] { return live(); }));
  const wire::NavigationState state = room.states.back();
  EXPECT_EQ(state.source_kind, bregma_wire_DEVICE_ROBOT);
  EXPECT_EQ(state.patient, bregma_wire_PATIENT_NOT_TRACKED);
  EXPECT_EQ(wire::view(state.source), "Robot");
  EXPECT_TRUE(std::isfinite(state.tre_rms_mm) && std::isfinite(state.covariance[35]));
  EXPECT_LT((Vector3d::Map(state.T_image_tip.translation_mm) - room.tip_in_image()).norm(), 2.0);
}

TEST_F(RobotScan, TheArmRegistersByTouchesAsAStylusDoes) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  EXPECT_EQ(room.registration.fiducial_count, the_case.loaded().fiducials.size());
  EXPECT_LT(target_error_mm(), 1.0);
  // The error of the tool's axis (0.2 degrees) turns it about its tip, and does not displace the tip.
  const Vector3d tip = Vector3d::Map(room.states.back().T_image_tip.translation_mm);
  geometry::Matrix6d about_tip = geometry::Matrix6d::Identity();
  about_tip.bottomLeftCorner<3, 3>() = -geometry::skew(tip);
  const geometry::Matrix6d covariance =
      about_tip * Eigen::Matrix<double, 6, 6, Eigen::RowMajor>::Map(room.states.back().covariance) *
      about_tip.transpose();
  const double axis_rad2 = 3.0 * std::pow(0.2 * M_PI / 180.0, 2);
  const double turn_rad2 = covariance.topLeftCorner<3, 3>().trace();
  const double registration_rad2 =
      Eigen::Matrix<double, 6, 6, Eigen::RowMajor>::Map(room.registration.accepted_covariance)
          .topLeftCorner<3, 3>()
          .trace();
  EXPECT_NEAR(turn_rad2 - registration_rad2, axis_rad2, 0.2 * axis_rad2); // the flange's own error is much smaller
  EXPECT_LT(std::sqrt(covariance.bottomRightCorner<3, 3>().trace()), 1.0);
  std::printf("touches: error at the target %.2f mm, FRE %.2f mm, predicted RMS %.2f mm\n", target_error_mm(),
              room.registration.fre_mm, room.accuracy.targets[0].tre_rms_mm);
}

TEST_F(RobotScan, AnArmThatStopsSendingInAMotionIsNotShown) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  room.start_move({room.touching(the_case.loaded().fiducials[0].position_mm, 30.0)}, 50.0);
  ASSERT_FALSE(room.run(0.5));
  ASSERT_TRUE(live());
  room.deliver_arm = false;
  ASSERT_NO_FATAL_FAILURE(expect_not_live());
  EXPECT_TRUE(room.alarm_raised(server::alarm::kRobotLost, "Robot"));
  EXPECT_EQ(room.session().state(), bregma_wire_SESSION_DEGRADED);
  const auto lost = room.device("Robot")->lost;
  room.deliver_arm = true;
  ASSERT_TRUE(room.run(2.0, [&] { return live(); })) << "the same arm is trusted again";
  room.run(1.5); // the alarm ends a second after its cause
  EXPECT_NEAR(static_cast<double>(room.device("Robot")->lost - lost), 125.0, 3.0) << "every loss is counted";
  EXPECT_EQ(room.session().state(), bregma_wire_SESSION_NAVIGATING);
}

TEST_F(RobotScan, AnArmThatJumpsIsRefused) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  room.tamper = [](wire::RobotState &state) { state.T_base_flange.translation_mm[0] += 30.0; };
  ASSERT_NO_FATAL_FAILURE(expect_not_live());
  EXPECT_TRUE(room.alarm_raised(server::alarm::kImplausible, "Pointer"));
  EXPECT_EQ(room.states.back().status, bregma_wire_POSE_IMPLAUSIBLE);
}

TEST_F(RobotScan, AnArmThatFreezesWithNumbersGoingOnIsRefused) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  room.start_move({room.touching(the_case.loaded().fiducials[0].position_mm, 30.0)}, 50.0);
  ASSERT_FALSE(room.run(0.5));
  room.tamper = room.frozen_values();
  ASSERT_NO_FATAL_FAILURE(expect_not_live());
  EXPECT_TRUE(room.alarm_raised(server::alarm::kImplausible, "Pointer"));
}

TEST_F(RobotScan, AnotherToolOrAnotherArmNeedsACheckTouch) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  room.tamper = [](wire::RobotState &state) { (void)wire::set_name(state.tool, "Drill"); };
  ASSERT_NO_FATAL_FAILURE(expect_not_live());
  EXPECT_EQ(room.states.back().status, bregma_wire_POSE_TOOL_HIDDEN);
  EXPECT_TRUE(room.alarm_raised(server::alarm::kImplausible, "RobotBase"));
  room.tamper = [](wire::RobotState &) {};
  room.run(0.5);
  EXPECT_EQ(room.states.back().status, bregma_wire_POSE_IMPLAUSIBLE) << "mounted again: nobody has checked it";
  expect_done(touch(bregma_wire_COMMAND_CHECK_TOUCH, the_case.loaded().landmarks[0]));
  ASSERT_TRUE(room.run(0.5, [&] { return live(); }));

  room.deliver_arm = false;
  room.run(1.0);
  room.deliver_arm = true;
  room.arm_writer = MemoryTopics::kWriter + 1;
  room.states.clear();
  room.run(1.0);
  EXPECT_EQ(room.states.back().status, bregma_wire_POSE_IMPLAUSIBLE) << "another driver: it may be another arm";
  EXPECT_TRUE(std::none_of(room.states.begin(), room.states.end(), shown));
  expect_done(touch(bregma_wire_COMMAND_CHECK_TOUCH, the_case.loaded().landmarks[0]));
  ASSERT_TRUE(room.run(0.5, [&] { return live(); }));
}

TEST_F(RobotScan, CheckTouchesExpireBecauseThePatientIsNotTracked) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  room.run(60.0 * RobotRoom::kCheckValid_min + 10.0,
           [&] { return room.alarm_raised(server::alarm::kCheckExpired, "RobotBase"); });
  EXPECT_TRUE(room.alarm_raised(server::alarm::kCheckExpired, "RobotBase"));
  EXPECT_EQ(room.session().state(), bregma_wire_SESSION_REGISTERED);
  room.run(0.1);
  EXPECT_EQ(room.states.back().status, bregma_wire_POSE_UNVERIFIED);
  verify();
  EXPECT_FALSE(room.alarm_active(server::alarm::kCheckExpired));
  EXPECT_EQ(room.session().state(), bregma_wire_SESSION_VERIFIED);
}

TEST_F(RobotScan, ASensorThatIsUnpluggedOrSwappedGivesNoPoints) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const auto path = room.raster(40.0, 50.0, 8.0);
  ASSERT_TRUE(room.move({path.front()}, 80.0));
  expect_done(room.command(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"}));
  room.start_move(path, 20.0);
  ASSERT_TRUE(room.run(10.0, [&] { return room.points.size() > 20; }));
  const auto lost = room.device("Range")->lost;
  room.unplug_sensor();
  room.run(0.3);
  const std::size_t before = room.points.size();
  room.run(2.0);
  EXPECT_EQ(room.points.size(), before);
  EXPECT_TRUE(room.alarm_raised(server::alarm::kDeviceLost, "Range"));
  EXPECT_TRUE(room.alarm_raised(server::alarm::kScanStalled, "Range"));

  room.plug_sensor("B7"); // another one
  room.run(3.0);
  EXPECT_EQ(room.points.size(), before);
  EXPECT_NE(room.range_error.find("B7"), std::string::npos) << room.range_error;

  room.plug_sensor("A4"); // the right one, which counts anew
  room.run(3.0);
  EXPECT_EQ(room.points.size(), before) << "a person has not said that it is the same";
  EXPECT_TRUE(room.alarm_raised(server::alarm::kScanInterrupted, "Range"));
  EXPECT_GE(room.device("Range")->connections, 2U);
  EXPECT_GE(room.device("Range")->lost, lost);
  expect_done(room.command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {"Robot"}));
  expect_done(room.command(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"}));
  ASSERT_TRUE(room.run(10.0, [&] { return room.points.size() > before + 5; }));
  EXPECT_FALSE(room.alarm_active(server::alarm::kScanInterrupted));
}

TEST_F(RobotScan, CommandsThatDoNotFitAreRefusedWithTheReason) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const auto text = [&](std::initializer_list<std::string_view> values) {
    return std::string(room.command(bregma_wire_COMMAND_START_SURFACE_SCAN, values).text);
  };
  EXPECT_NE(text({"Arm2", "Range", "0", "3"}).find("is not that of case robot, Robot"), std::string::npos);
  EXPECT_NE(text({"Robot", "Laser", "0", "3"}).find("it has Range"), std::string::npos);
  expect_done(room.command(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"}));
  EXPECT_NE(text({"Robot", "Range", "0", "3"}).find("stop it first"), std::string::npos);
  EXPECT_EQ(std::string(room.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION).text),
            "a trace with Range is running: stop it first");
  expect_done(room.command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {"Robot"}));
  EXPECT_EQ(std::string(room.command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {"Robot"}).text),
            "no scan with arm \"Robot\" is running");
}

} // namespace
} // namespace bregma::test
