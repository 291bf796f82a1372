#include "drivers/sim/arm/simulated_arm.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <type_traits>
#include <utility>
#include <variant>

namespace bregma::sim {
namespace {

constexpr double kTick_s = 1e-9 * static_cast<double>(SimulatedArm::kTick_ns);
constexpr std::int64_t kMaxBacklog_ns = 1'000'000'000;
constexpr double kCheckStep_mm = 2.0;
constexpr double kAtRest_rad = 1e-6;

robot::FlangePose flange_of(const arm::LinePose &pose) {
  const auto &q = pose.rotation_wxyz;
  const auto &t = pose.translation_mm;
  return {Eigen::Quaterniond(q[0], q[1], q[2], q[3]), robot::Vector3d(t[0], t[1], t[2])};
}

arm::LinePose line_pose(const robot::FlangePose &pose) {
  const Eigen::Quaterniond &q = pose.rotation();
  const robot::Vector3d &t = pose.translation();
  return {{t.x(), t.y(), t.z()}, {q.w(), q.x(), q.y(), q.z()}};
}

arm::Axes axes_of(const robot::JointAngles &joints) {
  arm::Axes out{};
  std::copy_n(joints.data(), out.size(), out.begin());
  return out;
}

} // namespace

robot::ArmModel with_link_errors(const robot::ArmModel &nominal, double sigma_mm, double sigma_rad,
                                 std::uint64_t seed) {
  Random random(seed, "arm links");
  std::array<robot::JointAxis, robot::kJoints> axes = nominal.axes_at_zero();
  for (robot::JointAxis &axis : axes) {
    axis.direction = (axis.direction + random.normal3(sigma_rad)).normalized();
    axis.point_mm += random.normal3(sigma_mm);
  }
  return {nominal.name(), axes, nominal.limits(), nominal.flange_at_zero()};
}

SimulatedArm::SimulatedArm(const robot::ArmModel &nominal, const robot::ArmModel &actual, ArmSettings settings)
    : inverse_(nominal), actual_(actual), settings_(std::move(settings)), setpoint_(settings_.start),
      joints_(settings_.start) {}

std::string SimulatedArm::connect() {
  lines_.reset();
  motion_ = 0; // the numbers of a connection begin anew
  planned_.reset();
  tell_state_ = true;
  return arm::line_of(arm::FromArm(arm::Identity{arm::line_text(inverse_.model().name()), settings_.serial, true}));
}

void SimulatedArm::disconnect() {
  planned_.reset();
  if (path_) {
    fault(arm::FaultReason::kLink);
  }
}

std::string SimulatedArm::receive(std::string_view bytes, std::int64_t now_ns) {
  std::string out;
  (void)lines_.take(bytes, [&](std::string_view line) {
    const auto message = arm::parse_to_arm(line);
    if (!message) {
      return; // what it cannot read it ignores: the sender misses the answer
    }
    if (const auto *motion = std::get_if<arm::Alive>(&*message)) {
      alive(motion->motion, now_ns);
      return;
    }
    const auto *order = std::get_if<arm::Order>(&*message);
    if (order != nullptr && order->kind == arm::Order::Kind::kIdentity) {
      out += arm::line_of(arm::FromArm(arm::Identity{arm::line_text(inverse_.model().name()), settings_.serial, true}));
    }
    const arm::Answer answer = order != nullptr ? execute(*order) : execute(std::get<arm::MoveCp>(*message));
    out += arm::line_of(arm::FromArm(answer));
  });
  return out;
}

arm::Answer SimulatedArm::execute(const arm::Order &order) {
  arm::Answer out{order.number, true, ""};
  const auto refuse = [&](const char *text) {
    out.ok = false;
    out.text = text;
  };
  switch (order.kind) {
  case arm::Order::Kind::kEnable:
    if (state_ == arm::ArmState::kFault) {
      refuse("a stop is latched");
    } else {
      state_ = arm::ArmState::kEnabled;
    }
    break;
  case arm::Order::Kind::kDisable:
    if (path_) {
      refuse("the arm moves");
    } else if (state_ != arm::ArmState::kFault) {
      state_ = arm::ArmState::kDisabled;
    }
    break;
  case arm::Order::Kind::kHold:
    planned_.reset();
    ramps_down_ = path_.has_value();
    break;
  case arm::Order::Kind::kStop:
    fault(arm::FaultReason::kStop);
    break;
  case arm::Order::Kind::kReset:
    if (emergency_) {
      refuse("the emergency stop is pressed");
    } else if (moving()) {
      refuse("the arm has not come to rest");
    } else if (state_ == arm::ArmState::kFault) {
      state_ = arm::ArmState::kDisabled;
      reason_ = arm::FaultReason::kNone;
    }
    break;
  case arm::Order::Kind::kIdentity:
    break;
  }
  tell_state_ = true;
  return out;
}

arm::Answer SimulatedArm::execute(const arm::MoveCp &move) {
  const auto refuse = [&](std::string_view text) {
    planned_.reset();
    return arm::Answer{move.number, false, arm::line_text(text)};
  };
  if (led_) {
    return refuse("the arm is led by hand");
  }
  if (state_ != arm::ArmState::kEnabled || path_) {
    return refuse(path_ ? "the arm moves" : "the arm is not enabled");
  }
  if (move.index == 0) {
    if (move.motion <= motion_) {
      return refuse("the number of the motion is not new");
    }
    if (move.speed_mm_s > settings_.max_speed_mm_s) {
      return refuse("the speed is above the arm's");
    }
    motion_ = move.motion;
    expected_ = 0;
    commanded_mm_s_ = move.speed_mm_s;
    planned_.emplace(inverse_.model().forward(setpoint_));
  }
  if (!planned_ || move.motion != motion_ || move.index != expected_) {
    return refuse("a waypoint is missing");
  }
  planned_->add(flange_of(move.T_base_flange));
  ++expected_;
  if (move.index + 1 < move.count) {
    return {move.number, true, ""};
  }
  if (const std::string problem = problem_of(*planned_, commanded_mm_s_); !problem.empty()) {
    return refuse(problem);
  }
  path_ = std::exchange(planned_, std::nullopt);
  at_mm_ = 0.0;
  waypoint_ = 0;
  started_ = ramps_down_ = false;
  tell_state_ = true;
  return {move.number, true, ""};
}

std::string SimulatedArm::problem_of(const robot::StraightPath &path, double speed_mm_s) const {
  robot::JointAngles last = setpoint_;
  const auto steps = static_cast<int>(std::ceil(path.length_mm() / kCheckStep_mm));
  const double step_mm = path.length_mm() / std::max(1, steps);
  for (int i = 1; i <= steps; ++i) {
    const auto solution = inverse_.nearest(path.pose(i * step_mm), last);
    const auto where = [&] { return " at " + std::to_string(std::lround(i * step_mm)) + " mm of the path"; };
    if (!solution) {
      return "out of reach or beyond a joint limit" + where();
    }
    const robot::JointAngles change = (solution->joints - last).cwiseAbs();
    Eigen::Index joint = 0;
    if (change.maxCoeff(&joint) * speed_mm_s / step_mm > settings_.max_joint_rad_s) {
      return "joint " + std::to_string(joint + 1) + " is too slow for this speed" + where();
    }
    last = solution->joints;
  }
  return {};
}

void SimulatedArm::alive(std::uint32_t motion, std::int64_t now_ns) {
  if (path_ && motion == motion_) {
    started_ = true;
    alive_ns_ = now_ns;
  }
}

std::string SimulatedArm::lead(const std::vector<robot::FlangePose> &way, double speed_mm_s) {
  if (path_ || planned_) {
    return "a motion is under way";
  }
  if (state_ == arm::ArmState::kFault) {
    return "a stop is latched";
  }
  robot::StraightPath path(inverse_.model().forward(setpoint_));
  for (const robot::FlangePose &pose : way) {
    path.add(pose);
  }
  if (std::string problem = problem_of(path, speed_mm_s); !problem.empty()) {
    return problem;
  }
  led_ = std::move(path);
  led_mm_ = 0.0;
  led_mm_s_ = speed_mm_s;
  return {};
}

void SimulatedArm::follow_the_hand() {
  if (state_ == arm::ArmState::kFault) { // the brakes are on
    led_.reset();
    return;
  }
  led_mm_ = std::min(led_mm_ + led_mm_s_ * kTick_s, led_->length_mm());
  if (const auto solution = inverse_.nearest(led_->pose(led_mm_), setpoint_)) {
    setpoint_ = joints_ = solution->joints;
  }
  if (led_mm_ >= led_->length_mm()) {
    led_.reset();
  }
}

void SimulatedArm::press_emergency() {
  emergency_ = true;
  fault(arm::FaultReason::kEmergency);
}

void SimulatedArm::fault(arm::FaultReason reason) {
  if (state_ != arm::ArmState::kFault) {
    state_ = arm::ArmState::kFault;
    reason_ = reason;
    tell_state_ = true;
  }
  planned_.reset();
  ramps_down_ = true;
}

void SimulatedArm::end_motion() {
  path_.reset();
  speed_mm_s_ = 0.0;
  started_ = false;
  tell_state_ = true;
}

void SimulatedArm::drive() {
  if (!path_) {
    return;
  }
  const bool stopping = state_ == arm::ArmState::kFault;
  if (!started_) { // it has not been permitted to move yet
    if (ramps_down_) {
      end_motion();
    }
    return;
  }
  if (!ramps_down_ && now_ns_ - alive_ns_ > arm::kAlive_ns) {
    fault(arm::FaultReason::kWatchdog);
    return drive();
  }
  // Trapezoid up to the end of the segment, in discrete steps: the speed from which the rest is enough to brake.
  const double rest_mm = path_->segment_end_mm(at_mm_) - at_mm_;
  const double brake = settings_.acceleration_mm_s2;
  double wanted_mm_s = std::min(commanded_mm_s_, speed_mm_s_ + brake * kTick_s);
  wanted_mm_s = std::min(wanted_mm_s, std::sqrt(2.0 * brake * rest_mm));
  if (ramps_down_) {
    wanted_mm_s = std::min(wanted_mm_s, speed_mm_s_ - (stopping ? settings_.stop_mm_s2 : brake) * kTick_s);
  }
  if (wanted_mm_s <= 0.0 && ramps_down_) {
    return end_motion();
  }
  speed_mm_s_ = wanted_mm_s;
  at_mm_ = std::min(at_mm_ + speed_mm_s_ * kTick_s, path_->segment_end_mm(at_mm_));
  if (rest_mm - speed_mm_s_ * kTick_s < 1e-3) { // the corner is reached
    at_mm_ = path_->segment_end_mm(at_mm_ - 1e-9);
    speed_mm_s_ = 0.0;
  }
  const auto solution = inverse_.nearest(path_->pose(at_mm_), setpoint_);
  if (!solution || (solution->joints - setpoint_).cwiseAbs().maxCoeff() > settings_.max_joint_rad_s * kTick_s * 1.5) {
    fault(arm::FaultReason::kLimit); // the setpoint stays where it is
    return end_motion();
  }
  setpoint_ = solution->joints;
  waypoint_ = static_cast<std::uint32_t>(path_->leads_to(at_mm_));
  if (at_mm_ >= path_->length_mm() - 1e-6) {
    ++motions_done_;
    waypoint_ = static_cast<std::uint32_t>(path_->waypoints());
    end_motion();
  }
}

void SimulatedArm::tick() {
  drive();
  const robot::JointAngles before = joints_;
  if (led_) {
    follow_the_hand();
  }
  joints_ += (setpoint_ - joints_) * (1.0 - std::exp(-kTick_s / settings_.follow_s));
  if (following_rad() < kAtRest_rad) {
    joints_ = setpoint_;
  }
  velocity_ = (joints_ - before) / kTick_s;
  if (following_rad() > settings_.max_following_rad) {
    fault(arm::FaultReason::kFollowing);
  }
}

std::string SimulatedArm::advance(std::int64_t now_ns) {
  if (now_ns_ == 0 || now_ns - now_ns_ > kMaxBacklog_ns) {
    now_ns_ = now_ns - kTick_ns;
  }
  std::string out;
  while (now_ns_ + kTick_ns <= now_ns) {
    now_ns_ += kTick_ns;
    tick();
    out += telemetry();
  }
  return out;
}

double SimulatedArm::stop_mm() const {
  if (!moving()) {
    return 0.0;
  }
  const robot::Vector3d behind =
      inverse_.model().forward(setpoint_).translation() - inverse_.model().forward(joints_).translation();
  // A tick passes before the ramp begins. The joints' way to the setpoint is not quite straight.
  return speed_mm_s_ * speed_mm_s_ / (2.0 * settings_.stop_mm_s2) + 2.0 * speed_mm_s_ * kTick_s + 1.05 * behind.norm() +
         0.05;
}

arm::OperatingState SimulatedArm::operating_state() const {
  arm::OperatingState out;
  out.frame = ticks_;
  out.time_us = static_cast<std::uint64_t>(now_ns_ / 1'000);
  out.state = state_;
  out.is_homed = true;
  out.is_busy = path_.has_value() || moving();
  out.motion = motion_;
  out.waypoint = waypoint_;
  out.stop_mm = stop_mm();
  out.reason = reason_;
  return out;
}

robot::JointAngles SimulatedArm::measured() {
  robot::JointAngles out = joints_;
  for (double &joint : out) {
    joint += encoders_.normal(settings_.encoder_rad);
  }
  return out;
}

std::string SimulatedArm::telemetry() {
  ++ticks_;
  const auto time_us = static_cast<std::uint64_t>(now_ns_ / 1'000);
  std::string out;
  if (ticks_ % kTicksPerMeasurement == 0) {
    const robot::JointAngles joints = measured();
    const std::uint64_t number = ticks_ / kTicksPerMeasurement; // no gaps: the daemon counts them as losses
    out += arm::line_of(arm::FromArm(arm::MeasuredJs{number, time_us, axes_of(joints), axes_of(velocity_), {}}));
    out += arm::line_of(arm::FromArm(arm::MeasuredCp{number, time_us, line_pose(inverse_.model().forward(joints))}));
  }
  if (std::exchange(tell_state_, false) || ticks_ % kTicksPerState == 0) {
    out += arm::line_of(arm::FromArm(operating_state()));
    out += arm::line_of(arm::FromArm(arm::SetpointJs{ticks_, time_us, axes_of(setpoint_)}));
  }
  return out;
}

} // namespace bregma::sim
