// The driver's conditions of motion: what ends a motion, and what refuses it.
#include "tests/hil/arm/arm_world.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace bregma::arm {
namespace {

TEST_F(Motion, RunsToItsEndWhileTheDeadmanIsHeld) {
  const auto start = world.arm.stated_flange();
  const auto goal = beside(start, 0, 30, 60);
  const auto reply = world.move({beside(start, 0, 0, 60), goal});
  ASSERT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
  world.run_to_rest();
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_DONE);
  EXPECT_LT((world.flange() - goal.translation()).norm(), 1e-3);
  EXPECT_LT(world.most_mm_s, kSpeed_mm_s * 1.01);
  const auto state = world.control.state(world.now);
  EXPECT_EQ(state.waypoint, 2U);
  EXPECT_EQ(state.waypoint_count, 2U);
  EXPECT_EQ(wire::view(state.motion_client), "console");
  EXPECT_TRUE(state.simulated);
  EXPECT_EQ(world.control.motion_client(), "") << "no motion is under way";
  expect_sound();
}

TEST_F(Motion, DoesNotBeginWithoutADeadman) {
  const auto start = world.arm.stated_flange();
  ASSERT_EQ(world.move({beside(start, 0, 0, 60)}).result, bregma_wire_COMMAND_DONE);
  world.held_motion = 0;
  world.run(3'000 * kMs);
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_HELD);
  EXPECT_STREQ(world.control.state(world.now).text, "no deadman for this motion has been received");
  EXPECT_LT((world.flange() - start.translation()).norm(), 1e-6);
}

TEST_F(Motion, AnotherClientsDeadmanPermitsNothing) {
  const auto start = world.arm.stated_flange();
  ASSERT_EQ(world.move({beside(start, 0, 0, 60)}).result, bregma_wire_COMMAND_DONE);
  const std::uint64_t motion = std::exchange(world.held_motion, 0);
  for (int i = 0; i < 20; ++i) {
    world.send_deadman(motion, "stranger", true);
    world.send_deadman(motion + 1, world.client, true);
    world.run(50 * kMs);
  }
  EXPECT_LT((world.flange() - start.translation()).norm(), 1e-6);
  EXPECT_EQ(world.control.refused(), 40U);
}

TEST_F(Motion, ADeadmanThatRepeatsItsNumberRunsOut) {
  expect_stop(bregma_wire_STOP_DEADMAN_LOST, [&] {
    const std::uint64_t motion = std::exchange(world.held_motion, 0);
    for (int i = 0; i < 8; ++i) {
      --world.deadman_frame;
      world.send_deadman(motion, world.client, true);
      world.run(40 * kMs);
    }
  });
}

TEST_F(Motion, EndsWithin150msOfTheLastDeadman) {
  expect_stop(bregma_wire_STOP_DEADMAN_LOST, [&] {
    world.held_motion = 0;
    const std::int64_t last_ns = world.next_deadman - 50 * kMs;
    while (world.control.phase() == bregma_wire_MOTION_UNDER_WAY) {
      world.tick();
    }
    EXPECT_LE(world.now - last_ns, 150 * kMs + 2 * sim::SimulatedArm::kTick_ns);
  });
}

TEST_F(Motion, EndsWhenTheDeadmanIsReleased) {
  expect_stop(bregma_wire_STOP_DEADMAN_RELEASED,
              [&] { world.send_deadman(std::exchange(world.held_motion, 0), world.client, false); });
}

TEST_F(Motion, EndsByTheStopOfAnyClient) {
  expect_stop(bregma_wire_STOP_COMMAND, [&] {
    world.client = "nurse";
    EXPECT_EQ(world.command(bregma_wire_COMMAND_STOP_ROBOT).result, bregma_wire_COMMAND_DONE);
    world.client = "console";
  });
}

TEST_F(Motion, EndsWithTheDaemon) {
  expect_stop(bregma_wire_STOP_DAEMON_SILENT, [&] { world.daemon_speaks = false; });
}

TEST_F(Motion, EndsWhenAnotherDaemonSpeaks) {
  expect_stop(bregma_wire_STOP_DAEMON_REPLACED, [&] {
    world.run_id = kRun + 1;
    world.send_daemon();
  });
}

TEST_F(Motion, ToATrajectoryEndsWithTheVerification) {
  expect_stop(
      bregma_wire_STOP_NOT_VERIFIED,
      [&] {
        world.session = bregma_wire_SESSION_DEGRADED;
        world.send_daemon();
      },
      true);
}

TEST_F(Motion, ToATrajectoryEndsWithItsRegistration) {
  expect_stop(
      bregma_wire_STOP_REGISTRATION_REPLACED,
      [&] {
        world.revision = 6;
        world.send_daemon();
      },
      true);
}

TEST_F(Motion, BesideATrackerBeginsOnlyWithThePermit) {
  const auto start = world.arm.stated_flange();
  world.needs_permit = true;
  ASSERT_EQ(world.move({beside(start, 0, 0, 60)}, true).result, bregma_wire_COMMAND_DONE);
  world.permit_run = kRun + 1; // of another daemon
  world.permits = true;
  world.run(3'000 * kMs);
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_HELD);
  EXPECT_STREQ(world.control.state(world.now).text, "no permit of the daemon for this motion has been received");
  EXPECT_LT((world.flange() - start.translation()).norm(), 1e-6);
  EXPECT_GT(world.control.refused(), 50U);
  EXPECT_TRUE(world.control.state(world.now).takes_permits);
}

TEST_F(Motion, BesideATrackerRunsToItsEndWithDeadmanAndPermit) {
  const auto goal = beside(world.arm.stated_flange(), 0, 0, 60);
  world.needs_permit = world.permits = true;
  ASSERT_EQ(world.move({goal}, true).result, bregma_wire_COMMAND_DONE);
  world.run_to_rest();
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_DONE);
  EXPECT_LT((world.flange() - goal.translation()).norm(), 1e-3);
}

TEST_F(Motion, EndsWithin150msOfTheLastPermit) {
  world.needs_permit = world.permits = true;
  expect_stop(
      bregma_wire_STOP_PERMIT_LOST,
      [&] {
        world.permits = false;
        const std::int64_t last_ns = world.next_permit - 20 * kMs;
        while (world.control.phase() == bregma_wire_MOTION_UNDER_WAY) {
          world.tick();
        }
        EXPECT_LE(world.now - last_ns, 150 * kMs + 2 * sim::SimulatedArm::kTick_ns);
        world.send_permit(true); // does not revive it
      },
      true);
}

TEST_F(Motion, APermitThatRepeatsItsNumberRunsOut) {
  world.needs_permit = world.permits = true;
  expect_stop(
      bregma_wire_STOP_PERMIT_LOST,
      [&] {
        world.permits = false;
        for (int i = 0; i < 8; ++i) {
          --world.permit_frame;
          world.send_permit(true);
          world.run(40 * kMs);
        }
      },
      true);
}

TEST_F(Motion, EndsWithTheReasonWhenThePermitIsWithdrawn) {
  world.needs_permit = world.permits = true;
  expect_stop(
      bregma_wire_STOP_PERMIT_WITHDRAWN,
      [&] {
        world.send_permit(false, "the patient has moved by 3.1 mm");
        EXPECT_STREQ(world.control.state(world.now).text, "stopped: the patient has moved by 3.1 mm");
      },
      true);
}

TEST_F(Motion, EndsByTheEmergencyStop) {
  expect_stop(bregma_wire_STOP_EMERGENCY, [&] { world.arm.press_emergency(); });
  EXPECT_STREQ(world.reset().text, "the arm refuses: the emergency stop is pressed");
  world.arm.release_emergency();
  EXPECT_EQ(world.reset().result, bregma_wire_COMMAND_DONE);
}

TEST_F(Motion, EndsWithTheLink) {
  expect_stop(bregma_wire_STOP_LINK, [&] { world.cut(); });
  EXPECT_EQ(world.reset().result, bregma_wire_COMMAND_REFUSED);
  world.connect();
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_STOPPED);
  EXPECT_EQ(world.reset().result, bregma_wire_COMMAND_DONE);
}

TEST_F(Motion, AfterTheResetANewMotionBegins) {
  expect_stop(bregma_wire_STOP_COMMAND, [&] { (void)world.command(bregma_wire_COMMAND_STOP_ROBOT); });
  ASSERT_EQ(world.reset().result, bregma_wire_COMMAND_DONE);
  world.run(100 * kMs);
  const auto reply = world.move({beside(world.arm.stated_flange(), 0, 0, 20)});
  EXPECT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
  world.run_to_rest();
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_DONE);
}

TEST_F(Motion, AHoldEndsItWithoutALatch) {
  const auto start = world.arm.stated_flange();
  ASSERT_EQ(world.move({beside(start, 0, 0, 200)}).result, bregma_wire_COMMAND_DONE);
  world.run(500 * kMs);
  EXPECT_EQ(world.command(bregma_wire_COMMAND_HOLD_ROBOT).result, bregma_wire_COMMAND_DONE);
  world.held_motion = 0;
  world.run_to_rest();
  world.run(500 * kMs);
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_HELD);
  EXPECT_EQ(world.control.cause(), bregma_wire_STOP_NONE);
  EXPECT_EQ(world.move({start}).result, bregma_wire_COMMAND_DONE);
  world.run_to_rest();
  EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_DONE);
}

TEST_F(Motion, IsRefusedWithTheReason) {
  const auto start = world.arm.stated_flange();
  const auto text = [&](const std::vector<robot::FlangePose> &poses, bool to_trajectory = false,
                        double speed = kSpeed_mm_s) {
    const auto reply = world.move(poses, to_trajectory, speed);
    EXPECT_EQ(reply.result, bregma_wire_COMMAND_REFUSED);
    world.held_motion = 0;
    return std::string(reply.text);
  };
  EXPECT_EQ(text({beside(start, 5'000, 0, 0)}).rfind("the arm refuses: out of reach or beyond a joint limit", 0), 0U);
  EXPECT_EQ(text({}), "the path is malformed");
  EXPECT_EQ(text({beside(start, std::nan(""), 0, 0)}), "waypoint 1 of the path is not a pose");
  EXPECT_EQ(text({start}, false, 101.0), "speed_mm_s = 101.000000: must be above 0 and at most 100.000000");
  world.session = bregma_wire_SESSION_REGISTERED;
  world.send_daemon();
  EXPECT_EQ(text({start}, true), "the registration is not verified");
  world.session = bregma_wire_SESSION_VERIFIED;
  world.path_revision = 4;
  world.send_daemon();
  EXPECT_EQ(text({start}, true), "the path was not made with the accepted registration");
  world.daemon_speaks = false;
  world.run(2'000 * kMs);
  EXPECT_EQ(text({start}), "no daemon is heard");
  EXPECT_LT((world.flange() - start.translation()).norm(), 1e-6);
}

TEST_F(Motion, OnlySimulatedArmsMove) {
  world.control.disconnected();
  world.control.connected({"Nachi MZ07F", "4711", false});
  world.run(100 * kMs);
  EXPECT_STREQ(world.move({world.arm.stated_flange()}).text,
               "only simulated arms are moved: Nachi MZ07F 4711 is not one");
}

} // namespace
} // namespace bregma::arm
