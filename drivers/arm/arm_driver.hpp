// An arm behind a socket as a device of the driver frame: publishes RobotState and RobotMotionState, and carries out
// the commands to the arm under the conditions of motion_control.hpp.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/parameters.hpp"
#include "base/result.hpp"
#include "drivers/arm/arm_line.hpp"
#include "drivers/arm/motion_control.hpp"
#include "drivers/frame/byte_stream.hpp"
#include "drivers/frame/io.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/frame/settings.hpp"

namespace bregma::arm {

class ArmDriver final : public driver::Device {
public:
  using Writes = driver::Topics<wire::RobotState, wire::RobotMotionState, wire::CommandReply>;
  using Reads = driver::Topics<wire::Command, wire::RobotPath, wire::RobotPermit, wire::RobotDeadman,
                               wire::SystemHealth, wire::RegistrationState>;

  void declare(base::ParameterSet &parameters) override;
  base::Result<void> prepare(const driver::Settings &settings) override;
  driver::Outcome<void> connect(driver::Io &io) override;
  driver::Outcome<driver::Progress> read(driver::Io &io) override;
  void disconnect() noexcept override;

private:
  driver::Outcome<void> take_message(const FromArm &message, driver::Io &io);
  void take_wire(driver::Io &io);
  // Lines and replies of the control.
  driver::Outcome<void> pass_on(driver::Io &io);
  void publish_state(const MeasuredCp &pose, driver::Io &io) const;
  void publish_motion(driver::Io &io);
  void put_covariance(const LinePose &T_base_flange, wire::PoseCovariance &out) const;

  std::string address_ = "tcp://127.0.0.1:4700";
  std::string serial_number_;
  std::string tool_;
  double period_ms_ = 8.0;
  double sigma_mm_ = 0.0, sigma_mrad_ = 0.0;
  double max_speed_mm_s_ = 100.0;
  double daemon_silence_s_ = 1.5;

  std::optional<MotionControl> control_; // from prepare()
  driver::ByteStream stream_;
  driver::LineSplitter lines_{kMaxLine};
  std::optional<Identity> arm_;
  std::optional<MeasuredJs> joints_;
  std::uint64_t motion_frame_ = 0;
  std::int64_t next_motion_ns_ = 0;
  std::int64_t heard_ns_ = 0;
  driver::Io *io_ = nullptr; // between connect and disconnect
};

} // namespace bregma::arm
