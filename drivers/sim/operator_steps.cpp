#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "drivers/sim/operator.hpp"
#include "drivers/sim/typed_command.hpp"
#include "idl/commands.hpp"
#include "idl/names.hpp"

namespace bregma::sim {

namespace {

constexpr double kTouchSpeed_mm_s = 110.0; // speed onto the skin and off it
constexpr double kFarOut_mm = 60.0;        // above the start of an insertion
constexpr double kStandoff_mm = 20.0;      // height of the probe's tip above the entry during the alignment

std::string reply_text(const wire::CommandReply &reply) {
  return {reply.text, strnlen(reply.text, sizeof(reply.text))};
}

} // namespace

Operator::Action Operator::call(std::function<void()> what) const { return {std::move(what), nullptr}; }

Operator::Action Operator::move(std::size_t tool, std::function<std::unique_ptr<Movement>()> plan) {
  return {[this, tool, plan = std::move(plan)] { hands_.start(tool, plan(), now_ns_); },
          [this, tool] { return hands_.still(tool, now_ns_); }};
}

Operator::Action Operator::reach(std::size_t tool, const HandPose &to) {
  return move(tool, [this, tool, to] { return planning_.reach(hands_.meant(tool, now_ns_), to); });
}

Operator::Action Operator::wait(double seconds) {
  return {nullptr, [this, seconds] { return since_action_s() >= seconds; }};
}

// A refused command leaves the hand where it is: the person repeats it.
Operator::Action Operator::await(wire::CommandKind kind, const std::vector<std::string> &values) {
  return {[this, kind, text = typed_command(kind, values)] {
            reply_.reset();
            awaited_ = kind;
            tell(StepEvent::Kind::kNote, "now: " + text);
          },
          [this] { return reply_.has_value(); }};
}

Operator::Action Operator::ask(wire::CommandKind kind, std::vector<std::string> values) {
  if (parameters_.hands_only) {
    return await(kind, values);
  }
  const auto say = [this, kind, values = std::move(values)] {
    wire::Command command{};
    (void)wire::set_name(command.client, kOperatorClient);
    command.id = ++last_command_;
    command.sent_time_ns = now_ns_;
    const std::vector<std::string_view> views(values.begin(), values.end());
    if (const std::string wrong = wire::fill_command(command, kind, views); !wrong.empty()) {
      fail(wrong);
      return;
    }
    reply_.reset();
    out_->commands.push_back(command);
  };
  const auto answered = [this] {
    if (!reply_ && since_action_s() > parameters_.reply_timeout_s) {
      fail("no reply to the command within " + std::to_string(std::lround(parameters_.reply_timeout_s)) + " s");
    }
    return reply_.has_value();
  };
  return {say, answered};
}

Operator::Action Operator::judge() {
  return call([this] {
    const std::string text = reply_text(*reply_);
    if (reply_->result == bregma_wire_COMMAND_DONE) {
      tell(StepEvent::Kind::kNote, text);
    } else {
      fail(text);
    }
  });
}

Operator::Actions Operator::actions_of(const Step &step) {
  switch (step.kind) {
  case StepKind::kLoadCase:
    return {ask(bregma_wire_COMMAND_LOAD_CASE, {case_->folder.string()}), judge()};
  case StepKind::kPivot:
    return pivot(step);
  case StepKind::kTouchFiducials:
  case StepKind::kCheckLandmarks:
    return touches(step);
  case StepKind::kTraceScalp:
    return trace(step);
  case StepKind::kFollowTrajectory:
    return follow(step);
  case StepKind::kWait:
    return {wait(step.duration_s)};
  case StepKind::kStartNavigation:
    return {ask(bregma_wire_COMMAND_START_NAVIGATION, {step.tool, step.trajectory}), judge()};
  case StepKind::kStartRegistration:
    return {ask(bregma_wire_COMMAND_START_REGISTRATION), judge()};
  case StepKind::kAcceptRegistration:
    return {ask(bregma_wire_COMMAND_ACCEPT_REGISTRATION), judge()};
  case StepKind::kConfirmVerification:
    return {ask(bregma_wire_COMMAND_CONFIRM_VERIFICATION), judge()};
  case StepKind::kStopNavigation:
    return {ask(bregma_wire_COMMAND_STOP_NAVIGATION), judge()};
  case StepKind::kCloseCase:
    return {ask(bregma_wire_COMMAND_CLOSE_CASE), judge()};
  }
  return {};
}

// There is only one hand: it first returns a held tool to its stand.
Operator::Actions Operator::take(std::size_t tool) {
  Actions out;
  if (held_ && *held_ != tool) {
    out.push_back(reach(*held_, hands_.stand(*held_)));
  }
  held_ = tool;
  return out;
}

Operator::Actions Operator::pivot(const Step &step) {
  const std::size_t tool = index_of(step.tool);
  const HandPose rest = planning_.in_dimple(true_tool(tool));
  const Vector3d shaft = rest.rotation * true_tool(tool).model.axis.normalized();
  const Vector3d line_of_sight = (patient_->camera_mm() - rest.tip_mm).normalized();
  const Vector3d across = (line_of_sight - line_of_sight.dot(shaft) * shaft).normalized();
  // Large rotation about the line of sight, which hides no marker; smaller towards the camera and about the shaft.
  const std::array<Swing::Amplitude, 3> amplitudes{
      {{across, 0.65, 0.53}, {shaft.cross(across).normalized(), 0.52, 0.37}, {shaft, 0.25, 0.23}}};
  Actions out = take(tool);
  out.push_back(reach(tool, rest));
  out.push_back(wait(parameters_.settle_s));
  out.push_back(ask(bregma_wire_COMMAND_START_PIVOT, {step.tool}));
  out.push_back(judge());
  out.push_back(move(tool, [rest, amplitudes, duration = step.duration_s] {
    return std::make_unique<Swing>(rest, amplitudes, duration);
  }));
  out.push_back(ask(bregma_wire_COMMAND_FINISH_PIVOT, {step.tool}));
  out.push_back(judge());
  return out;
}

Operator::Actions Operator::touches(const Step &step) {
  const bool fiducials = step.kind == StepKind::kTouchFiducials;
  const auto &points = fiducials ? patient_->fiducials : patient_->landmarks;
  const std::size_t tool = index_of(step.tool);
  Actions out = take(tool);
  for (const auto &point : points) {
    const bool named = std::find(step.points.begin(), step.points.end(), point.name) != step.points.end();
    if (step.points.empty() || named) {
      const double sigma = parameters_.touch_error_scale * case_->limits.fle_touch_mm;
      const auto kind = fiducials ? bregma_wire_COMMAND_CAPTURE_FIDUCIAL : bregma_wire_COMMAND_CHECK_TOUCH;
      const Touch first{tool, kind, point.name, point.position_mm, sigma, 1};
      out.push_back(call([this, first] { now_do(touch(first)); }));
    }
  }
  return out;
}

// The placement error is drawn once per touch: the tip rests at the touched point.
Operator::Actions Operator::touch(const Touch &touch) {
  const Vector3d aimed = touch.position_mm + placing_.normal3(touch.sigma_mm);
  const Vector3d normal = patient_->head.skin(touch.position_mm).normal;
  const HandPose contact = planning_.grip(true_tool(touch.tool), aimed, normal);
  const HandPose off = planning_.stand_off(contact, normal);
  return {reach(touch.tool, off),
          move(touch.tool, [off, contact] { return std::make_unique<Reach>(off, contact, kTouchSpeed_mm_s); }),
          wait(parameters_.settle_s),
          ask(touch.kind, {true_tool(touch.tool).model.name, touch.point}),
          move(touch.tool, [off, contact] { return std::make_unique<Reach>(contact, off, kTouchSpeed_mm_s); }),
          call([this, touch] { judge_touch(touch); })};
}

void Operator::judge_touch(const Touch &touch) {
  const std::string text = touch.point + ": " + reply_text(*reply_);
  if (reply_->result == bregma_wire_COMMAND_DONE) {
    tell(StepEvent::Kind::kNote, text);
  } else if (reply_->result == bregma_wire_COMMAND_REFUSED && touch.attempt < parameters_.attempts) {
    tell(StepEvent::Kind::kNote, text + "; once more");
    Touch again = touch;
    ++again.attempt;
    now_do(this->touch(again));
  } else {
    fail(text);
  }
}

Operator::Actions Operator::trace(const Step &step) {
  const std::size_t tool = index_of(step.tool);
  const auto path = planning_.scalp_path(true_tool(tool), step.length_mm);
  const Vector3d first_normal = patient_->head.skin(path.front().tip_mm).normal;
  const Vector3d last_normal = patient_->head.skin(path.back().tip_mm).normal;
  const HandPose off = planning_.stand_off(path.front(), first_normal);
  Actions out = take(tool);
  out.push_back(reach(tool, off));
  out.push_back(move(tool, [off, on = path.front()] { return std::make_unique<Reach>(off, on, kTouchSpeed_mm_s); }));
  out.push_back(wait(parameters_.settle_s));
  out.push_back(ask(bregma_wire_COMMAND_START_TRACE, {step.tool}));
  out.push_back(judge());
  out.push_back(move(tool, [path, speed = step.speed_mm_s] { return std::make_unique<Glide>(path, speed); }));
  out.push_back(ask(bregma_wire_COMMAND_STOP_TRACE, {step.tool}));
  out.push_back(judge());
  out.push_back(reach(tool, planning_.stand_off(path.back(), last_normal)));
  return out;
}

Operator::Actions Operator::follow(const Step &step) {
  const std::size_t tool = index_of(step.tool);
  const auto *plan = case_->trajectory(step.trajectory);
  const Vector3d direction = (plan->target_mm - plan->entry_mm).normalized();
  const auto rotation = point_tool(true_tool(tool).model, direction, patient_->camera_mm() - plan->entry_mm);
  const HandPose over{plan->entry_mm - (kStandoff_mm + kFarOut_mm) * direction, rotation, 1.0, 1.0};
  const GuidedInsertion insertion({plan->entry_mm, plan->target_mm, step.speed_mm_s, step.duration_s, kStandoff_mm},
                                  rotation, parameters_, placing_.normal3(robot_parameters_.placement_error_mm));

  Actions out = take(tool);
  out.push_back(call([this, plan, direction, misplaced = insertion.correction_mm()] {
    const Vector3d foot = plan->entry_mm - robot_parameters_.guide_distance_mm * direction;
    guide_ = arm_->looking(foot, direction);
    arm_->go({guide_.rotation(), foot + misplaced}, now_ns_);
  }));
  out.push_back(reach(tool, over));
  out.push_back({nullptr, [this] { return arm_->arrived(now_ns_); }});
  out.push_back(
      move(tool, [over, start = insertion.pose(0)] { return std::make_unique<Reach>(over, start, kTouchSpeed_mm_s); }));
  out.push_back(guide(tool, insertion));
  return out;
}

Operator::Action Operator::guide(std::size_t tool, const GuidedInsertion &insertion) {
  const auto begin = [this, tool, insertion] {
    insertion_ = insertion;
    inserted_ = tool;
  };
  const auto done = [this, tool, name = steps_[step_].name] {
    insertion_->advance(now_ns_);
    arm_->shift_goal({guide_.rotation(), guide_.translation() + insertion_->correction_mm()});
    label_ = insertion_->phase() == GuidedInsertion::Phase::kHold ? name + ":hold" : name;
    const bool over = insertion_->phase() == GuidedInsertion::Phase::kDone;
    const bool lost = insertion_->waited_s() > parameters_.give_up_s;
    if (over || lost) {
      const std::string why = insertion_->why_waiting();
      hands_.hold(tool, insertion_->pose(now_ns_));
      insertion_.reset();
      if (lost) {
        fail(why);
      }
    }
    return over || lost;
  };
  return {begin, done};
}

// Back along the shaft until the tip is off the head.
Operator::Actions Operator::retreat(std::size_t tool) {
  return {move(tool, [this, tool] {
    const HandPose from = hands_.meant(tool, now_ns_);
    const double missing = parameters_.standoff_mm - patient_->head.clearance_mm(from.tip_mm);
    HandPose to = from;
    to.tip_mm -= std::max(0.0, missing) * (from.rotation * true_tool(tool).model.axis.normalized());
    to.position_freedom = to.rotation_freedom = 1.0;
    return std::make_unique<Reach>(from, to, kTouchSpeed_mm_s);
  })};
}

} // namespace bregma::sim
