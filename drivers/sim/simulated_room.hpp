// An operating room that does not exist: a head in front of an optical tracker, a person with two tools, a robot that
// holds the biopsy guide, a force and a range sensor. It errs as real ones do and knows the truth.
//
// Deterministic and without threads, DDS or a clock: the caller says what time it is and gets everything that has
// fallen due since. The same case, scenario, seed and replies give the same bytes, whatever the steps in which time is
// told. The noise of each source is drawn from a stream of its own, so that a fault does not change what else happens.
//
//   SimulatedRoom room(a_case, scenario, seed);
//   for (now_ns = start; !room.finished(); now_ns = room.next_due_ns()) {
//     room.advance(now_ns, out);            // out is cleared, then filled
//     ... hand out.frames, out.commands, ... to the daemon's pipelines; give its replies and states back:
//     room.on_reply(reply); room.on_navigation(state, now_ns);
//   }
//
// Devices: "Tracker", "Robot", "Force", "Range". Tools: those of the case. The client of the commands is
// kOperatorClient. Times are host time, ns UTC; sent_time_ns of a sample is the time at which it fell due, to be
// overwritten by who writes it later.
//
// SimulatedTruth::step is the name of the step under way; while a tip is held at its target, with ":hold" behind it.
//
// Frames: Tracker has z along the line of sight, away from the camera, y down. Truth is T_image_*: the head lies still
// in the tracker's frame, and what is called Image is the head's anatomy, free of the errors of planning.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "casefile/case.hpp"
#include "drivers/sim/scenario.hpp"
#include "idl/topics.hpp"

namespace bregma::sim {

inline constexpr const char *kTrackerDevice = "Tracker";
inline constexpr const char *kRobotDevice = "Robot";
inline constexpr const char *kForceDevice = "Force";
inline constexpr const char *kRangeDevice = "Range";
inline constexpr const char *kOperatorClient = "operator";

struct StepEvent {
  enum class Kind { kStarted, kNote, kDone, kFailed };
  Kind kind = Kind::kStarted;
  std::int64_t time_ns = 0;
  std::string step;
  std::string text; // what was done, the daemon's figure, or why it failed
};

struct RoomOutput {
  std::vector<wire::TrackerFrame> frames;   // in the order of delivery
  std::vector<wire::SimulatedTruth> truths; // one a measured frame, with the same number
  std::vector<wire::RobotState> robot_states;
  std::vector<wire::ForceSample> force_samples;
  std::vector<wire::RangeSample> range_samples;
  std::vector<wire::Command> commands;
  std::vector<StepEvent> events;
  void clear();
};

class SimulatedRoom {
public:
  // The case must have passed load_case (a scalp, a reference); throws std::invalid_argument with a sentence where the
  // scenario names a tool, a point or a trajectory that the case does not have.
  SimulatedRoom(const casefile::Case &a_case, const Scenario &scenario, std::uint64_t seed);
  ~SimulatedRoom();
  SimulatedRoom(SimulatedRoom &&) noexcept;
  SimulatedRoom &operator=(SimulatedRoom &&) noexcept;

  // Time must not go back. The first call starts the room.
  void advance(std::int64_t now_ns, RoomOutput &out);
  // When advance() has something to do next.
  [[nodiscard]] std::int64_t next_due_ns() const;

  // What the operator hears and sees.
  void on_reply(const wire::CommandReply &reply);
  void on_navigation(const wire::NavigationState &state, std::int64_t now_ns);

  // The script has come to its end or to a step that failed. The devices go on.
  [[nodiscard]] bool finished() const;
  [[nodiscard]] bool failed() const;
  [[nodiscard]] std::string failure() const; // step and reason; empty unless failed
  [[nodiscard]] std::string current_step() const;
  // Appends steps to a script that has finished without a failure.
  void continue_with(std::vector<Step> steps);

private:
  struct State;
  std::unique_ptr<State> state_;
};

} // namespace bregma::sim
