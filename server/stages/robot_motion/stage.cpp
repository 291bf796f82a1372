#include "server/stages/robot_motion/stage.hpp"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <exception>
#include <utility>

#include "algorithms/geometry/angles.hpp"
#include "idl/names.hpp"
#include "server/stages/robot_motion/guide_plan.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

namespace {

// The driver answers at once, or when the arm has not accepted the path within two seconds.
constexpr std::int64_t kReplyWait_ns = 3'000'000'000;
constexpr std::size_t kMaxArrived = 64;
// Between the joints that a path begins with, and the measured ones when it is sent.
constexpr double kMaxMoved_rad = 0.01;

constexpr std::int64_t kSilentDriver_ns = 5'000'000'000; // the motion's end is not stated any more
constexpr std::int64_t kRest_ns = 500'000'000;           // the joints come to rest, and the filter of the tip
constexpr double kMaxOff_rad = 1.5 * geometry::kRadiansPerDegree;

// Held until the next motion.
constexpr AlarmConditions::Kind kOffPlan{alarm::kGuideOffPlan, bregma_wire_SEVERITY_WARNING, SessionEffect::kNone, 0,
                                         0};

bool same_command(const wire::Command &command, const wire::CommandReply &reply) {
  return command.id == reply.id && command.kind == reply.kind && same(command.client, reply.client);
}

} // namespace

void declare(base::ParameterSet &set, RobotMotionParameters &p) {
  set.number("motion.rate_hz", &p.rate_hz, "Hz", 20, 200,
             "Rate of the stage that plans motions of an arm, passes commands on to its driver, and permits motions "
             "beside a tracker.");
  set.number("motion.min_distance_mm", &p.min_distance_mm, "mm", 1, 200,
             "A planned motion keeps arm, tool and sensors at this distance from head and table.");
  set.number("motion.max_patient_mm", &p.max_patient_mm, "mm", 0.5, 20,
             "Beside a tracker a motion stops when a corner of the head's box has moved by more since it was planned.");
  set.number("motion.max_off_mm", &p.max_off_mm, "mm", 0.1, 20,
             "A guide that is shown farther from its place at the end of a motion raises the alarm guide_off_plan.");
}

RobotMotionStage::RobotMotionStage(const RobotMotionParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = parameters.rate_hz, .long_work = true}),
      parameters_(parameters), host_(context.host), replies_(context.link), commands_(context.link),
      paths_(context.link), permits_(context.link), alarms_(conditions) {
  arrived_.reserve(kMaxArrived);
}

void RobotMotionStage::connect(RobotMotionInbox &commands, CaseStore &cases,
                               const runtime::LatestValue<RobotsView> &robots,
                               const runtime::LatestValue<TrackingView> &tracking,
                               const runtime::LatestValue<RegistrationEstimate> &registration,
                               const runtime::LatestValue<ReferenceView> &reference) {
  inbox_ = &commands;
  lease_.connect(cases);
  robots_.connect(robots);
  tracking_.connect(tracking);
  registration_.connect(registration);
  reference_.connect(reference);
}

void RobotMotionStage::step(const Moment &now) noexcept {
  if (const auto change = lease_.newer()) {
    case_ = change->loaded != nullptr ? change->loaded->data.get() : nullptr;
    lease_.take(*change);
    patient_.reset();
    alarms_.forget(alarm::kGuideOffPlan, now.utc_ns);
    if (watched_ && watched_->problem.empty()) {
      watched_->problem = "the case was closed";
    }
  }
  refresh();
  if (watched_ && watched_->began_ns == 0) {
    watched_->began_ns = now.utc_ns;
  }
  for (Waiting &waiting : waiting_) {
    waiting.deadline_ns = waiting.deadline_ns != 0 ? waiting.deadline_ns : now.utc_ns + kReplyWait_ns;
  }
  arrived_.clear();
  inbox_->take_each([this](const wire::Command &command) {
    if (arrived_.size() < arrived_.capacity()) { // otherwise the session answers by its time-out
      arrived_.push_back(command);
    }
  });
  try {
    for (const wire::Command &command : arrived_) {
      if (command.kind == bregma_wire_COMMAND_MOVE_TO_TRAJECTORY) {
        move(command, now);
      } else {
        waiting_.push_back({command});
      }
    }
    take_replies(now.utc_ns); // after the inbox: a reply finds its command
    give_up(now.utc_ns);
    refresh();
    watch(now);
  } catch (const std::exception &error) { // out of memory: the session answers by its time-out
    host_.log(LogLevel::kError, std::string("motion of an arm: ") + error.what());
  }
}

void RobotMotionStage::refresh() noexcept {
  (void)robots_.refresh();
  (void)tracking_.refresh();
  (void)registration_.refresh();
  const casefile::HandEyeModel *hand_eye = case_ != nullptr ? case_->hand_eye() : nullptr;
  if (!reference_.refresh() || hand_eye == nullptr) {
    return;
  }
  const ReferenceView &reference = reference_.value();
  const std::int64_t before_ns = reference_ns_;
  if (!reference.trusted) {
    patient_.reset();
  } else if (reference.visible && reference.acquired_ns != before_ns) {
    reference_ns_ = reference.acquired_ns;
    if (reference.acquired_ns - before_ns > reference.limit_ns) {
      patient_.reset(); // it was hidden for longer than a motion may go on
    }
    const std::int64_t frames =
        (reference.acquired_ns - before_ns + reference.period_ns / 2) / std::max<std::int64_t>(reference.period_ns, 1);
    patient_.add(hand_eye->T_base_tracker.pose * wire::from_wire<geometry::frame::Tracker, geometry::frame::Reference>(
                                                     reference.T_tracker_reference),
                 static_cast<int>(std::clamp<std::int64_t>(frames, 1, PatientPlace::kSettled)));
  }
}

// The permit goes on until the driver states that the motion has ended, withdrawn or not.
void RobotMotionStage::watch(const Moment &now) {
  if (!watched_) {
    return;
  }
  Watched &watched = *watched_;
  const RobotView *robot = robot_named(watched.command.body._u.motion.device);
  const bool stated =
      robot != nullptr && robot->motion_id == watched.command.id && same(robot->motion_client, watched.command.client);
  const bool begun = watched.began_ns != 0; // not in the step that has planned it, whose time may be seconds ago
  const std::int64_t heard_ns = std::max(watched.began_ns, robot != nullptr ? robot->motion_ns : 0);
  if (stated && robot->phase == bregma_wire_MOTION_DONE) {
    watched.done_ns = watched.done_ns != 0 ? watched.done_ns : now.utc_ns;
    if (now.utc_ns - watched.done_ns >= kRest_ns) {
      judge_end(now.utc_ns);
      watched_.reset();
    }
    return;
  }
  const bool moves = !stated || robot->phase == bregma_wire_MOTION_WAITS ||
                     robot->phase == bregma_wire_MOTION_UNDER_WAY || robot->phase == bregma_wire_MOTION_UNKNOWN;
  const bool forgotten =
      stated ? now.utc_ns - heard_ns > kSilentDriver_ns : now.utc_ns - watched.began_ns > kReplyWait_ns;
  if (!moves || (begun && forgotten)) {
    watched_.reset();
    return;
  }
  if (watched.permit) {
    if (watched.problem.empty()) {
      watched.problem = guide_problem(watched.guide, patient_, reference_.value(), tracking_.value(), now.utc_ns);
      if (!watched.problem.empty()) {
        host_.log(LogLevel::kWarning,
                  "motion of " + wire::text(watched.command.body._u.motion.device) + " is stopped: " + watched.problem);
      }
    }
    send_permit(now.utc_ns);
  }
}

void RobotMotionStage::send_permit(std::int64_t now_ns) {
  Watched &watched = *watched_;
  wire::RobotPermit out{};
  copy_name(out.device, watched.command.body._u.motion.device);
  copy_name(out.client, watched.command.client);
  out.motion_id = watched.command.id;
  out.run_id = host_.run_id();
  out.frame = ++watched.frame;
  out.sent_time_ns = now_ns;
  out.permitted = watched.problem.empty();
  wire::set_text(out.text, watched.problem);
  permits_(out, now_ns);
}

void RobotMotionStage::judge_end(std::int64_t now_ns) {
  const GuideEnd end = guide_end(watched_->guide, tracking_.value());
  const bool off = end.live && !(end.off_mm <= parameters_.max_off_mm && end.angle_rad <= kMaxOff_rad);
  char text[256];
  if (end.live) {
    std::snprintf(text, sizeof text, "%s is %.1f mm and %.1f degrees from its place on %s (its error: %.1f mm, 95 %%)",
                  watched_->guide.tool.c_str(), end.off_mm, end.angle_rad / geometry::kRadiansPerDegree,
                  watched_->guide.trajectory.c_str(), end.tre_95_mm);
  } else {
    std::snprintf(text, sizeof text, "%s is not live at the end of its motion: its place on %s is not known",
                  watched_->guide.tool.c_str(), watched_->guide.trajectory.c_str());
  }
  host_.log(end.live && !off ? LogLevel::kInfo : LogLevel::kWarning, text);
  alarms_.update(kOffPlan, wire::view(watched_->command.body._u.motion.device), off || !end.live, text, now_ns);
}

void RobotMotionStage::move(const wire::Command &command, const Moment &now) {
  const auto &body = command.body._u.motion;
  if (watched_ && watched_->permit && watched_->done_ns == 0) { // planning would delay its permit
    answer(command, bregma_wire_COMMAND_REFUSED, "a motion is under way");
    return;
  }
  watched_.reset();
  const RobotView *robot = robot_named(body.device);
  planning::GuideMoveOptions options;
  options.check.min_distance_mm = parameters_.min_distance_mm;
  const GuidePlanInputs inputs{
      case_, robot, &tracking_.value(), &registration_.value(), &reference_.value(), &patient_, parameters_.arm};
  auto plan = plan_guide(inputs, wire::view(body.trajectory), body.standoff_mm, options, now.utc_ns);
  if (!plan) {
    answer(command, bregma_wire_COMMAND_REFUSED, plan.error().message);
    return;
  }
  // What may have changed while the path was planned. The driver checks the session and the registration again.
  if (robots_.refresh()) {
    const RobotView *newest = robot_named(body.device);
    if (newest == nullptr ||
        !((robot::JointAngles(newest->joint_position_rad) - plan->start).cwiseAbs().maxCoeff() <= kMaxMoved_rad)) {
      answer(command, bregma_wire_COMMAND_REFUSED, "the arm has moved while its path was planned");
      return;
    }
  }
  wire::RobotPath path{};
  copy_name(path.device, body.device);
  copy_name(path.client, command.client);
  path.motion_id = command.id;
  path.sent_time_ns = now.utc_ns;
  path.speed_mm_s = body.speed_mm_s;
  path.waypoint_count = static_cast<std::uint32_t>(plan->move.waypoints.size());
  std::transform(plan->move.waypoints.begin(), plan->move.waypoints.end(), path.T_base_flange,
                 [](const robot::FlangePose &pose) { return wire::to_wire(pose); });
  path.needs_registration = true;
  path.run_id = host_.run_id();
  path.accepted_revision = plan->accepted_revision;
  path.needs_permit = plan->guide.T_base_reference.has_value();
  host_.log(LogLevel::kInfo, "motion of " + wire::text(body.device) + ": " + plan->text);
  paths_(path, now.utc_ns);
  wire::Command out = command;
  copy_name(out.receiver, body.device);
  commands_(out, now.utc_ns);
  waiting_.push_back({command});
  plan->guide.max_patient_mm = parameters_.max_patient_mm;
  watched_ = Watched{command, std::move(plan->guide), path.needs_permit, {}, 0, 0, 0};
  alarms_.update(kOffPlan, wire::view(body.device), false, "", now.utc_ns);
}

void RobotMotionStage::take_replies(std::int64_t now_ns) {
  replies_.take_each(now_ns, [this](const wire::CommandReply &reply, std::uint64_t /*writer*/) {
    const auto found = std::find_if(waiting_.begin(), waiting_.end(),
                                    [&](const Waiting &waiting) { return same_command(waiting.command, reply); });
    if (found == waiting_.end()) {
      return false;
    }
    if (watched_ && reply.result != bregma_wire_COMMAND_DONE && same_command(watched_->command, reply)) {
      watched_.reset(); // refused by the driver: nothing moves
    }
    answer(found->command, reply.result, std::string(reply.text, strnlen(reply.text, sizeof reply.text)), true);
    waiting_.erase(found);
    return true;
  });
}

void RobotMotionStage::give_up(std::int64_t now_ns) {
  std::erase_if(waiting_, [&](const Waiting &waiting) {
    if (waiting.deadline_ns == 0 || now_ns < waiting.deadline_ns) {
      return false;
    }
    answer(waiting.command, bregma_wire_COMMAND_REFUSED,
           "the arm's driver has not answered: is it running, and has the device this name?");
    return true;
  });
}

void RobotMotionStage::answer(const wire::Command &command, wire::CommandResult result, const std::string &text,
                              bool by_device) {
  StageAnswer out{};
  copy_name(out.client, command.client);
  out.id = command.id;
  out.sent_time_ns = command.sent_time_ns;
  out.kind = command.kind;
  out.result = result;
  wire::set_text(out.text, text);
  out.by_device = by_device;
  (void)answers.try_push(out); // a full ring: the session answers by its time-out
}

const RobotView *RobotMotionStage::robot_named(const wire::Name &device) const {
  const RobotsView &robots = robots_.value();
  const auto *end = robots.robots + robots.count;
  const auto *found =
      std::find_if(robots.robots, end, [&](const RobotView &robot) { return same(robot.device, device); });
  return found != end ? found : nullptr;
}

} // namespace bregma::server
