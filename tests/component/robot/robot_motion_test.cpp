// The guide is moved onto a planned trajectory by a command to the daemon: at the level of the wire, with the arm's
// driver and the simulated arm, under the operator's deadman.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "tests/component/robot/robot_test.hpp"

namespace bregma::test {
namespace {

using geometry::Vector3d;

constexpr double kStandoff_mm = 40.0;

class RobotMotion : public GuideTest {
protected:
  wire::CommandReply move_guide(std::string_view trajectory = "Frontal", std::string_view standoff_mm = "40",
                                std::string_view speed_mm_s = "60", std::string_view device = "Robot") {
    return room.command(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY, {device, trajectory, standoff_mm, speed_mm_s});
  }
};

TEST_F(RobotMotion, TheGuideIsMovedOntoATrajectoryWhileTheDeadmanIsHeld) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  const Vector3d before = room.flange().translation();
  const wire::CommandReply reply = move_guide();
  ASSERT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
  EXPECT_EQ(std::string(reply.text), "the arm has the path; it moves while the deadman is held");
  room.run(0.3);
  EXPECT_LT((room.flange().translation() - before).norm(), 0.01) << "without a deadman nothing moves";
  hold(60.0);
  ASSERT_EQ(room.phase(), bregma_wire_MOTION_DONE) << room.motions.back().text;
  room.run(0.3);
  EXPECT_EQ(room.replies_to(reply.id), 1U);
  // Where the guide really is, against the plan.
  const casefile::Trajectory &plan = *the_case.loaded().trajectory("Frontal");
  const Vector3d direction = (plan.target_mm - plan.entry_mm).normalized();
  const double error_mm = (room.tip_in_image() - (plan.entry_mm - kStandoff_mm * direction)).norm();
  const double angle_deg = std::acos(std::min(1.0, room.axis_in_image().dot(direction))) * 180.0 / M_PI;
  std::printf("guide: %.2f mm and %.2f degrees from the plan, tool at least %.1f mm from the skin\n", error_mm,
              angle_deg, least_clearance_mm);
  EXPECT_LT(error_mm, 1.5);
  EXPECT_LT(angle_deg, 0.5);
  EXPECT_GT(least_clearance_mm, 10.0);
  EXPECT_FALSE(room.alarm_active(server::alarm::kGuideOffPlan));
  // Ended: the deadman alone moves nothing any more.
  const Vector3d there = room.flange().translation();
  room.run(0.5);
  EXPECT_LT((room.flange().translation() - there).norm(), 0.01);
}

TEST_F(RobotMotion, ReleasingTheDeadmanStopsAndTheStopIsResetByTheDaemon) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  expect_done(move_guide("Frontal", "40", "20"));
  hold(1.0);
  ASSERT_EQ(room.phase(), bregma_wire_MOTION_UNDER_WAY);
  room.release_deadman();
  room.run(0.5);
  EXPECT_EQ(room.phase(), bregma_wire_MOTION_STOPPED);
  EXPECT_EQ(room.motions.back().cause, bregma_wire_STOP_DEADMAN_LOST);
  const Vector3d there = room.flange().translation();
  EXPECT_EQ(text_of_refusal(move_guide("Frontal", "40", "20")), "a stop is latched: reset it first");
  room.hold_deadman();
  room.run(0.5);
  EXPECT_LT((room.flange().translation() - there).norm(), 0.01);
  room.release_deadman();
  expect_done(room.command(bregma_wire_COMMAND_RESET_ROBOT, {"Robot"}));
  expect_done(move_guide("Frontal", "40", "20"));
  hold(1.0);
  ASSERT_EQ(room.phase(), bregma_wire_MOTION_UNDER_WAY);
  expect_done(room.command(bregma_wire_COMMAND_HOLD_ROBOT, {"Robot"}));
  room.run(0.5);
  EXPECT_EQ(room.phase(), bregma_wire_MOTION_HELD);
  room.release_deadman();
  expect_done(move_guide("Frontal", "40", "20"));
  hold(1.0);
  expect_done(room.command(bregma_wire_COMMAND_STOP_ROBOT, {"Robot"}));
  room.run(0.3);
  EXPECT_EQ(room.motions.back().cause, bregma_wire_STOP_COMMAND);
  EXPECT_EQ(room.replies_to(room.last_id()), 1U);
}

TEST_F(RobotMotion, IsRefusedWithTheReasonWhereItIsNotSafe) {
  ASSERT_NO_FATAL_FAILURE(begin());
  EXPECT_NE(text_of_refusal(move_guide()).find("accept a registration first"), std::string::npos);
  touch_fiducials();
  expect_done(room.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION));
  EXPECT_NE(text_of_refusal(move_guide()).find("verify the registration first"), std::string::npos);
  verify();
  room.run(0.5);
  EXPECT_NE(text_of_refusal(move_guide("Nowhere")).find("it has Biopsy"), std::string::npos);
  EXPECT_NE(text_of_refusal(move_guide("Frontal", "40", "60", "Arm2")).find("is not that of case robot"),
            std::string::npos);
  EXPECT_NE(text_of_refusal(move_guide("Frontal", "600")).find("must be 0 to 500"), std::string::npos);
  const std::string into = text_of_refusal(move_guide("Frontal", "2"));
  EXPECT_NE(into.find("no clear path to Frontal was found"), std::string::npos) << into;
  EXPECT_NE(text_of_refusal(move_guide("Frontal", "40", "5000")).find("speed_mm_s"), std::string::npos)
      << "by the driver";
  // An arm whose joints do not belong to its flange.
  room.tamper = [](wire::RobotState &state) { state.joint_position_rad[1] += 0.02; };
  room.run(0.1);
  EXPECT_NE(text_of_refusal(move_guide()).find("is not the arm that measures"), std::string::npos);
  // Another tool, a silent arm, a driver that does not answer.
  room.tamper = [](wire::RobotState &state) { (void)wire::set_name(state.tool, "Drill"); };
  room.run(0.5);
  EXPECT_NE(text_of_refusal(move_guide()).find("Drill is not live"), std::string::npos);
  room.tamper = [](wire::RobotState &) {};
  room.run(0.5);
  EXPECT_NE(text_of_refusal(move_guide()).find("Pointer is not live"), std::string::npos) << "nobody has checked it";
  expect_done(touch(bregma_wire_COMMAND_CHECK_TOUCH, the_case.loaded().landmarks[0]));
  room.run(0.5);
  room.deliver_commands = false;
  (void)move_guide();
  room.run(1.0);
  EXPECT_EQ(room.replies_to(room.last_id()), 1U);
  EXPECT_NE(room.last_reply().find("driver has not answered"), std::string::npos) << room.last_reply();
  room.deliver_commands = true;
  room.deliver_arm = false;
  room.run(0.3);
  EXPECT_NE(text_of_refusal(move_guide()).find("too old"), std::string::npos);
  room.run(1.5);
  EXPECT_NE(text_of_refusal(move_guide()).find("Degraded"), std::string::npos);
  const Vector3d there = room.flange().translation();
  room.hold_deadman();
  room.run(0.5);
  EXPECT_LT((room.flange().translation() - there).norm(), 0.01);
}

} // namespace
} // namespace bregma::test
