// The driver's conditions of motion and the simulated arm, line by line in virtual time: what ends a motion, what
// refuses it, and random commands with random failures, beside a head that the paths must not meet.
// BREGMA_ARM_COMMANDS sets the number of random commands.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "algorithms/planning/arm_collision.hpp"
#include "drivers/arm/motion_control.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"
#include "drivers/sim/random.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/robot/arms.hpp"

namespace bregma::arm {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint64_t kRun = 77;
constexpr double kSpeed_mm_s = 80.0;

const robot::ArmModel &model() {
  static const robot::ArmModel kModel = test::mz07f();
  return kModel;
}

sim::ArmSettings settings() {
  sim::ArmSettings out;
  out.start << 0.0, 1.4, 0.0, 0.1, -1.1, 0.0;
  return out;
}

robot::FlangePose beside(const robot::FlangePose &pose, double x, double y, double z) {
  return {pose.rotation(), robot::Vector3d(pose.translation() + robot::Vector3d(x, y, z))};
}

// A ball as the head, in front of a guide on the flange.
struct BallHead {
  robot::Vector3d middle_mm = robot::Vector3d::Zero();
  double radius_mm = 90.0;
  double guide_mm = 100.0, guide_radius_mm = 6.0;

  [[nodiscard]] planning::ArmBodies bodies() const {
    planning::ArmBodies out;
    out.tools.push_back({"guide", robot::Vector3d::Zero(), guide_mm * robot::Vector3d::UnitZ(), guide_radius_mm});
    return out;
  }
  // Distance of the arm from the ball, in closed form: not the planner's code.
  [[nodiscard]] double distance_mm(const robot::JointAngles &joints) const {
    const auto axes = model().axes(joints);
    const robot::FlangePose flange = model().forward(joints);
    const auto radii = bodies().radius_mm;
    double out = from_line(flange.translation(), flange * robot::Vector3d(0.0, 0.0, guide_mm)) - guide_radius_mm;
    for (std::size_t i = 0; i < robot::kJoints; ++i) {
      const robot::Vector3d &end = i + 1 < robot::kJoints ? axes[i + 1].point_mm : flange.translation();
      out = std::min(out, from_line(axes[i].point_mm, end) - radii[i]);
    }
    return out;
  }

private:
  [[nodiscard]] double from_line(const robot::Vector3d &a, const robot::Vector3d &b) const {
    const robot::Vector3d along = b - a;
    const double t = std::clamp((middle_mm - a).dot(along) / std::max(along.squaredNorm(), 1e-12), 0.0, 1.0);
    return (a + t * along - middle_mm).norm() - radius_mm;
  }
};

// Driver, arm, client and daemon on a clock of the test.
class World {
public:
  World() { connect(); }

  void connect() {
    linked = true;
    to_control(arm.connect());
    run(100 * kMs);
  }
  void cut() { // the link between driver and arm
    linked = false;
    arm.disconnect();
    control.disconnected();
  }

  // One tick of the arm.
  void tick() {
    now += sim::SimulatedArm::kTick_ns;
    if (daemon_speaks && now >= next_health) {
      send_daemon();
    }
    if (held_motion != 0 && now >= next_deadman) {
      next_deadman = now + 50 * kMs;
      send_deadman(held_motion, client, true);
    }
    control.step(now);
    exchange();
    const std::string telemetry = arm.advance(now);
    if (linked) {
      to_control(telemetry);
    }
    exchange();
    watch();
  }
  void run(std::int64_t duration_ns) {
    for (const std::int64_t end = now + duration_ns; now < end;) {
      tick();
    }
  }
  // Until the motion has ended and the arm is at rest.
  void run_to_rest(std::int64_t limit_ns = 60'000 * kMs) {
    for (const std::int64_t end = now + limit_ns; now < end;) {
      tick();
      const auto phase = control.phase();
      if (phase != bregma_wire_MOTION_WAITS && phase != bregma_wire_MOTION_UNDER_WAY && !arm.moving()) {
        return;
      }
    }
    ADD_FAILURE() << "the arm has not come to rest";
  }

  void send_daemon() {
    next_health = now + 500 * kMs;
    wire::SystemHealth health{};
    health.run_id = run_id;
    health.session = session;
    control.take(health, now);
    wire::RegistrationState registration{};
    registration.accepted_revision = revision;
    control.take(registration, now);
  }
  void send_deadman(std::uint64_t motion, const char *from, bool held) {
    wire::RobotDeadman out{};
    (void)wire::set_name(out.device, "Robot");
    (void)wire::set_name(out.client, from);
    out.motion_id = motion;
    out.frame = ++deadman_frame;
    out.held = held;
    control.take(out, now);
  }
  wire::CommandReply command(wire::CommandKind kind) {
    const wire::Command out = filled(kind, {"Robot"});
    control.take(out, now);
    return reply_to(out);
  }
  // Commands a motion along these poses, and holds its deadman.
  wire::CommandReply move(const std::vector<robot::FlangePose> &poses, bool to_trajectory = false,
                          double speed_mm_s = kSpeed_mm_s) {
    const std::string speed = std::to_string(speed_mm_s);
    const wire::Command out = to_trajectory
                                  ? filled(bregma_wire_COMMAND_MOVE_TO_TRAJECTORY, {"Robot", "T1", "50", speed})
                                  : filled(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", speed, "5"});
    wire::RobotPath path{};
    (void)wire::set_name(path.device, "Robot");
    (void)wire::set_name(path.client, client);
    path.motion_id = out.id;
    path.speed_mm_s = speed_mm_s;
    path.waypoint_count = static_cast<std::uint32_t>(poses.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      path.T_base_flange[i] = wire::to_wire(poses[i]);
    }
    path.run_id = run_id;
    path.needs_registration = to_trajectory;
    path.accepted_revision = path_revision.value_or(revision);
    if (out.id % 2 == 0) { // in either order
      control.take(path, now);
    }
    control.take(out, now);
    if (out.id % 2 != 0) {
      control.take(path, now);
    }
    held_motion = out.id;
    next_deadman = now;
    return reply_to(out);
  }
  wire::CommandReply reset() {
    held_motion = 0;
    return command(bregma_wire_COMMAND_RESET_ROBOT);
  }
  [[nodiscard]] robot::Vector3d flange() const { return arm.stated_flange().translation(); }

  std::int64_t now = 1'700'000'000'000 * kMs;
  sim::SimulatedArm arm{model(), model(), settings()};
  MotionControl control{"Robot", {}};
  const char *client = "console";
  std::uint64_t held_motion = 0; // 0: none
  std::uint64_t deadman_frame = 0;
  std::int64_t next_deadman = 0, next_health = 0;
  bool daemon_speaks = true;
  std::uint64_t run_id = kRun, revision = 5;
  std::optional<std::uint64_t> path_revision;
  wire::SessionState session = bregma_wire_SESSION_VERIFIED;
  bool linked = false;

  // Judged in every tick.
  double least_margin_rad = 1.0;
  double most_mm_s = 0.0;
  double worst_stop = 0.0;          // way after a stop, as a part of the stated distance
  double moved_after_stop_mm = 0.0; // beyond that distance
  std::uint64_t stops_in_motion = 0;
  std::optional<BallHead> head;
  double least_head_mm = std::numeric_limits<double>::infinity();

private:
  struct Stop {
    double stated_mm;
    double way_mm;
  };

  wire::Command filled(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
    wire::Command out{};
    EXPECT_EQ(wire::fill_command(out, kind, values), "");
    (void)wire::set_name(out.client, client);
    (void)wire::set_name(out.receiver, "Robot");
    out.id = ++id_;
    return out;
  }
  // The only reply to a command; without a result if there is none yet.
  wire::CommandReply reply_to(const wire::Command &command) {
    replies_.clear();
    for (int i = 0; i < 3; ++i) {
      exchange();
    }
    wire::CommandReply out{};
    for (const auto &reply : replies_) {
      if (reply.id == command.id) {
        EXPECT_EQ(out.id, 0U) << "two replies";
        out = reply;
      }
    }
    return out;
  }
  void to_control(std::string_view bytes) {
    (void)lines_.take(bytes, [&](std::string_view line) {
      const auto message = parse_from_arm(line);
      ASSERT_TRUE(message) << line;
      if (const auto *identity = std::get_if<Identity>(&*message)) {
        control.connected(*identity);
      } else if (const auto *state = std::get_if<OperatingState>(&*message)) {
        control.take(*state);
      } else if (const auto *setpoint = std::get_if<SetpointJs>(&*message)) {
        control.take(*setpoint);
      } else if (const auto *answer = std::get_if<Answer>(&*message)) {
        control.take(*answer);
      }
    });
  }
  void exchange() {
    const std::string lines = control.take_lines();
    const double stated_mm = lines.empty() ? stated_mm_ : arm.stop_mm();
    if (linked && !lines.empty()) {
      to_control(arm.receive(lines, now));
    }
    for (auto &reply : control.take_replies()) {
      replies_.push_back(reply);
    }
    if (arm.state() != ArmState::kFault) {
      stop_.reset();
    } else if (!stop_) {
      stop_.emplace(Stop{stated_mm, 0.0});
      stops_in_motion += stated_mm > 0.1 ? 1 : 0;
    }
  }
  void watch() {
    least_margin_rad = std::min(least_margin_rad, model().limit_margin(arm.joints()));
    if (head) {
      least_head_mm = std::min(least_head_mm, head->distance_mm(arm.joints()));
    }
    const robot::Vector3d at_mm = flange();
    const double step_mm = has_last_ ? (at_mm - last_).norm() : 0.0;
    most_mm_s = std::max(most_mm_s, step_mm / 4e-3);
    if (stop_) {
      stop_->way_mm += step_mm;
      worst_stop = stop_->stated_mm > 0.1 ? std::max(worst_stop, stop_->way_mm / stop_->stated_mm) : worst_stop;
      moved_after_stop_mm = std::max(moved_after_stop_mm, stop_->way_mm - stop_->stated_mm);
    }
    last_ = at_mm;
    has_last_ = true;
    stated_mm_ = arm.stop_mm();
  }

  driver::LineSplitter lines_{kMaxLine};
  std::vector<wire::CommandReply> replies_;
  std::uint64_t id_ = 100;
  std::optional<Stop> stop_;
  robot::Vector3d last_ = robot::Vector3d::Zero();
  bool has_last_ = false;
  double stated_mm_ = 0.0; // before this tick
};

class Motion : public testing::Test {
protected:
  void expect_sound() const {
    EXPECT_GE(world.least_margin_rad, 0.0) << "beyond a joint limit";
    EXPECT_LE(world.moved_after_stop_mm, 1e-6) << "the stop is longer than stated";
  }
  // Lets a motion of 200 mm run for half a second, then expects that the event stops it with this cause.
  template <class Event> void expect_stop(wire::RobotStopCause cause, Event &&event, bool to_trajectory = false) {
    const auto start = world.arm.stated_flange();
    const auto reply = world.move({beside(start, 0, 0, 200)}, to_trajectory);
    ASSERT_EQ(reply.result, bregma_wire_COMMAND_DONE) << reply.text;
    world.run(500 * kMs);
    ASSERT_EQ(world.control.phase(), bregma_wire_MOTION_UNDER_WAY);
    ASSERT_GT((world.flange() - start.translation()).norm(), 10.0);
    event();
    world.run_to_rest();
    EXPECT_EQ(world.control.phase(), bregma_wire_MOTION_STOPPED);
    EXPECT_EQ(world.control.cause(), cause) << describe(world.control.cause());
    EXPECT_LT((world.flange() - start.translation()).norm(), 190.0);
    // The stop is latched: nothing moves the arm, whatever has recovered.
    const robot::Vector3d rest = world.flange();
    world.daemon_speaks = true;
    world.run_id = kRun;
    world.session = bregma_wire_SESSION_VERIFIED;
    world.revision = 5;
    world.send_daemon();
    EXPECT_EQ(world.move({beside(start, 0, 0, 50)}).result, bregma_wire_COMMAND_REFUSED);
    world.run(1'000 * kMs);
    EXPECT_LT((world.flange() - rest).norm(), 1e-6);
    expect_sound();
  }

  World world;
};

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
  const planning::ArmCollision collision(model(), ball.bodies(), scene);
  const robot::InverseKinematics inverse(model());
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
    const auto plan = planning::check_path(collision, inverse, world.arm.joints(), path);
    if (plan.verdict == planning::PathVerdict::kTooClose || plan.verdict == planning::PathVerdict::kBranch) {
      ++refused_by_plan;
      would_collide += touches(path, ball) ? 1 : 0;
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
  }
  std::printf("%d motions commanded, %d executed to their end, %d refused; %llu stops in motion\n", commands, executed,
              refused, static_cast<unsigned long long>(world.stops_in_motion));
  std::printf("%d refused by the plan, of which %d touch the head; nearest to the head %.1f mm\n", refused_by_plan,
              would_collide, world.least_head_mm);
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
