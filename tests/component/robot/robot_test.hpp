// A case without a tracker with its operator: registration by scan or touches, check touches, navigation.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "idl/validity.hpp"
#include "server/session/messages.hpp"
#include "tests/component/robot/robot_operator.hpp"
#include "tests/component/robot/robot_room.hpp"

namespace bregma::test {

inline constexpr std::uint64_t kSeed = 5;
inline constexpr std::int64_t kLimit_ns =
    100'000'000; // of a live pose, as no arm's period is longer than a third of it

// For RobotRoom::move_patient.
inline geometry::Vector6d displacement(const geometry::Vector3d &turn_rad, const geometry::Vector3d &way_mm) {
  geometry::Vector6d out;
  out << turn_rad, way_mm;
  return out;
}

inline void expect_done(const wire::CommandReply &reply) {
  EXPECT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
}

class RobotTest : public testing::Test {
protected:
  explicit RobotTest(bool beside_tracker = false, bool flange_body = true)
      : the_case(kSeed, beside_tracker, flange_body) {}
  void begin() { person.begin(); }
  void scan(double spacing_mm = 8.0, double speed_mm_s = 50.0) { person.scan(spacing_mm, speed_mm_s); }
  wire::CommandReply touch(wire::CommandKind kind, const casefile::NamedPoint &point) {
    return person.touch(kind, point);
  }
  void touch_fiducials() { person.touch_fiducials(); }
  void verify() { person.verify(); }
  void navigate() { person.navigate(); }
  [[nodiscard]] bool live() const { return person.live(); }
  // Lets the fault act for this time; no pose is shown later than the limit after its begin, and its age never is
  // above.
  void expect_not_live(double seconds = 1.0) {
    const std::int64_t begin_ns = room.now();
    room.states.clear();
    room.run(seconds);
    for (const wire::NavigationState &state : room.states) {
      if (shown(state)) {
        ASSERT_LE(state.published_time_ns - begin_ns, kLimit_ns) << "shown too late";
        ASSERT_LE(state.valid_for_ns + state.age_ns, kLimit_ns);
      } else {
        ASSERT_TRUE(std::isnan(state.T_image_tip.translation_mm[0]) && std::isnan(state.covariance[0]));
        ASSERT_EQ(state.valid_for_ns, 0);
      }
    }
    ASSERT_FALSE(room.states.empty());
    ASSERT_FALSE(shown(room.states.back()));
  }
  [[nodiscard]] double target_error_mm() const {
    const auto T = wire::from_wire<geometry::frame::Image, geometry::frame::Reference>(
        room.registration.accepted_T_image_reference);
    const geometry::Vector3d target = the_case.loaded().targets.front().position_mm;
    const bool tracked = the_case.loaded().hand_eye() != nullptr;
    const geometry::Vector3d in_reference =
        tracked ? room.T_image_reference().inverse() * target : room.T_base_image() * target;
    return (T * in_reference - target).norm();
  }

  RobotCase the_case;
  RobotRoom room{the_case, kSeed};
  RobotOperator person{the_case, room};
};

// The guide is moved onto a trajectory.
class GuideTest : public RobotTest {
protected:
  using RobotTest::RobotTest;
  void navigate() {
    RobotTest::navigate();
    room.run(0.5); // the stages learn of it a few times per second
  }
  std::string text_of_refusal(const wire::CommandReply &reply) {
    EXPECT_NE(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
    EXPECT_EQ(room.replies_to(reply.id), 1U);
    return reply.text;
  }
  // Holds the deadman for this time, or until the motion has ended.
  void hold(double seconds) {
    room.hold_deadman();
    room.run(0.3); // the state of the motion before says nothing
    room.run(seconds, [&] {
      least_clearance_mm = std::min(least_clearance_mm, room.tool_clearance_mm());
      return room.phase() != bregma_wire_MOTION_WAITS && room.phase() != bregma_wire_MOTION_UNDER_WAY;
    });
  }
  double least_clearance_mm = std::numeric_limits<double>::infinity();
};

} // namespace bregma::test
