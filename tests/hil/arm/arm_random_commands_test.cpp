// Random commands with random failures, beside a head that the paths must not meet.
// BREGMA_ARM_COMMANDS sets the number of random commands.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "algorithms/planning/arm_collision.hpp"
#include "algorithms/robot/inverse_kinematics.hpp"
#include "algorithms/robot/straight_path.hpp"
#include "drivers/sim/random.hpp"
#include "tests/hil/arm/arm_world.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace bregma::arm {
namespace {

// One of nine failures.
void fail(World &world, int which) {
  switch (which) {
  case 0:
    (void)world.command(bregma_wire_COMMAND_STOP_ROBOT);
    break;
  case 1:
    (void)world.command(bregma_wire_COMMAND_HOLD_ROBOT);
    break;
  case 2:
    world.held_motion = 0;
    break;
  case 3:
    world.send_deadman(world.held_motion, world.client, false);
    break;
  case 4:
    world.daemon_speaks = false;
    break;
  case 5:
    ++world.run_id;
    world.send_daemon();
    break;
  case 6:
    world.session = bregma_wire_SESSION_DEGRADED;
    world.send_daemon();
    break;
  case 7:
    world.arm.press_emergency();
    break;
  default:
    world.cut();
    break;
  }
}

// What an operator does after a failure.
void recover(World &world) {
  world.held_motion = 0;
  world.daemon_speaks = true;
  world.session = bregma_wire_SESSION_VERIFIED;
  world.arm.release_emergency();
  if (!world.linked) {
    world.connect();
  }
  world.send_daemon();
  if (world.control.cause() != bregma_wire_STOP_NONE || world.arm.state() == ArmState::kFault) {
    const auto reply = world.reset();
    EXPECT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
  }
  world.run(60 * kMs);
}

// Whether the guide of a flange on this path meets the ball somewhere.
bool touches(const std::vector<robot::FlangePose> &path, const BallHead &ball) {
  robot::StraightPath line(path.front());
  for (const robot::FlangePose &pose : path) {
    line.add(pose);
  }
  for (double at = 0.0; at <= line.length_mm(); at += 1.0) {
    const robot::FlangePose pose = line.pose(at);
    for (double depth = 0.0; depth <= ball.guide_mm; depth += 5.0) {
      if ((pose * robot::Vector3d(0.0, 0.0, depth) - ball.middle_mm).norm() < ball.radius_mm + ball.guide_radius_mm) {
        return true;
      }
    }
  }
  return false;
}

// What a path is checked with before it is commanded.
struct Planner {
  planning::ArmCollision collision;
  robot::InverseKinematics inverse{model()};

  [[nodiscard]] planning::PathCheck check(const robot::JointAngles &from,
                                          const std::vector<robot::FlangePose> &path) const {
    return planning::check_path(collision, inverse, from, path);
  }
};

// All joints turn evenly, in steps that the straight lines of the flange follow closely.
std::vector<robot::FlangePose> even_turn(const robot::JointAngles &from, const robot::JointAngles &to) {
  constexpr double kStep_rad = 0.1;
  const int steps = std::max(1, static_cast<int>(std::ceil((to - from).cwiseAbs().maxCoeff() / kStep_rad)));
  std::vector<robot::FlangePose> out;
  for (int i = 1; i <= steps; ++i) {
    out.push_back(model().forward(from + (to - from) * (static_cast<double>(i) / steps)));
  }
  return out;
}

// What an operator does with an arm that no straight line leads away: back from the head, then the joints to where the
// work began. Every path is checked like any other; false if the arm is not home at the end.
bool go_home(World &world, const Planner &planner, const robot::Vector3d &ahead) {
  const robot::JointAngles home = settings().start;
  const robot::Vector3d up = robot::Vector3d::UnitZ();
  for (const robot::Vector3d &retreat :
       {robot::Vector3d(robot::Vector3d::Zero()), robot::Vector3d(-100.0 * ahead), robot::Vector3d(-200.0 * ahead),
        robot::Vector3d(100.0 * up), robot::Vector3d(200.0 * up), robot::Vector3d(150.0 * (up - ahead)),
        robot::Vector3d(-100.0 * up)}) {
    const robot::FlangePose from = world.arm.stated_flange();
    std::vector<robot::FlangePose> path{beside(from, retreat.x(), retreat.y(), retreat.z())};
    const auto first = planner.check(world.arm.joints(), path);
    if (!first.clear()) {
      continue;
    }
    const auto turn = even_turn(first.end, home);
    path.insert(path.end(), turn.begin(), turn.end());
    if (!planner.check(world.arm.joints(), path).clear() ||
        world.move(path, false, 60.0).result != bregma_wire_COMMAND_DONE) {
      continue;
    }
    world.run_to_rest();
    world.held_motion = 0;
    return (world.arm.joints() - home).cwiseAbs().maxCoeff() < 0.01;
  }
  return false;
}

TEST_F(Motion, RandomCommandsWithRandomFailures) {
  const char *wanted = std::getenv("BREGMA_ARM_COMMANDS");
  const int commands = wanted != nullptr ? std::atoi(wanted) : 300;
  sim::Random random(11, "arm commands");
  const auto pose = [&](double spread) {
    robot::JointAngles joints = settings().start;
    for (Eigen::Index i = 0; i < joints.size(); ++i) {
      joints[i] += random.uniform(-spread, spread);
    }
    return model().forward(joints);
  };
  // The head lies in front of the guide; one path in eight leads into it or behind it.
  const robot::FlangePose start = model().forward(settings().start);
  const robot::Vector3d ahead = start.rotation() * robot::Vector3d::UnitZ();
  BallHead ball;
  ball.middle_mm = start.translation() + (ball.guide_mm + ball.radius_mm + 70.0) * ahead;
  world.head = ball;
  planning::ArmScene scene;
  scene.obstacles.push_back({"head", test::make_sphere(3, ball.radius_mm + 0.5, ball.middle_mm)});
  const Planner planner{planning::ArmCollision(model(), ball.bodies(), scene)};
  int homed = 0;
  int not_homed = 0;
  const auto home_if_away = [&] {
    if ((world.arm.joints() - settings().start).cwiseAbs().maxCoeff() > 0.2) {
      ++(go_home(world, planner, ahead) ? homed : not_homed);
    }
  };
  int executed = 0;
  int refused = 0;
  int refused_by_plan = 0;
  int would_collide = 0;
  for (int i = 0; i < commands && !HasFailure(); ++i) {
    const double kind = random.uniform(0.0, 1.0);
    std::vector<robot::FlangePose> path;
    for (int w = static_cast<int>(random.uniform(0.0, 2.99)); w >= 0; --w) {
      path.push_back(kind < 0.1 ? beside(pose(2.5), random.uniform(-600, 600), random.uniform(-600, 600), 0)
                                : pose(0.04));
    }
    if (kind >= 0.1 && kind < 0.22) {
      const robot::Vector3d into = random.uniform(100.0, 420.0) * ahead + random.normal3(60.0);
      path.insert(path.begin(), beside(start, into.x(), into.y(), into.z()));
    }
    const auto plan = planner.check(world.arm.joints(), path);
    if (plan.verdict == planning::PathVerdict::kTooClose || plan.verdict == planning::PathVerdict::kBranch) {
      ++refused_by_plan;
      would_collide += touches(path, ball) ? 1 : 0;
      home_if_away();
      continue; // the client does not command it
    }
    const std::uint64_t done = world.arm.motions_done();
    const auto reply = world.move(path, random.uniform(0.0, 1.0) < 0.5, random.uniform(40.0, 100.0));
    refused += reply.result == bregma_wire_COMMAND_DONE ? 0 : 1;
    if (kind > 0.75) {
      world.run(static_cast<std::int64_t>(random.uniform(0.0, 500.0)) * kMs);
      fail(world, static_cast<int>(random.uniform(0.0, 8.99)));
    }
    world.run_to_rest();
    executed += world.arm.motions_done() > done ? 1 : 0;
    if (world.control.cause() != bregma_wire_STOP_NONE) { // before the reset nothing moves it
      const robot::Vector3d rest = world.flange();
      EXPECT_EQ(world.move({pose(0.1)}).result, bregma_wire_COMMAND_REFUSED);
      world.run(60 * kMs);
      EXPECT_LT((world.flange() - rest).norm(), 1e-6);
    }
    recover(world);
    if (reply.result != bregma_wire_COMMAND_DONE) {
      home_if_away();
    }
  }
  std::printf("%d motions commanded, %d executed to their end, %d refused; %llu stops in motion\n", commands, executed,
              refused, static_cast<unsigned long long>(world.stops_in_motion));
  std::printf("%d refused by the plan, of which %d touch the head; nearest to the head %.1f mm\n", refused_by_plan,
              would_collide, world.least_head_mm);
  std::printf("brought home %d times, %d times without a clear way\n", homed, not_homed);
  std::printf("smallest distance from a joint limit %.3f rad, longest stop %.2f of the stated distance\n",
              world.least_margin_rad, world.worst_stop);
  EXPECT_GE(2 * executed, commands) << "at least half of the motions are executed";
  EXPECT_GT(world.least_head_mm, 0.0) << "the arm went into the head";
  EXPECT_GT(would_collide, commands / 40) << "paths through the head were tried";
  EXPECT_GT(world.stops_in_motion, static_cast<std::uint64_t>(commands) / 40);
  expect_sound();
}

} // namespace
} // namespace bregma::arm
