// The simulated operator: executes the scenario's steps, moves the tools, sends commands and waits for replies, repeats
// refused touches, and steers by the display.
//
// A step becomes a list of actions (move, wait, ask, judge) that are executed in order. An action may insert others
// before the remaining ones, for example for a retry. Called every kTick_ns of room time. Not thread-safe.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "drivers/sim/guided_insertion.hpp"
#include "drivers/sim/hand_planning.hpp"
#include "drivers/sim/hands.hpp"
#include "drivers/sim/patient.hpp"
#include "drivers/sim/random.hpp"
#include "drivers/sim/robot_arm.hpp"
#include "drivers/sim/simulated_room.hpp"

namespace bregma::sim {

class Operator {
public:
  static constexpr std::int64_t kTick_ns = 5'000'000;

  // Throws std::invalid_argument if a step names an object that the case does not contain. All references must outlive
  // it.
  Operator(const casefile::Case &a_case, const Scenario &scenario, const Patient &patient, RobotArm &arm,
           std::uint64_t seed);

  void tick(std::int64_t now_ns, RoomOutput &out); // appends commands and events
  void on_reply(const wire::CommandReply &reply);
  void on_navigation(const wire::NavigationState &state, std::int64_t now_ns);
  void continue_with(std::vector<Step> steps);

  [[nodiscard]] T_ImageTip true_tip(std::size_t tool, std::int64_t time_ns) const;
  // The step's name, with the suffix ":hold" while a tip is held at its target; "done" after the last step.
  [[nodiscard]] const std::string &label() const { return label_; }
  [[nodiscard]] bool finished() const {
    return failed() || (step_ >= steps_.size() && actions_.empty() && !in_action_);
  }
  [[nodiscard]] bool failed() const { return !failure_.empty(); }
  [[nodiscard]] const std::string &failure() const { return failure_; }

private:
  struct Action {
    std::function<void()> begin;
    std::function<bool()> done;
  };
  using Actions = std::vector<Action>;
  struct Touch {
    std::size_t tool;
    wire::CommandKind kind;
    std::string point;
    Vector3d position_mm;
    double sigma_mm;
    std::int64_t attempt;
  };

  // Kinds of actions.
  [[nodiscard]] Action call(std::function<void()> what) const;
  [[nodiscard]] Action move(std::size_t tool, std::function<std::unique_ptr<Movement>()> plan);
  [[nodiscard]] Action reach(std::size_t tool, const HandPose &to);
  [[nodiscard]] Action wait(double seconds);
  [[nodiscard]] Action ask(wire::CommandKind kind, std::vector<std::string> values = {});
  // With hands_only: until another client's command of this kind is done.
  [[nodiscard]] Action await(wire::CommandKind kind, const std::vector<std::string> &values);
  [[nodiscard]] Action judge(); // fails the step unless the last command succeeded
  [[nodiscard]] Action guide(std::size_t tool, const GuidedInsertion &insertion);

  // Actions of a step or of a part of it.
  [[nodiscard]] Actions actions_of(const Step &step);
  [[nodiscard]] Actions take(std::size_t tool);
  [[nodiscard]] Actions pivot(const Step &step);
  [[nodiscard]] Actions touches(const Step &step);
  [[nodiscard]] Actions touch(const Touch &touch);
  [[nodiscard]] Actions trace(const Step &step);
  [[nodiscard]] Actions follow(const Step &step);
  [[nodiscard]] Actions retreat(std::size_t tool);
  void judge_touch(const Touch &touch);

  void check(const Step &step) const;
  [[nodiscard]] std::size_t index_of(const std::string &tool) const;
  [[nodiscard]] const TrueTool &true_tool(std::size_t index) const { return patient_->tools[index]; }
  void now_do(Actions actions); // inserts before the remaining actions
  void start_step();
  void end_step();
  void fail(const std::string &why);
  void tell(StepEvent::Kind kind, const std::string &text);
  [[nodiscard]] double since_action_s() const { return static_cast<double>(now_ns_ - action_ns_) * 1e-9; }

  const casefile::Case *case_;
  OperatorParameters parameters_;
  RobotParameters robot_parameters_;
  const Patient *patient_;
  RobotArm *arm_;
  HandPlanning planning_;
  Hands hands_;
  Random placing_;

  std::vector<Step> steps_;
  std::size_t step_ = 0;
  bool in_step_ = false;
  std::deque<Action> actions_; // remaining actions
  Action action_;              // current action; not replaced while one of its functions runs
  bool in_action_ = false;
  std::int64_t action_ns_ = 0;
  std::int64_t now_ns_ = 0;
  bool started_ = false;
  RoomOutput *out_ = nullptr; // only within tick()
  std::string label_;
  std::string failure_;

  std::optional<std::size_t> held_;
  std::uint64_t last_command_ = 0;
  std::optional<wire::CommandReply> reply_; // reply to last_command_, or to the awaited command
  std::optional<wire::CommandKind> awaited_;
  std::optional<GuidedInsertion> insertion_;
  std::size_t inserted_ = 0; // the tool of insertion_
  T_ImageFlange guide_;      // pose of the guide for insertion_, before corrections
};

} // namespace bregma::sim
