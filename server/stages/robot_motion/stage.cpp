#include "server/stages/robot_motion/stage.hpp"

#include <algorithm>
#include <cstring>
#include <exception>

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

bool same_command(const wire::Command &command, const wire::CommandReply &reply) {
  return command.id == reply.id && command.kind == reply.kind && same(command.client, reply.client);
}

} // namespace

void declare(base::ParameterSet &set, RobotMotionParameters &p) {
  set.number("motion.rate_hz", &p.rate_hz, "Hz", 1, 200,
             "Rate of the stage that plans motions of an arm and passes commands on to its driver.");
  set.number("motion.min_distance_mm", &p.min_distance_mm, "mm", 1, 200,
             "A planned motion keeps arm, tool and sensors at this distance from head and table.");
}

RobotMotionStage::RobotMotionStage(const RobotMotionParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = parameters.rate_hz, .long_work = true}),
      min_distance_mm_(parameters.min_distance_mm), host_(context.host), replies_(context.link),
      commands_(context.link), paths_(context.link) {
  arrived_.reserve(kMaxArrived);
}

void RobotMotionStage::connect(RobotMotionInbox &commands, CaseStore &cases,
                               const runtime::LatestValue<RobotsView> &robots,
                               const runtime::LatestValue<TrackingView> &tracking,
                               const runtime::LatestValue<wire::RegistrationState> &registration) {
  inbox_ = &commands;
  lease_.connect(cases);
  robots_.connect(robots);
  tracking_.connect(tracking);
  registration_.connect(registration);
}

void RobotMotionStage::step(const Moment &now) noexcept {
  if (const auto change = lease_.newer()) {
    case_ = change->loaded != nullptr ? change->loaded->data.get() : nullptr;
    lease_.take(*change);
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
  } catch (const std::exception &error) { // out of memory: the session answers by its time-out
    host_.log(LogLevel::kError, std::string("motion of an arm: ") + error.what());
  }
}

void RobotMotionStage::move(const wire::Command &command, const Moment &now) {
  const auto &body = command.body._u.motion;
  (void)robots_.refresh();
  (void)tracking_.refresh();
  (void)registration_.refresh();
  const RobotView *robot = robot_named(body.device);
  planning::GuideMoveOptions options;
  options.check.min_distance_mm = min_distance_mm_;
  const GuidePlanInputs inputs{case_, robot, &tracking_.value(), &registration_.value()};
  const auto plan = plan_guide(inputs, wire::view(body.trajectory), body.standoff_mm, options, now.utc_ns);
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
  host_.log(LogLevel::kInfo, "motion of " + wire::text(body.device) + ": " + plan->text);
  paths_(path, now.utc_ns);
  wire::Command out = command;
  copy_name(out.receiver, body.device);
  commands_(out, now.utc_ns);
  waiting_.push_back({command});
}

void RobotMotionStage::take_replies(std::int64_t now_ns) {
  replies_.take_each(now_ns, [this](const wire::CommandReply &reply, std::uint64_t /*writer*/) {
    const auto found = std::find_if(waiting_.begin(), waiting_.end(),
                                    [&](const Waiting &waiting) { return same_command(waiting.command, reply); });
    if (found == waiting_.end()) {
      return false;
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
