#include "drivers/arm/motion_control.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <span>
#include <utility>

#include "drivers/arm/stop_text.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"

namespace bregma::arm {
namespace {

constexpr double kMaxPosition_mm = 20'000.0;

bool is_pose(const wire::Pose &pose) {
  double squares = 0.0;
  for (const double q : pose.rotation_wxyz) {
    squares += q * q;
  }
  return std::abs(std::sqrt(squares) - 1.0) <= 1e-3 && // false for NaN
         std::all_of(std::begin(pose.translation_mm), std::end(pose.translation_mm),
                     [](double t) { return std::abs(t) <= kMaxPosition_mm; });
}

LinePose line_pose_of(const wire::Pose &pose) {
  LinePose out;
  std::copy(std::begin(pose.translation_mm), std::end(pose.translation_mm), out.translation_mm.begin());
  std::copy(std::begin(pose.rotation_wxyz), std::end(pose.rotation_wxyz), out.rotation_wxyz.begin());
  return out;
}

bool is_motion(wire::CommandKind kind) {
  return kind == bregma_wire_COMMAND_START_SURFACE_SCAN || kind == bregma_wire_COMMAND_MOVE_TO_TRAJECTORY;
}

double speed_of(const wire::Command &command) {
  return command.kind == bregma_wire_COMMAND_START_SURFACE_SCAN ? command.body._u.scan.speed_mm_s
                                                                : command.body._u.motion.speed_mm_s;
}

} // namespace

MotionControl::MotionControl(std::string device, const MotionOptions &options)
    : device_(std::move(device)), options_(options) {}

// --- the arm's side

void MotionControl::connected(const Identity &identity) {
  lines_.clear(); // what was meant for the last connection
  arm_ = identity;
  arm_state_.reset();
  setpoint_.reset();
  next_motion_ = 1;
  if (cause_ != bregma_wire_STOP_NONE) {
    (void)send(Order::Kind::kStop); // the latch holds on both sides
  }
}

void MotionControl::end() {
  if (active()) {
    stop(bregma_wire_STOP_DRIVER_ENDED, describe(bregma_wire_STOP_DRIVER_ENDED));
  }
}

void MotionControl::disconnected() {
  if (active()) {
    stop(bregma_wire_STOP_LINK, describe(bregma_wire_STOP_LINK));
  }
  if (resetting_) {
    reply(*std::exchange(resetting_, std::nullopt), bregma_wire_COMMAND_REFUSED, "the connection to the arm is lost");
  }
  arm_.reset();
  arm_state_.reset();
  lines_.clear();
}

void MotionControl::take(const OperatingState &state) {
  arm_state_ = state;
  if (state.state == ArmState::kFault && cause_ == bregma_wire_STOP_NONE) {
    wire::RobotStopCause cause = bregma_wire_STOP_ARM_FAULT;
    if (state.reason == FaultReason::kEmergency) {
      cause = bregma_wire_STOP_EMERGENCY;
    } else if (state.reason == FaultReason::kWatchdog) {
      cause = bregma_wire_STOP_DEADMAN_LOST;
    } else if (state.reason == FaultReason::kLink) {
      cause = bregma_wire_STOP_LINK;
    }
    stop(cause, describe(cause));
    return;
  }
  const bool of_motion = motion_ && motion_->accepted && state.motion == motion_->number;
  if (phase_ == bregma_wire_MOTION_UNDER_WAY && of_motion && !state.is_busy) {
    const bool arrived = state.waypoint >= motion_->path.waypoint_count;
    phase_ = arrived ? bregma_wire_MOTION_DONE : bregma_wire_MOTION_HELD;
    text_ = arrived ? "the arm is at the end of the path" : "the arm has ended the motion";
  }
}

void MotionControl::take(const SetpointJs &setpoint) { setpoint_ = setpoint; }

void MotionControl::take(const Answer &answer) {
  if (resetting_ && answer.number == reset_number_) {
    if (answer.ok) {
      cause_ = bregma_wire_STOP_NONE;
      phase_ = bregma_wire_MOTION_NONE;
      text_.clear();
      arm_state_.reset(); // an older FAULT is no new stop
    }
    reply(*std::exchange(resetting_, std::nullopt), answer.ok ? bregma_wire_COMMAND_DONE : bregma_wire_COMMAND_REFUSED,
          answer.ok ? "the stop is reset" : "the arm refuses: " + answer.text);
    return;
  }
  if (phase_ != bregma_wire_MOTION_WAITS || !motion_ || !motion_->has_path) {
    return;
  }
  if (!answer.ok) {
    drop("the arm refuses: " + answer.text);
  } else if (answer.number == motion_->last_answer) {
    motion_->accepted = true;
    reply(motion_->command, bregma_wire_COMMAND_DONE, "the arm has the path; it moves while the deadman is held");
  }
}

// --- the wire's side

void MotionControl::take(const wire::Command &command, std::int64_t now_ns) {
  if (wire::view(command.receiver) != device_) {
    return;
  }
  // A stop is carried out before anything about it is checked.
  if (command.kind == bregma_wire_COMMAND_STOP_ROBOT) {
    stop(bregma_wire_STOP_COMMAND, describe(bregma_wire_STOP_COMMAND));
    reply(command, bregma_wire_COMMAND_DONE, "the stop is latched");
    return;
  }
  if (const std::string wrong = wire::malformed(command); !wrong.empty()) {
    reply(command,
          wire::find_command(command.kind) == nullptr ? bregma_wire_COMMAND_UNSUPPORTED : bregma_wire_COMMAND_MALFORMED,
          wrong);
  } else if (is_motion(command.kind)) {
    begin(command, now_ns);
  } else if (command.kind == bregma_wire_COMMAND_HOLD_ROBOT || command.kind == bregma_wire_COMMAND_STOP_SURFACE_SCAN) {
    hold(command, "held by command");
  } else if (command.kind == bregma_wire_COMMAND_RESET_ROBOT) {
    reset(command);
  } else {
    reply(command, bregma_wire_COMMAND_UNSUPPORTED, "an arm cannot do this");
  }
}

void MotionControl::begin(const wire::Command &command, std::int64_t now_ns) {
  if (const std::string text = refusal(command, now_ns); !text.empty()) {
    reply(command, bregma_wire_COMMAND_REFUSED, text);
    return;
  }
  motion_.emplace();
  motion_->command = command;
  motion_->began_ns = now_ns;
  motion_->run_id = run_id_;
  phase_ = bregma_wire_MOTION_WAITS;
  text_ = "waits for the path";
  if (waiting_path_ && now_ns - path_ns_ <= options_.path_wait_ns) {
    take(*std::exchange(waiting_path_, std::nullopt), now_ns);
  }
}

std::string MotionControl::refusal(const wire::Command &command, std::int64_t now_ns) const {
  if (!arm_ || !arm_state_) {
    return "the arm is not connected";
  }
  if (!arm_->simulated) {
    return "only simulated arms are moved: " + arm_->name + " " + arm_->serial + " is not one";
  }
  if (cause_ != bregma_wire_STOP_NONE || arm_state_->state == ArmState::kFault) {
    return "a stop is latched: reset it first";
  }
  if (active() || arm_state_->is_busy) {
    return "a motion is under way";
  }
  if (wire::view(command.client).empty() || !wire::is_terminated(command.client)) {
    return "the command states no client";
  }
  const double speed_mm_s = speed_of(command);
  if (!(speed_mm_s > 0.0) || speed_mm_s > options_.max_speed_mm_s) {
    return "speed_mm_s = " + std::to_string(speed_mm_s) + ": must be above 0 and at most " +
           std::to_string(options_.max_speed_mm_s);
  }
  if (!daemon_heard(now_ns)) {
    return "no daemon is heard";
  }
  if (command.kind == bregma_wire_COMMAND_MOVE_TO_TRAJECTORY && !verified()) {
    return "the registration is not verified";
  }
  return {};
}

void MotionControl::take(const wire::RobotPath &path, std::int64_t now_ns) {
  if (wire::view(path.device) != device_) {
    return;
  }
  const bool awaited = phase_ == bregma_wire_MOTION_WAITS && motion_ && !motion_->has_path &&
                       wire::view(path.client) == wire::view(motion_->command.client) &&
                       path.motion_id == motion_->command.id;
  if (!awaited) { // its command may follow
    waiting_path_ = path;
    path_ns_ = now_ns;
    return;
  }
  if (const std::string problem = path_problem(path); !problem.empty()) {
    ++refused_;
    drop(problem);
    return;
  }
  motion_->path = path;
  motion_->has_path = true;
  motion_->needs_registration =
      path.needs_registration || motion_->command.kind == bregma_wire_COMMAND_MOVE_TO_TRAJECTORY;
  motion_->revision = path.accepted_revision;
  send_path();
}

std::string MotionControl::path_problem(const wire::RobotPath &path) const {
  if (!wire::is_terminated(path.client) || path.waypoint_count == 0 ||
      path.waypoint_count > bregma_wire_MAX_WAYPOINTS || !(path.speed_mm_s > 0.0) || !std::isfinite(path.speed_mm_s)) {
    return "the path is malformed";
  }
  const std::span waypoints(path.T_base_flange, path.waypoint_count);
  const auto wrong = std::find_if_not(waypoints.begin(), waypoints.end(), is_pose);
  if (wrong != waypoints.end()) {
    return "waypoint " + std::to_string(wrong - waypoints.begin() + 1) + " of the path is not a pose";
  }
  if (path.run_id != 0 && path.run_id != run_id_) {
    return "the path was made with another daemon";
  }
  const bool needs = path.needs_registration || motion_->command.kind == bregma_wire_COMMAND_MOVE_TO_TRAJECTORY;
  if (needs && (path.run_id == 0 || path.accepted_revision == 0 || path.accepted_revision != accepted_revision_)) {
    return "the path was not made with the accepted registration";
  }
  if (needs && !verified()) {
    return "the registration is not verified";
  }
  return {};
}

void MotionControl::send_path() {
  CommandedMotion &motion = *motion_;
  text_ = "waits for the arm";
  if (arm_state_->state != ArmState::kEnabled) {
    (void)send(Order::Kind::kEnable);
  }
  motion.number = next_motion_++;
  MoveCp move;
  move.motion = motion.number;
  move.count = motion.path.waypoint_count;
  move.speed_mm_s = std::min(motion.path.speed_mm_s, speed_of(motion.command));
  for (move.index = 0; move.index < move.count; ++move.index) {
    move.number = motion.last_answer = next_number_++;
    move.T_base_flange = line_pose_of(motion.path.T_base_flange[move.index]);
    lines_ += line_of(ToArm(move));
  }
}

void MotionControl::take(const wire::RobotPermit &permit, std::int64_t now_ns) {
  if (wire::view(permit.device) != device_ || !active() || !motion_->has_path || !motion_->path.needs_permit) {
    return;
  }
  CommandedMotion &motion = *motion_;
  if (!wire::is_terminated(permit.client) || wire::view(permit.client) != wire::view(motion.command.client) ||
      permit.motion_id != motion.command.id || permit.run_id != motion.run_id ||
      (motion.permit_ns != 0 && permit.frame <= motion.permit_frame)) {
    ++refused_; // for another motion, of another daemon, or an old one
    return;
  }
  if (!permit.permitted) {
    const std::string text = "stopped: " + std::string(permit.text, strnlen(permit.text, sizeof permit.text));
    if (phase_ == bregma_wire_MOTION_UNDER_WAY) {
      stop(bregma_wire_STOP_PERMIT_WITHDRAWN, text);
    } else {
      drop(text);
    }
    return;
  }
  if (const auto cause = violated(now_ns); cause != bregma_wire_STOP_NONE) { // as for a deadman
    stop(cause, describe(cause));
    return;
  }
  motion.permit_frame = permit.frame;
  motion.permit_ns = now_ns;
}

void MotionControl::take(const wire::RobotDeadman &deadman, std::int64_t now_ns) {
  if (wire::view(deadman.device) != device_ || !active()) {
    return;
  }
  CommandedMotion &motion = *motion_;
  if (!wire::is_terminated(deadman.client) || wire::view(deadman.client) != wire::view(motion.command.client) ||
      deadman.motion_id != motion.command.id) {
    ++refused_; // a permission for another motion, or of another client
    return;
  }
  if (!deadman.held) {
    if (phase_ == bregma_wire_MOTION_UNDER_WAY) {
      stop(bregma_wire_STOP_DEADMAN_RELEASED, describe(bregma_wire_STOP_DEADMAN_RELEASED));
    }
    return;
  }
  if (motion.deadman_ns != 0 && deadman.frame <= motion.deadman_frame) {
    ++refused_; // an old one, or one that goes on without its operator
    return;
  }
  // A permission does not revive what has already run out: step() may be late.
  if (const auto cause = violated(now_ns); cause != bregma_wire_STOP_NONE) {
    stop(cause, describe(cause));
    return;
  }
  motion.deadman_frame = deadman.frame;
  motion.deadman_ns = now_ns;
  if (motion.accepted && permitted(now_ns)) {
    lines_ += line_of(ToArm(Alive{motion.number}));
    phase_ = bregma_wire_MOTION_UNDER_WAY;
    text_ = "moves";
  }
}

void MotionControl::take(const wire::SystemHealth &health, std::int64_t now_ns) {
  run_id_ = health.run_id;
  session_ = health.session;
  health_ns_ = now_ns;
  step(now_ns); // another daemon may follow before the next step
}

void MotionControl::take(const wire::RegistrationState &registration, std::int64_t now_ns) {
  accepted_revision_ = registration.ended ? 0 : registration.accepted_revision;
  step(now_ns);
}

// --- decisions

bool MotionControl::active() const {
  return phase_ == bregma_wire_MOTION_WAITS || phase_ == bregma_wire_MOTION_UNDER_WAY;
}

bool MotionControl::permitted(std::int64_t now_ns) const {
  return !motion_->path.needs_permit || (motion_->permit_ns != 0 && now_ns - motion_->permit_ns <= options_.permit_ns);
}

bool MotionControl::verified() const {
  return (session_ == bregma_wire_SESSION_VERIFIED || session_ == bregma_wire_SESSION_NAVIGATING) &&
         accepted_revision_ != 0;
}

bool MotionControl::daemon_heard(std::int64_t now_ns) const {
  return run_id_ != 0 && now_ns - health_ns_ <= options_.daemon_silence_ns;
}

wire::RobotStopCause MotionControl::violated(std::int64_t now_ns) const {
  const CommandedMotion &motion = *motion_;
  if (run_id_ != motion.run_id) {
    return bregma_wire_STOP_DAEMON_REPLACED;
  }
  if (!daemon_heard(now_ns)) {
    return bregma_wire_STOP_DAEMON_SILENT;
  }
  if (motion.needs_registration && !verified()) {
    return bregma_wire_STOP_NOT_VERIFIED;
  }
  if (motion.needs_registration && accepted_revision_ != motion.revision) {
    return bregma_wire_STOP_REGISTRATION_REPLACED;
  }
  if (phase_ == bregma_wire_MOTION_UNDER_WAY && now_ns - motion.deadman_ns > options_.deadman_ns) {
    return bregma_wire_STOP_DEADMAN_LOST;
  }
  if (phase_ == bregma_wire_MOTION_UNDER_WAY && !permitted(now_ns)) {
    return bregma_wire_STOP_PERMIT_LOST;
  }
  return bregma_wire_STOP_NONE;
}

void MotionControl::step(std::int64_t now_ns) {
  if (!active()) {
    return;
  }
  if (const auto cause = violated(now_ns); cause != bregma_wire_STOP_NONE) {
    if (phase_ == bregma_wire_MOTION_UNDER_WAY) {
      stop(cause, describe(cause));
    } else {
      drop(describe(cause));
    }
    return;
  }
  const std::int64_t waited_ns = now_ns - motion_->began_ns;
  if (phase_ == bregma_wire_MOTION_WAITS && !motion_->has_path && waited_ns > options_.path_wait_ns) {
    drop("no path for this motion has been received");
  } else if (phase_ == bregma_wire_MOTION_WAITS && waited_ns > options_.start_wait_ns) {
    drop(reason_to_give_up());
  }
}

std::string_view MotionControl::reason_to_give_up() const {
  if (!motion_->accepted) {
    return "the arm does not answer";
  }
  return motion_->deadman_ns == 0 ? "no deadman for this motion has been received"
                                  : "no permit of the daemon for this motion has been received";
}

void MotionControl::stop(wire::RobotStopCause cause, std::string_view text) {
  if (phase_ == bregma_wire_MOTION_WAITS && motion_ && !motion_->accepted) {
    reply(motion_->command, bregma_wire_COMMAND_REFUSED, text);
  }
  if (resetting_) {
    reply(*std::exchange(resetting_, std::nullopt), bregma_wire_COMMAND_REFUSED, text);
  }
  (void)send(Order::Kind::kStop);
  if (cause_ == bregma_wire_STOP_NONE) { // the first cause stays
    cause_ = cause;
    text_ = text;
  }
  phase_ = bregma_wire_MOTION_STOPPED;
}

void MotionControl::drop(std::string_view text) {
  if (!motion_->accepted) {
    reply(motion_->command, bregma_wire_COMMAND_REFUSED, text);
  }
  if (motion_->has_path) {
    (void)send(Order::Kind::kHold);
  }
  phase_ = bregma_wire_MOTION_HELD;
  text_ = text;
}

void MotionControl::hold(const wire::Command &command, std::string_view text) {
  if (active()) {
    if (phase_ == bregma_wire_MOTION_WAITS && !motion_->accepted) {
      reply(motion_->command, bregma_wire_COMMAND_REFUSED, text);
    }
    phase_ = bregma_wire_MOTION_HELD;
    text_ = text;
  }
  (void)send(Order::Kind::kHold);
  reply(command, bregma_wire_COMMAND_DONE, "the arm holds");
}

void MotionControl::reset(const wire::Command &command) {
  if (!arm_) {
    reply(command, bregma_wire_COMMAND_REFUSED, "the arm is not connected");
  } else if (resetting_) {
    reply(command, bregma_wire_COMMAND_REFUSED, "a reset is under way");
  } else if (active()) {
    reply(command, bregma_wire_COMMAND_REFUSED, "a motion is under way");
  } else {
    resetting_ = command;
    reset_number_ = send(Order::Kind::kReset);
  }
}

std::uint32_t MotionControl::send(Order::Kind kind) {
  lines_ += line_of(ToArm(Order{kind, next_number_}));
  return next_number_++;
}

void MotionControl::reply(const wire::Command &command, wire::CommandResult result, std::string_view text) {
  replies_.push_back(wire::reply_to(command, result, text, session_));
}

// --- results

std::string MotionControl::take_lines() { return std::exchange(lines_, {}); }

std::vector<wire::CommandReply> MotionControl::take_replies() { return std::exchange(replies_, {}); }

wire::RobotMode MotionControl::mode() const {
  if (!arm_state_) {
    return bregma_wire_ROBOT_UNKNOWN;
  }
  switch (arm_state_->state) {
  case ArmState::kDisabled:
    return bregma_wire_ROBOT_DISABLED;
  case ArmState::kEnabled:
    return bregma_wire_ROBOT_ENABLED;
  case ArmState::kPaused:
    return bregma_wire_ROBOT_PAUSED;
  case ArmState::kFault:
    break;
  }
  const bool fault = arm_state_->reason == FaultReason::kLimit || arm_state_->reason == FaultReason::kFollowing;
  return fault ? bregma_wire_ROBOT_FAULT : bregma_wire_ROBOT_STOPPED;
}

std::string_view MotionControl::motion_client() const {
  return motion_ && active() ? wire::view(motion_->command.client) : std::string_view();
}

std::uint64_t MotionControl::motion_id() const { return motion_ && active() ? motion_->command.id : 0; }

wire::RobotMotionState MotionControl::state(std::int64_t now_ns) const {
  wire::RobotMotionState out{};
  out.operating_state = mode();
  out.simulated = arm_ && arm_->simulated;
  out.phase = phase_;
  out.cause = cause_;
  out.takes_permits = true;
  out.deadman_age_ms = out.stop_distance_mm = wire::kUnknown;
  if (arm_state_) {
    out.is_homed = arm_state_->is_homed;
    out.is_busy = arm_state_->is_busy;
    out.stop_distance_mm = arm_state_->stop_mm;
  }
  if (motion_) {
    std::copy(std::begin(motion_->command.client), std::end(motion_->command.client), std::begin(out.motion_client));
    out.motion_id = motion_->command.id;
    out.waypoint_count = motion_->has_path ? motion_->path.waypoint_count : 0;
    const bool of_motion = arm_state_ && arm_state_->motion == motion_->number;
    out.waypoint = of_motion ? std::min(arm_state_->waypoint, out.waypoint_count) : 0;
    if (active() && motion_->deadman_ns != 0) {
      out.deadman_age_ms = 1e-6 * static_cast<double>(std::max<std::int64_t>(0, now_ns - motion_->deadman_ns));
    }
  }
  if (setpoint_) {
    out.joint_count = kAxes;
    std::copy(setpoint_->position_rad.begin(), setpoint_->position_rad.end(), out.setpoint_jp_rad);
  }
  wire::set_text(out.text, text_);
  return out;
}

} // namespace bregma::arm
