#include "drivers/sim/operator.hpp"

#include <algorithm>
#include <stdexcept>

#include "idl/names.hpp"

namespace bregma::sim {

namespace {

std::vector<HandPose> stands(const HandPlanning &planning, const Patient &patient) {
  std::vector<HandPose> out;
  for (const TrueTool &tool : patient.tools) {
    out.push_back(planning.in_stand(tool, out.size()));
  }
  return out;
}

bool needs_tool(StepKind kind) {
  return kind == StepKind::kPivot || kind == StepKind::kTouchFiducials || kind == StepKind::kTraceScalp ||
         kind == StepKind::kCheckLandmarks || kind == StepKind::kStartNavigation || kind == StepKind::kFollowTrajectory;
}

} // namespace

Operator::Operator(const casefile::Case &a_case, const Scenario &scenario, const Patient &patient, RobotArm &arm,
                   std::uint64_t seed)
    : case_(&a_case), parameters_(scenario.hand), robot_parameters_(scenario.robot), patient_(&patient), arm_(&arm),
      planning_(patient, scenario.hand), hands_(stands(planning_, patient), scenario.hand, patient, seed),
      placing_(seed, "placing"), steps_(scenario.steps) {
  for (const Step &step : steps_) {
    check(step);
  }
}

void Operator::check(const Step &step) const {
  const auto refuse = [this, &step](const std::string &what) {
    throw std::invalid_argument("step " + step.name + ": case " + case_->id + " has no " + what);
  };
  if (needs_tool(step.kind)) {
    const auto *tool = case_->tool(step.tool);
    if (tool == nullptr) {
      refuse("tool '" + step.tool + "'");
    } else if (tool->role == casefile::ToolRole::kReference) {
      throw std::invalid_argument("step " + step.name + ": '" + step.tool +
                                  "' is the reference, it stays in its clamp");
    }
  }
  const bool navigates =
      step.kind == StepKind::kFollowTrajectory || (step.kind == StepKind::kStartNavigation && !step.trajectory.empty());
  if (navigates && case_->trajectory(step.trajectory) == nullptr) {
    refuse("trajectory '" + step.trajectory + "'");
  }
  const bool fiducials = step.kind == StepKind::kTouchFiducials;
  for (const std::string &point : step.points) {
    if (fiducials && case_->fiducial(point) == nullptr) {
      refuse("fiducial '" + point + "'");
    }
    if (!fiducials && case_->landmark(point) == nullptr) {
      refuse("landmark '" + point + "'");
    }
  }
}

std::size_t Operator::index_of(const std::string &tool) const {
  const auto &tools = patient_->tools;
  const auto found =
      std::find_if(tools.begin(), tools.end(), [&tool](const TrueTool &known) { return known.model.name == tool; });
  return static_cast<std::size_t>(found - tools.begin());
}

void Operator::continue_with(std::vector<Step> steps) {
  for (Step &step : steps) {
    check(step);
    steps_.push_back(std::move(step));
  }
}

void Operator::on_reply(const wire::CommandReply &reply) {
  if (awaited_) {
    if (reply.kind == *awaited_ && reply.result == bregma_wire_COMMAND_DONE) {
      awaited_.reset();
      reply_ = reply;
    }
  } else if (wire::view(reply.client) == kOperatorClient && reply.id == last_command_ && !reply_) {
    reply_ = reply;
  }
}

void Operator::on_navigation(const wire::NavigationState &state, std::int64_t now_ns) {
  if (insertion_ && wire::view(state.tool) == true_tool(inserted_).model.name) {
    insertion_->see(state, now_ns);
  }
}

T_ImageTip Operator::true_tip(std::size_t tool, std::int64_t time_ns) const {
  if (tool == patient_->reference) {
    return true_tool(tool).tip(patient_->T_image_reference.as<frame::Image, frame::Tool>());
  }
  const bool guided = insertion_ && inserted_ == tool;
  return hands_.true_tip(tool, guided ? insertion_->pose(time_ns) : hands_.meant(tool, time_ns), time_ns);
}

void Operator::tick(std::int64_t now_ns, RoomOutput &out) {
  now_ns_ = now_ns;
  out_ = &out;
  if (!started_) {
    hands_.begin(now_ns);
    started_ = true;
  }
  // Executes all actions that end within this tick: planning and evaluation take no time.
  while (!failed()) {
    if (in_action_) {
      if (action_.done && !action_.done()) {
        break;
      }
      in_action_ = false;
    } else if (!actions_.empty()) {
      action_ = std::move(actions_.front());
      actions_.pop_front();
      action_ns_ = now_ns;
      in_action_ = true;
      if (action_.begin) {
        action_.begin();
      }
    } else {
      end_step();
      if (step_ >= steps_.size()) {
        label_ = "done";
        break;
      }
      start_step();
    }
  }
  out_ = nullptr;
}

void Operator::now_do(Actions actions) {
  actions_.insert(actions_.begin(), std::make_move_iterator(actions.begin()), std::make_move_iterator(actions.end()));
}

void Operator::start_step() {
  const Step &step = steps_[step_];
  in_step_ = true;
  label_ = step.name;
  tell(StepEvent::Kind::kStarted, "");
  now_do(actions_of(step));
}

void Operator::end_step() {
  if (in_step_) {
    tell(StepEvent::Kind::kDone, "");
    in_step_ = false;
    ++step_;
  }
}

void Operator::fail(const std::string &why) {
  const Step step = steps_[step_];
  tell(StepEvent::Kind::kFailed, why);
  actions_.clear();
  in_action_ = false;
  in_step_ = false;
  ++step_;
  label_ = step.name;
  if (!step.may_fail) {
    failure_ = step.name + ": " + why;
    return;
  }
  if (held_) {
    now_do(retreat(*held_));
  }
}

void Operator::tell(StepEvent::Kind kind, const std::string &text) {
  out_->events.push_back({kind, now_ns_, steps_[step_].name, text});
}

} // namespace bregma::sim
