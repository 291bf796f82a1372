// The person at the table: goes through the scenario's steps, moves the tools, says commands and waits for the answers,
// tries a refused touch again, and steers by the display.
//
// A step becomes a list of actions (move, wait, ask, judge) that are done one after the other; an action may put others
// before those that are left, which is how a retry comes about. Called every kTick_ns of room time. Not thread-safe.
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

  // Throws std::invalid_argument where a step names what the case does not have. All references must outlive it.
  Operator(const casefile::Case &a_case, const Scenario &scenario, const Patient &patient, RobotArm &arm,
           std::uint64_t seed);

  void tick(std::int64_t now_ns, RoomOutput &out); // appends commands and events
  void on_reply(const wire::CommandReply &reply);
  void on_navigation(const wire::NavigationState &state, std::int64_t now_ns);
  void continue_with(std::vector<Step> steps);

  [[nodiscard]] T_ImageTip true_tip(std::size_t tool, std::int64_t time_ns) const;
  // The step's name, with ":hold" behind it while a tip is held at its target; "done" after the last.
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

  // What an action can be.
  [[nodiscard]] Action call(std::function<void()> what) const;
  [[nodiscard]] Action move(std::size_t tool, std::function<std::unique_ptr<Movement>()> plan);
  [[nodiscard]] Action reach(std::size_t tool, const HandPose &to);
  [[nodiscard]] Action wait(double seconds);
  [[nodiscard]] Action ask(wire::CommandKind kind, std::vector<std::string> values = {});
  [[nodiscard]] Action judge(); // fails the step unless the last command was done
  [[nodiscard]] Action guide(std::size_t tool, const GuidedInsertion &insertion);

  // What a step, or a part of it, is made of.
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
  void now_do(Actions actions); // before all that are left
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
  std::deque<Action> actions_; // that are left
  Action action_;              // under way; never replaced while one of its functions runs
  bool in_action_ = false;
  std::int64_t action_ns_ = 0;
  std::int64_t now_ns_ = 0;
  bool started_ = false;
  RoomOutput *out_ = nullptr; // only within tick()
  std::string label_;
  std::string failure_;

  std::optional<std::size_t> held_;
  std::uint64_t last_command_ = 0;
  std::optional<wire::CommandReply> reply_; // to last_command_
  std::optional<GuidedInsertion> insertion_;
  std::size_t inserted_ = 0; // the tool of insertion_
  T_ImageFlange guide_;      // where the guide stands for insertion_, before corrections
};

} // namespace bregma::sim
