// The daemon's stages in virtual time, and an arm with a range sensor as devices at the level of the wire: the
// simulated arm behind a socket and the simulated sensor on a pseudo-terminal, each with its real driver. The patient's
// head lies before the arm; the sensor's beam meets it.
//
// Only the bytes take real time. One thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/arm/arm_driver.hpp"
#include "drivers/range/range_sensor.hpp"
#include "drivers/sim/arm/carried_sensor.hpp"
#include "drivers/sim/arm/moving_head.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"
#include "drivers/sim/head.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"
#include "drivers/sim/range_line/simulated_line.hpp"
#include "drivers/sim/terminal/pseudo_terminal.hpp"
#include "server/config.hpp"
#include "server/wiring.hpp"
#include "tests/component/robot/robot_case.hpp"
#include "tests/support/memory_topics.hpp"
#include "tests/support/tcp_device.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/virtual_link.hpp"
#include "tests/support/virtual_loops.hpp"

namespace bregma::test {

class RobotRoom final : private server::Host, private driver::Host {
public:
  using Flange = robot::FlangePose;
  static constexpr std::int64_t kStep_ns = 8'000'000; // of the arm's measurements
  static constexpr double kCheckValid_min = 3.0;      // verification.valid_min

  RobotRoom(const RobotCase &a_case, std::uint64_t seed);
  ~RobotRoom() override;

  // Lets this time pass, or less if the condition holds; whether it did.
  bool run(
      double seconds, const std::function<bool()> &until = [] { return false; });
  // A command to the daemon, and its reply within 3 s.
  [[nodiscard]] wire::CommandReply command(wire::CommandKind kind, std::initializer_list<std::string_view> values = {});
  // Commands the arm along these poses and holds the deadman until it is there; false if it does not get there.
  [[nodiscard]] bool move(const std::vector<Flange> &path, double speed_mm_s);
  void release_deadman() { held_ = 0; }
  // Holds the deadman of the last command.
  void hold_deadman() { held_ = id_; }
  [[nodiscard]] std::uint64_t last_id() const { return id_; }
  [[nodiscard]] std::size_t replies_to(std::uint64_t id) const;
  [[nodiscard]] std::string last_reply() const { return replies_.empty() ? "" : std::string(replies_.back().text); }
  [[nodiscard]] wire::RobotMotionPhase phase() const {
    return motions.empty() ? bregma_wire_MOTION_UNKNOWN : motions.back().phase;
  }
  // Begins such a motion without waiting for its end.
  void start_move(const std::vector<Flange> &path, double speed_mm_s);

  // Truth.
  [[nodiscard]] const geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::Image> &T_base_image() const {
    return T_base_image_;
  }
  [[nodiscard]] const geometry::Rigid3<geometry::frame::Image, geometry::frame::Reference> &T_image_reference() const {
    return T_image_reference_;
  }
  [[nodiscard]] Flange flange() const { return arm_.true_flange(); }
  [[nodiscard]] geometry::Vector3d tip_in_image() const;
  [[nodiscard]] geometry::Vector3d axis_in_image() const; // of the tool, towards the tip
  // Smallest distance of the tool's middle line from the true skin.
  [[nodiscard]] double tool_clearance_mm() const;
  // The flange with its present orientation and the tip, or the beam at this distance, at a point in Image.
  [[nodiscard]] Flange touching(const geometry::Vector3d &image_mm, double before_mm = 0.0) const;
  [[nodiscard]] Flange above(const geometry::Vector3d &image_mm, double distance_mm) const;
  // Lines of constant height over the face.
  [[nodiscard]] std::vector<Flange> raster(double half_width_mm, double half_height_mm, double spacing_mm) const;

  // The patient moves to this displacement about the head's middle (rad, mm, in the arm's base), from now on and within
  // this time.
  void move_patient(const geometry::Vector6d &to, double seconds);
  // The tracker was moved against the arm, as seen from the camera.
  void bump_tracker(const geometry::Vector3d &by_mm) { bump_mm_ = by_mm; }
  // The arm's base was pushed to this displacement, against patient and tracker.
  void push_base(const geometry::Vector3d &by_mm) { push_mm_ = by_mm; }
  bool hide_reference = false, hide_flange_body = false, deliver_tracker = true;

  // Faults.
  std::function<void(wire::RobotState &)> tamper = [](wire::RobotState &) {};
  // For tamper: the arm repeats the values of its last state, with numbers and times going on.
  [[nodiscard]] std::function<void(wire::RobotState &)> frozen_values() const;
  bool deliver_arm = true;
  std::uint64_t undelivered = 0; // samples of the arm, while deliver_arm is false
  bool deliver_commands = true;  // of the daemon to the arm's driver
  bool deliver_permits = true;
  std::uint64_t arm_writer = MemoryTopics::kWriter;
  void unplug_sensor() { terminal_.reset(); }
  void plug_sensor(const std::string &serial);

  [[nodiscard]] std::int64_t now() const { return now_; }
  [[nodiscard]] const server::Session &session() const { return wiring_->session(); }
  [[nodiscard]] bool alarm_raised(std::string_view kind, std::string_view subject) const;
  [[nodiscard]] bool alarm_active(std::string_view kind) const;
  [[nodiscard]] const wire::DeviceHealth *device(std::string_view name) const;

  std::vector<wire::Alarm> alarms;
  std::vector<wire::NavigationState> states; // of the tool Pointer
  std::vector<wire::SurfacePoints> batches;  // without their sequences
  std::vector<geometry::Vector3d> points;    // of them
  wire::RegistrationState registration{};
  wire::AccuracyState accuracy{};
  wire::SystemHealth health{};
  std::vector<wire::RobotMotionState> motions;
  std::string range_error; // of the last connection

private:
  class ArmBus;
  class RangeBus;

  [[nodiscard]] std::int64_t now_ns() const override { return now_; }
  [[nodiscard]] wire::WriteTime write_time() const override { return link_.write_time(now_); }
  bool wait_until(std::int64_t /*time_ns*/) override { return true; }
  [[nodiscard]] bool stopping() const override { return false; }
  [[nodiscard]] wire::BootIdentity boot_id() const override { return kDaemonBoot; }
  [[nodiscard]] std::uint64_t run_id() const override { return 77; }
  void complete(wire::SystemHealth &sample) override { sample.run_id = run_id(); }

  void step();
  void serve_arm();
  void serve_range();
  void place_patient();
  void serve_tracker();
  [[nodiscard]] sim::BeamTarget beam_target() const;

  const RobotCase &case_;
  std::int64_t now_;
  VirtualLink link_;
  TemporaryFolder folder_;
  server::Config config_;
  MemoryTopics topics_;
  std::unique_ptr<server::Wiring> wiring_;
  VirtualLoops loops_;
  sim::Head head_;
  geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::Image> T_base_image_;

  // The patient's motion, and the tracker that sees it.
  sim::MovingHead patient_;
  geometry::Rigid3<geometry::frame::Image, geometry::frame::Reference> T_image_reference_;
  geometry::Vector3d bump_mm_ = geometry::Vector3d::Zero(), push_mm_ = geometry::Vector3d::Zero();
  std::mt19937 tracker_noise_;
  std::uint64_t tracker_frame_ = 0;
  std::optional<wire::TrackerFrame> exposed_; // at the last step, on its way

  sim::SimulatedArm arm_;
  TcpDevice socket_;
  bool arm_connected_ = false;
  wire::RobotState last_state_{}; // of the arm, as delivered
  std::unique_ptr<ArmBus> arm_bus_;
  driver::Status arm_status_;
  driver::Io arm_io_;
  arm::ArmDriver arm_driver_;

  std::string terminal_link_;
  sim::SharpSensor analogue_;
  std::optional<sim::PseudoTerminal> terminal_;
  std::optional<sim::SimulatedRangeLine> line_;
  std::unique_ptr<RangeBus> range_bus_;
  driver::Status range_status_;
  driver::Io range_io_;
  range::RangeSensor range_driver_;
  bool range_connected_ = false;
  std::int64_t range_retry_ns_ = 0;

  std::vector<wire::CommandReply> replies_;
  std::uint64_t id_ = 0, held_ = 0, deadman_frame_ = 0;
  std::int64_t next_deadman_ns_ = 0;
};

} // namespace bregma::test
