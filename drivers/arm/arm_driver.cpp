#include "drivers/arm/arm_driver.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>
#include <variant>

#include "algorithms/geometry/pose_covariance.hpp"
#include "idl/names.hpp"

namespace bregma::arm {
namespace {

using namespace std::chrono_literals;

constexpr std::int64_t kMotionPeriod_ns = 50'000'000; // of RobotMotionState
constexpr std::int64_t kSilence_ns = 200'000'000;     // of the arm, which sends every 8 ms

} // namespace

void ArmDriver::declare(base::ParameterSet &parameters) {
  parameters.string("address", &address_, "Of the arm: tcp://HOST:PORT")
      .string("serial_number", &serial_number_, "Of the arm; others are not used. Empty: any simulated arm")
      .string("tool", &tool_, "Mounted on the flange, with the name that the case gives it; empty: not stated")
      .number("period_ms", &period_ms_, "ms", 1.0, 1000.0, "Time between the arm's measurements")
      .number("sigma_mm", &sigma_mm_, "mm", 0.0, 10.0, "Of the flange's stated position, 1 sigma; 0: not stated")
      .number("sigma_mrad", &sigma_mrad_, "mrad", 0.0, 100.0, "Of its orientation, 1 sigma; 0: not stated")
      .number("max_speed_mm_s", &max_speed_mm_s_, "mm/s", 1.0, 250.0, "Faster motions are refused")
      .number("daemon_silence_s", &daemon_silence_s_, "s", 0.5, 5.0, "A daemon that is not heard for longer is lost");
}

base::Result<void> ArmDriver::prepare(const driver::Settings &settings) {
  MotionOptions options;
  options.max_speed_mm_s = max_speed_mm_s_;
  options.daemon_silence_ns = std::llround(daemon_silence_s_ * 1e9);
  control_.emplace(settings.device, options);
  wire::Name name{};
  if (!tool_.empty() && !wire::set_name(name, tool_)) {
    return base::failure("tool = " + tool_ + ": the name is too long");
  }
  return driver::check_address("address", address_);
}

driver::Outcome<void> ArmDriver::connect(driver::Io &io) {
  lines_.reset();
  arm_.reset();
  joints_.reset();
  // Commands that came meanwhile are answered now, and not carried out when the arm is there again. A stop is latched.
  take_wire(io);
  (void)control_->take_lines();
  if (auto passed = pass_on(io); !passed) {
    return passed;
  }
  if (auto opened = stream_.open(address_, io); !opened) {
    return opened;
  }
  io_ = &io;
  heard_ns_ = io.now_ns();
  next_motion_ns_ = 0;
  return {};
}

void ArmDriver::disconnect() noexcept {
  if (io_ != nullptr) {
    try { // the arm's own watchdog remains where this does not arrive
      if (io_->stopping()) {
        control_->end();
        (void)pass_on(*io_);
      }
      control_->disconnected();
      (void)pass_on(*io_);
    } catch (...) { // NOLINT(bugprone-empty-catch): out of memory; nothing is left to do
    }
    io_ = nullptr;
  }
  stream_.close();
}

driver::Outcome<driver::Progress> ArmDriver::read(driver::Io &io) {
  const auto bytes = stream_.read(io, 5ms);
  if (!bytes) {
    return tl::unexpected(bytes.error());
  }
  driver::Outcome<void> outcome;
  const std::size_t too_long = lines_.take(*bytes, [&](std::string_view line) {
    const auto message = parse_from_arm(line);
    if (!message) {
      io.skipped(1, message.error());
    } else if (outcome) {
      heard_ns_ = io.now_ns();
      outcome = take_message(*message, io);
    }
  });
  if (too_long > 0) {
    io.skipped(too_long, "line too long");
  }
  if (!outcome) {
    return tl::unexpected(outcome.error());
  }
  if (io.now_ns() - heard_ns_ > kSilence_ns) {
    return driver::retry_later(address_ + ": the arm is silent");
  }
  take_wire(io);
  control_->step(io.now_ns());
  if (auto passed = pass_on(io); !passed) {
    return tl::unexpected(passed.error());
  }
  publish_motion(io);
  return driver::Progress::kContinue;
}

driver::Outcome<void> ArmDriver::take_message(const FromArm &message, driver::Io &io) {
  if (const auto *identity = std::get_if<Identity>(&message)) {
    const bool expected = serial_number_.empty() ? identity->simulated : identity->serial == serial_number_;
    if (!expected || (arm_ && *arm_ != *identity)) {
      return driver::retry_later(address_ + ": arm " + identity->name + " " + identity->serial +
                                 " is not used: a person must check it and set serial_number = " + identity->serial);
    }
    if (!arm_) {
      arm_ = *identity;
      control_->connected(*identity);
    }
    return {};
  }
  if (!arm_) {
    return {}; // an arm that has not stated what it is
  }
  if (const auto *state = std::get_if<OperatingState>(&message)) {
    control_->take(*state);
  } else if (const auto *setpoint = std::get_if<SetpointJs>(&message)) {
    control_->take(*setpoint);
  } else if (const auto *answer = std::get_if<Answer>(&message)) {
    control_->take(*answer);
  } else if (const auto *joints = std::get_if<MeasuredJs>(&message)) {
    joints_ = *joints;
  } else if (const auto *pose = std::get_if<MeasuredCp>(&message)) {
    publish_state(*pose, io);
  }
  return {};
}

void ArmDriver::take_wire(driver::Io &io) {
  const std::int64_t now_ns = io.now_ns();
  // What ends a motion comes before what continues it.
  io.take<wire::SystemHealth>([&](const wire::SystemHealth &sample) { control_->take(sample, now_ns); });
  io.take<wire::RegistrationState>([&](const wire::RegistrationState &sample) { control_->take(sample, now_ns); });
  io.take<wire::RobotPermit>([&](const wire::RobotPermit &sample) { control_->take(sample, now_ns); });
  io.take<wire::RobotPath>([&](const wire::RobotPath &sample) { control_->take(sample, now_ns); });
  io.take<wire::Command>([&](const wire::Command &sample) { control_->take(sample, now_ns); });
  io.take<wire::RobotDeadman>([&](const wire::RobotDeadman &sample) { control_->take(sample, now_ns); });
}

driver::Outcome<void> ArmDriver::pass_on(driver::Io &io) {
  for (const wire::CommandReply &reply : control_->take_replies()) {
    (void)io.publish(reply);
  }
  const std::string lines = control_->take_lines();
  return lines.empty() ? driver::Outcome<void>() : stream_.write(lines, io, 100ms);
}

void ArmDriver::publish_state(const MeasuredCp &pose, driver::Io &io) const {
  if (!joints_ || joints_->frame != pose.frame) {
    io.skipped(1, "measured_cp without its measured_js");
    return;
  }
  wire::RobotState out{};
  out.frame = pose.frame;
  out.device_time_ns = static_cast<std::int64_t>(pose.time_us) * 1'000;
  out.period_ns = std::llround(period_ms_ * 1e6);
  out.mode = control_->mode();
  out.joint_count = kAxes;
  std::copy(joints_->position_rad.begin(), joints_->position_rad.end(), out.joint_position_rad);
  std::copy(joints_->velocity_rad_s.begin(), joints_->velocity_rad_s.end(), out.joint_velocity_rad_s);
  std::copy(joints_->effort_Nm.begin(), joints_->effort_Nm.end(), out.joint_effort_Nm);
  std::copy(pose.T_base_flange.translation_mm.begin(), pose.T_base_flange.translation_mm.end(),
            out.T_base_flange.translation_mm);
  std::copy(pose.T_base_flange.rotation_wxyz.begin(), pose.T_base_flange.rotation_wxyz.end(),
            out.T_base_flange.rotation_wxyz);
  put_covariance(pose.T_base_flange, out.covariance);
  (void)wire::set_name(out.tool, tool_); // its length was checked
  (void)wire::set_name(out.motion_client, control_->motion_client());
  out.motion_id = control_->motion_id();
  (void)io.publish(out);
}

// Independent errors of position and orientation of the flange, stated about the origin of its base: a turn about the
// flange displaces the points there by the lever.
void ArmDriver::put_covariance(const LinePose &T_base_flange, wire::PoseCovariance &out) const {
  const double turn = 1e-6 * sigma_mrad_ * sigma_mrad_;
  const Eigen::Matrix3d lever = geometry::skew(Eigen::Vector3d::Map(T_base_flange.translation_mm.data()));
  geometry::Matrix6d covariance = geometry::Matrix6d::Zero();
  covariance.topLeftCorner<3, 3>() = turn * Eigen::Matrix3d::Identity();
  covariance.topRightCorner<3, 3>() = turn * lever.transpose();
  covariance.bottomRightCorner<3, 3>() =
      sigma_mm_ * sigma_mm_ * Eigen::Matrix3d::Identity() + turn * lever * lever.transpose();
  for (std::size_t row = 0; row < 6; ++row) {
    for (std::size_t column = row; column < 6; ++column) {
      const double entry = covariance(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column));
      out[wire::upper_index(row, column)] = static_cast<float>(entry);
    }
  }
}

void ArmDriver::publish_motion(driver::Io &io) {
  const std::int64_t now_ns = io.now_ns();
  if (!arm_ || now_ns < next_motion_ns_) {
    return;
  }
  next_motion_ns_ = now_ns + kMotionPeriod_ns;
  wire::RobotMotionState out = control_->state(now_ns);
  out.frame = ++motion_frame_;
  out.device_time_ns = now_ns; // the driver's own judgement, by its own clock
  out.period_ns = kMotionPeriod_ns;
  (void)io.publish(out);
}

} // namespace bregma::arm
