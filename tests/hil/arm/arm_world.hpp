// Driver's conditions of motion and simulated arm, with a client and a daemon, line by line in virtual time.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "algorithms/planning/arm_collision.hpp"
#include "drivers/arm/motion_control.hpp"
#include "drivers/arm/stop_text.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "tests/unit/robot/arms.hpp"

namespace bregma::arm {

inline constexpr std::int64_t kMs = 1'000'000;
inline constexpr std::uint64_t kRun = 77;
inline constexpr double kSpeed_mm_s = 80.0;

inline const robot::ArmModel &model() {
  static const robot::ArmModel kModel = test::mz07f();
  return kModel;
}

inline sim::ArmSettings settings() {
  sim::ArmSettings out;
  out.start << 0.0, 1.4, 0.0, 0.1, -1.1, 0.0;
  return out;
}

inline robot::FlangePose beside(const robot::FlangePose &pose, double x, double y, double z) {
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
    if (permits && now >= next_permit) {
      next_permit = now + 20 * kMs;
      send_permit(true);
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
  // For the motion that was commanded last.
  void send_permit(bool permitted, const char *why = "") {
    wire::RobotPermit out{};
    (void)wire::set_name(out.device, "Robot");
    (void)wire::set_name(out.client, client);
    out.motion_id = id_;
    out.run_id = permit_run.value_or(run_id);
    out.frame = ++permit_frame;
    out.permitted = permitted;
    wire::set_text(out.text, why);
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
    path.needs_permit = needs_permit;
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
  bool needs_permit = false, permits = false; // paths need the daemon's permit; it sends them
  std::uint64_t permit_frame = 0;
  std::int64_t next_permit = 0;
  std::optional<std::uint64_t> permit_run;
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

} // namespace bregma::arm
