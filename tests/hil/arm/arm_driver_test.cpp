// The driver of an arm against the simulated arm over a socket: its states, a motion under the deadman, damaged lines,
// a lost connection, and arms that are not used.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/arm/arm_driver.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "tests/support/arm_wire.hpp"
#include "tests/support/tcp_device.hpp"
#include "tests/unit/robot/arms.hpp"

namespace bregma::arm {
namespace {

using namespace std::chrono_literals;

// Time of driver and arm, which the test lets pass. Only the bytes take real time.
class TestHost final : public driver::Host {
public:
  [[nodiscard]] std::int64_t now_ns() const override { return now; }
  [[nodiscard]] wire::WriteTime write_time() const override { return {}; }
  bool wait_until(std::int64_t time_ns) override {
    now = std::max(now, time_ns);
    return true;
  }
  [[nodiscard]] bool stopping() const override { return false; }

  std::int64_t now = 1'700'000'000'000'000'000;
};

// The simulated arm behind a socket.
class ServedArm {
public:
  explicit ServedArm(const std::string &serial = "SIM1") : arm_(test::mz07f(), test::mz07f(), settings(serial)) {}

  [[nodiscard]] std::string address() const { return socket_.address(); }
  [[nodiscard]] robot::FlangePose flange() const { return arm_.stated_flange(); }
  [[nodiscard]] bool moving() const { return arm_.moving(); }

  void serve(std::int64_t now_ns) {
    if (!connected_ && takes_connections && socket_.accept(0ms)) {
      connected_ = true;
      send(arm_.connect());
    }
    const std::string answer = connected_ ? arm_.receive(socket_.receive_some(0ms), now_ns) : std::string();
    send(answer + arm_.advance(now_ns));
  }
  void cut() {
    takes_connections = false;
    connected_ = false;
    socket_.hang_up();
    arm_.disconnect();
  }

  bool takes_connections = true;
  bool garbles = false; // damages a byte of everything that it sends

private:
  static sim::ArmSettings settings(const std::string &serial) {
    sim::ArmSettings out;
    out.start << 0.0, 1.4, 0.0, 0.1, -1.1, 0.0;
    out.serial = serial;
    return out;
  }
  void send(std::string bytes) {
    if (garbles && bytes.size() > 20) {
      bytes[10] = static_cast<char>(bytes[10] ^ 1);
    }
    if (connected_ && !bytes.empty()) {
      EXPECT_TRUE(socket_.send(bytes));
    }
  }

  test::TcpDevice socket_;
  sim::SimulatedArm arm_;
  bool connected_ = false;
};

// The wire in memory.
class WireBus final : public test::ArmWire {
public:
  bool write(std::string_view topic, const void *sample) override {
    keep(topic, sample, states);
    keep(topic, sample, motions);
    keep(topic, sample, replies);
    return true;
  }

  std::vector<wire::RobotState> states;
  std::vector<wire::RobotMotionState> motions;
  std::vector<wire::CommandReply> replies;

private:
  template <class T> static void keep(std::string_view topic, const void *sample, std::vector<T> &to) {
    if (topic == wire::Topic<T>::kName) {
      to.push_back(*static_cast<const T *>(sample));
    }
  }
};

class Driver : public testing::Test {
protected:
  void prepare(const std::string &serial = "") {
    base::ParameterSet parameters("bregma-arm");
    device.declare(parameters);
    ASSERT_TRUE(parameters.set_from_string("address=" + arm.address()));
    ASSERT_TRUE(parameters.set_from_string("serial_number=" + serial));
    ASSERT_TRUE(parameters.set_from_string("tool=ProbeGuide"));
    driver::Settings settings;
    settings.device = "Robot";
    ASSERT_TRUE(device.prepare(settings));
  }
  // Lets this time pass, or less if the condition holds. The daemon and, for `held`, the client speak.
  std::string run(
      std::chrono::milliseconds time, const std::function<bool()> &until = [] { return false; }) {
    for (const std::int64_t end = host.now + 1'000'000 * time.count(); host.now < end && !until();) {
      host.now += sim::SimulatedArm::kTick_ns;
      speak();
      arm.serve(host.now);
      if (const auto progress = device.read(io); !progress) {
        return progress.error().message;
      }
    }
    return "";
  }
  void speak() {
    const std::int64_t now = host.now;
    if (now >= next_health) {
      next_health = now + 400'000'000;
      wire::SystemHealth health{};
      health.run_id = 77;
      health.session = bregma_wire_SESSION_VERIFIED;
      bus.healths.push_back(health);
    }
    if (held != 0 && now >= next_deadman) {
      next_deadman = now + 50'000'000;
      wire::RobotDeadman deadman{};
      (void)wire::set_name(deadman.device, "Robot");
      (void)wire::set_name(deadman.client, "console");
      deadman.motion_id = held;
      deadman.frame = ++deadman_frame;
      deadman.held = true;
      bus.deadmen.push_back(deadman);
    }
  }
  std::uint64_t send(wire::CommandKind kind, std::initializer_list<std::string_view> values) {
    wire::Command command{};
    EXPECT_EQ(wire::fill_command(command, kind, values), "");
    (void)wire::set_name(command.client, "console");
    (void)wire::set_name(command.receiver, "Robot");
    command.id = ++id;
    bus.commands.push_back(command);
    return command.id;
  }
  // A scan along the line to this pose, with its deadman.
  void move_to(const robot::FlangePose &goal) {
    held = send(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "50", "5"});
    wire::RobotPath path{};
    (void)wire::set_name(path.device, "Robot");
    (void)wire::set_name(path.client, "console");
    path.motion_id = held;
    path.speed_mm_s = 50.0;
    path.waypoint_count = 1;
    path.T_base_flange[0] = wire::to_wire(goal);
    bus.paths.push_back(path);
  }
  [[nodiscard]] wire::RobotMotionPhase phase() const {
    return bus.motions.empty() ? bregma_wire_MOTION_UNKNOWN : bus.motions.back().phase;
  }

  WireBus bus;
  TestHost host;
  ServedArm arm;
  driver::Status status;
  driver::Io io{bus, host, status, {.device = "Robot"}};
  ArmDriver device;
  std::uint64_t id = 0, held = 0, deadman_frame = 0;
  std::int64_t next_health = 0, next_deadman = 0;
};

robot::FlangePose above(const robot::FlangePose &pose, double z) {
  return {pose.rotation(), robot::Vector3d(pose.translation() + robot::Vector3d(0, 0, z))};
}

TEST_F(Driver, MovesTheArmAndSaysWhereItIs) {
  prepare();
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(run(5s, [&] { return bus.states.size() > 20 && phase() == bregma_wire_MOTION_NONE; }), "");
  const auto start = arm.flange();
  const auto goal = above(start, 25.0);
  move_to(goal);
  ASSERT_EQ(run(10s, [&] { return phase() == bregma_wire_MOTION_UNDER_WAY; }), "");
  const wire::RobotState moving = bus.states.back();
  EXPECT_EQ(wire::view(moving.motion_client), "console");
  EXPECT_EQ(moving.motion_id, held);
  ASSERT_EQ(run(10s, [&] { return phase() == bregma_wire_MOTION_DONE; }), "");
  ASSERT_EQ(bus.replies.size(), 1U);
  EXPECT_EQ(bus.replies[0].result, bregma_wire_COMMAND_DONE) << bus.replies[0].text;
  ASSERT_EQ(run(100ms), "");
  const wire::RobotState last = bus.states.back();
  EXPECT_LT(
      (wire::from_wire<geometry::frame::RobotBase, geometry::frame::RobotFlange>(last.T_base_flange).translation() -
       goal.translation())
          .norm(),
      0.01);
  EXPECT_EQ(wire::view(last.tool), "ProbeGuide");
  EXPECT_EQ(last.mode, bregma_wire_ROBOT_ENABLED);
  EXPECT_EQ(last.joint_count, 6U);
  EXPECT_TRUE(bus.motions.back().simulated);
  EXPECT_EQ(status.values().skipped, 0U);
  device.disconnect();
}

TEST_F(Driver, WithoutTheDeadmanTheArmStopsAndWaitsForTheReset) {
  prepare();
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(run(5s, [&] { return phase() == bregma_wire_MOTION_NONE; }), "");
  const auto start = arm.flange();
  move_to(above(start, 200.0));
  ASSERT_EQ(run(10s, [&] { return (arm.flange().translation() - start.translation()).norm() > 5.0; }), "");
  held = 0;
  ASSERT_EQ(run(5s, [&] { return phase() == bregma_wire_MOTION_STOPPED && !arm.moving(); }), "");
  EXPECT_EQ(bus.motions.back().cause, bregma_wire_STOP_DEADMAN_LOST);
  EXPECT_EQ(bus.motions.back().operating_state, bregma_wire_ROBOT_STOPPED);
  move_to(start);
  ASSERT_EQ(run(5s, [&] { return bus.replies.size() == 2; }), "");
  EXPECT_STREQ(bus.replies[1].text, "a stop is latched: reset it first");
  held = 0;
  (void)send(bregma_wire_COMMAND_RESET_ROBOT, {"Robot"});
  ASSERT_EQ(run(5s, [&] { return bus.replies.size() == 3; }), "");
  EXPECT_EQ(bus.replies[2].result, bregma_wire_COMMAND_DONE) << bus.replies[2].text;
  device.disconnect();
}

TEST_F(Driver, ALostConnectionStopsTheArmAndIsLatched) {
  prepare();
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(run(5s, [&] { return phase() == bregma_wire_MOTION_NONE; }), "");
  const auto start = arm.flange();
  move_to(above(start, 200.0));
  ASSERT_EQ(run(10s, [&] { return (arm.flange().translation() - start.translation()).norm() > 5.0; }), "");
  arm.cut();
  EXPECT_NE(run(5s).find(arm.address()), std::string::npos) << "the error begins with the address";
  device.disconnect();
  while (arm.moving()) {
    host.now += sim::SimulatedArm::kTick_ns;
    arm.serve(host.now);
  }
  const auto rest = arm.flange();
  EXPECT_LT((rest.translation() - start.translation()).norm(), 190.0);
  // A command while the arm is away is answered, and not carried out when it is back.
  move_to(start);
  arm.takes_connections = true;
  io.start_connection();
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(run(500ms), "");
  ASSERT_EQ(bus.replies.size(), 2U);
  EXPECT_STREQ(bus.replies[1].text, "the arm is not connected");
  EXPECT_EQ(phase(), bregma_wire_MOTION_STOPPED);
  EXPECT_EQ(bus.motions.back().cause, bregma_wire_STOP_LINK);
  EXPECT_LT((arm.flange().translation() - rest.translation()).norm(), 1e-6);
  device.disconnect();
}

TEST_F(Driver, DamagedLinesAreCounted) {
  prepare();
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(run(5s, [&] { return bus.states.size() > 5; }), "");
  arm.garbles = true;
  (void)run(150ms); // most lines still arrive whole
  EXPECT_GT(status.values().skipped, 3U);
  device.disconnect();
}

TEST_F(Driver, AnArmWithAnotherSerialNumberIsNotUsed) {
  prepare("SIM2");
  ASSERT_TRUE(device.connect(io));
  EXPECT_EQ(run(5s), arm.address() + ": arm Nachi MZ07F SIM1 is not used: a person must check it and set "
                                     "serial_number = SIM1");
  EXPECT_TRUE(bus.states.empty());
  device.disconnect();
}

} // namespace
} // namespace bregma::arm
