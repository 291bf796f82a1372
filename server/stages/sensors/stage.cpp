#include "server/stages/sensors/stage.hpp"

#include <algorithm>
#include <iterator>

#include "server/inputs/device_names.hpp"
#include "server/stages/host.hpp"
#include "server/stages/host_clock.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {
namespace {

constexpr double kShareRate_hz = 10.0;                // rate of device health for monitoring and the health topic
constexpr std::int64_t kLongestStep_ns = 100'000'000; // between two frames of which a velocity is taken

// An arm is one device with two streams. RobotState states whether it is live; what is refused is counted of both.
void add_motions(inputs::StreamHealth &robots, const inputs::StreamHealth &motions) noexcept {
  for (std::uint32_t i = 0; i < std::min(robots.device_count, motions.device_count); ++i) {
    wire::DeviceHealth &robot = robots.devices[i];
    const wire::DeviceHealth &motion = motions.devices[i];
    for (std::size_t reason = 0; reason < std::size(robot.rejected); ++reason) {
      robot.rejected[reason] += motion.rejected[reason];
    }
    robot.other_writer += motion.other_writer;
  }
  robots.unknown_device_samples += motions.unknown_device_samples;
  robots.unknown_devices.add(motions.unknown_devices);
}

// Of the frame in the view and the next one.
void put_velocity(RobotView &view, const wire::Pose &next, std::int64_t next_acquired_ns) noexcept {
  using geometry::frame::RobotBase;
  using geometry::frame::RobotFlange;
  const std::int64_t step_ns = next_acquired_ns - view.acquired_ns;
  view.velocity_known = view.acquired_ns != 0 && step_ns > 0 && step_ns <= kLongestStep_ns;
  if (!view.velocity_known) {
    return;
  }
  const auto moved = wire::from_wire<RobotBase, RobotFlange>(next) *
                     wire::from_wire<RobotBase, RobotFlange>(view.T_base_flange).inverse();
  const double per_s = 1e9 / static_cast<double>(step_ns);
  Vector3d::Map(view.velocity_per_s) = per_s * geometry::rotation_log(moved.rotation());
  Vector3d::Map(view.velocity_per_s + 3) = per_s * moved.translation();
}

// Whether an arm has measured anything anew.
bool differs(const wire::RobotState &a, const wire::RobotState &b) noexcept {
  return a.joint_count != b.joint_count || !std::ranges::equal(a.joint_position_rad, b.joint_position_rad) ||
         !std::ranges::equal(a.joint_velocity_rad_s, b.joint_velocity_rad_s) ||
         !std::ranges::equal(a.joint_effort_Nm, b.joint_effort_Nm) ||
         !std::ranges::equal(a.T_base_flange.rotation_wxyz, b.T_base_flange.rotation_wxyz) ||
         !std::ranges::equal(a.T_base_flange.translation_mm, b.T_base_flange.translation_mm);
}

} // namespace

void declare(base::ParameterSet &set, SensorParameters &p) {
  set.string("devices.robots", &p.robots, "Names of the robots, separated by commas.");
  set.string("devices.forces", &p.forces, "Names of the force sensors, separated by commas.");
  set.string("devices.ranges", &p.ranges, "Names of the range sensors, separated by commas.");
}

SensorStage::SensorStage(const SensorParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kFifo, .rate_hz = kShareRate_hz, .triggered = true}),
      robot_guard_(inputs::split_names(parameters.robots), {}),
      motion_guard_(inputs::split_names(parameters.robots), {}),
      range_guard_(inputs::split_names(parameters.ranges), {}),
      force_guard_(inputs::split_names(parameters.forces), {}), robots_(context.link), motions_(context.link),
      ranges_(context.link), forces_(context.link), boot_id_(context.host.boot_id()) {
  for (const inputs::DeviceMonitor &robot : robot_guard_.devices()) {
    if (robots_view_.count < kMaxRobots) {
      copy_name(robots_view_.robots[robots_view_.count++].device, robot.name());
    }
  }
}

std::uint32_t SensorStage::Origin::take(std::uint64_t new_writer, std::uint64_t new_frame) noexcept {
  incarnation += seen && (new_writer != writer || new_frame < frame) ? 1 : 0;
  seen = true;
  writer = new_writer;
  frame = new_frame;
  return incarnation;
}

void SensorStage::take_range(const wire::RangeSample &sample, const inputs::Verdict &verdict,
                             std::uint64_t writer) noexcept {
  const auto device = static_cast<std::size_t>(verdict.device);
  if (device >= range_origins_.size()) {
    return;
  }
  RangeReading out;
  copy_name(out.device, sample.device);
  out.frame = sample.frame;
  out.acquired_ns = verdict.acquired_time_ns;
  out.period_ns = verdict.period_ns;
  out.incarnation = range_origins_[device].take(writer, sample.frame);
  const bool valid = sample.status == bregma_wire_RANGE_VALID;
  out.range_mm = valid ? sample.range_mm : wire::kUnknown;
  out.sigma_mm = valid ? sample.sigma_mm : wire::kUnknown;
  (void)readings.try_push(out); // a full ring counts dropped values
}

void SensorStage::pass_on(const wire::RobotState &sample, const inputs::Verdict &verdict,
                          std::uint64_t writer) noexcept {
  Arm &arm = arms_[static_cast<std::size_t>(verdict.device)];
  FlangeSample out;
  copy_name(out.device, sample.device);
  copy_name(out.tool, sample.tool);
  out.frame = sample.frame;
  out.acquired_ns = verdict.acquired_time_ns;
  out.age_sigma_ns = verdict.age_sigma_ns;
  out.period_ns = verdict.period_ns;
  out.written_ns = verdict.written_time_ns;
  out.measured_anew = !arm.origin.seen || differs(sample, arm.last);
  out.incarnation = arm.origin.take(writer, sample.frame);
  out.T_base_flange = sample.T_base_flange;
  std::copy(std::begin(sample.covariance), std::end(sample.covariance), out.covariance);
  arm.last = sample;
  (void)flanges_to_navigation.try_push(out);
  (void)flanges_to_scan.try_push(out);
}

void SensorStage::take_robot(const wire::RobotState &sample, const inputs::Verdict &verdict) noexcept {
  if (static_cast<std::uint32_t>(verdict.device) >= robots_view_.count) {
    return;
  }
  RobotView &view = robots_view_.robots[verdict.device];
  copy_name(view.tool, sample.tool);
  view.frame = sample.frame;
  put_velocity(view, sample.T_base_flange, verdict.acquired_time_ns);
  view.acquired_ns = verdict.acquired_time_ns;
  view.period_ns = verdict.period_ns;
  view.lost = false;
  view.mode = sample.mode;
  view.joint_count = sample.joint_count;
  std::copy(std::begin(sample.joint_position_rad), std::end(sample.joint_position_rad), view.joint_position_rad);
  view.T_base_flange = sample.T_base_flange;
  std::copy(std::begin(sample.covariance), std::end(sample.covariance), view.covariance);
  robots.store(robots_view_);
}

void SensorStage::take_motion(const wire::RobotMotionState &sample, const inputs::Verdict &verdict) noexcept {
  if (static_cast<std::uint32_t>(verdict.device) >= robots_view_.count) {
    return;
  }
  RobotView &view = robots_view_.robots[verdict.device];
  view.motion_ns = verdict.acquired_time_ns;
  view.takes_permits = sample.takes_permits;
  view.phase = sample.phase;
  copy_name(view.motion_client, sample.motion_client);
  view.motion_id = sample.motion_id;
  robots.store(robots_view_);
}

void SensorStage::watch_robots(const Moment &now) noexcept {
  bool changed = robots.count() == 0;
  for (std::uint32_t i = 0; i < robots_view_.count; ++i) {
    RobotView &view = robots_view_.robots[i];
    const bool lost = view.acquired_ns != 0 && robot_guard_.devices()[i].status(now.utc_ns) == bregma_wire_DEVICE_LOST;
    changed = changed || lost != view.lost;
    view.lost = lost;
  }
  if (changed) {
    robots.store(robots_view_);
  }
}

void SensorStage::step(const Moment &now) noexcept {
  const inputs::HostClock host = host_clock(now, boot_id_);
  robot_guard_.set_host(host);
  motion_guard_.set_host(host);
  range_guard_.set_host(host);
  force_guard_.set_host(host);
  std::size_t taken = robots_.take_each(now.utc_ns, [&](const wire::RobotState &sample, std::uint64_t writer) noexcept {
    const inputs::Verdict verdict = robot_guard_.check(sample, writer, now.utc_ns);
    if (verdict.accepted) {
      take_robot(sample, verdict);
      if (static_cast<std::size_t>(verdict.device) < arms_.size()) {
        pass_on(sample, verdict, writer);
      }
    }
  });
  taken += motions_.take_each(now.utc_ns, [&](const wire::RobotMotionState &sample, std::uint64_t writer) noexcept {
    const inputs::Verdict verdict = motion_guard_.check(sample, writer, now.utc_ns);
    if (verdict.accepted) {
      take_motion(sample, verdict);
    }
  });
  taken += ranges_.take_each(now.utc_ns, [&](const wire::RangeSample &sample, std::uint64_t writer) noexcept {
    if (const inputs::Verdict verdict = range_guard_.check(sample, writer, now.utc_ns); verdict.accepted) {
      take_range(sample, verdict, writer);
    }
  });
  taken += forces_.take_each(now.utc_ns, [&](const wire::ForceSample &sample, std::uint64_t writer) noexcept {
    const inputs::Verdict verdict = force_guard_.check(sample, writer, now.utc_ns);
    if (verdict.accepted) {
      ForceView view{.acquired_ns = verdict.acquired_time_ns};
      std::copy_n(sample.force_N, 3, view.force_N);
      force.store(view);
    }
  });
  if (taken == 0 || now.tick) {
    robot_guard_.set_writers_alive(robots_.writers_alive());
    motion_guard_.set_writers_alive(motions_.writers_alive());
    range_guard_.set_writers_alive(ranges_.writers_alive());
    force_guard_.set_writers_alive(forces_.writers_alive());
  }
  watch_robots(now);
  if (now.tick) {
    inputs::StreamHealth health = robot_guard_.health(now.utc_ns);
    add_motions(health, motion_guard_.health(now.utc_ns));
    inputs::add_to(health, range_guard_.health(now.utc_ns));
    inputs::add_to(health, force_guard_.health(now.utc_ns));
    devices.store(health);
  }
}

} // namespace bregma::server
