// A simulated operating room: a head in front of an optical tracker, an operator with two tools, a robot that holds the
// biopsy guide, a force sensor and a range sensor. It has realistic errors and provides the ground truth.
//
// Deterministic, without threads, DDS or a clock: the caller passes the time and receives all samples due since the
// last call. The same case, scenario, seed and replies give the same bytes for any steps of the time. The noise of each
// source has a separate random stream, so that a fault does not change other sources.
//
//   SimulatedRoom room(a_case, scenario, seed);
//   for (now_ns = start; !room.finished(); now_ns = room.next_due_ns()) {
//     room.advance(now_ns, out);            // out is cleared, then filled
//     ... pass out.frames, out.commands, ... to the daemon; return its replies and states:
//     room.on_reply(reply); room.on_navigation(state, now_ns);
//   }
//
// Devices: "Tracker", "Robot", "Force", "Range". Tools: those of the case. The client of the commands is
// kOperatorClient. Times are host time, ns UTC. sent_time_ns of a sample is its due time; a later writer must overwrite
// it.
//
// SimulatedTruth::step is the name of the current step, with the suffix ":hold" while a tip is held at its target.
//
// Frames: Tracker has z along the line of sight, away from the camera, y down. The truth is T_image_*. The head does
// not move in the tracker's frame, and Image is the head's anatomy, without planning errors.
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
  std::string text; // the action, the daemon's figure, or the reason of a failure
};

struct RoomOutput {
  std::vector<wire::TrackerFrame> frames;   // in the order of delivery
  std::vector<wire::SimulatedTruth> truths; // one per measured frame, with the same number
  std::vector<wire::RobotState> robot_states;
  std::vector<wire::ForceSample> force_samples;
  std::vector<wire::RangeSample> range_samples;
  std::vector<wire::Command> commands;
  std::vector<StepEvent> events;
  void clear();
};

class SimulatedRoom {
public:
  // The case must have passed load_case (a scalp, a reference). Throws std::invalid_argument if the scenario names a
  // tool, a point or a trajectory that the case does not contain.
  SimulatedRoom(const casefile::Case &a_case, const Scenario &scenario, std::uint64_t seed);
  ~SimulatedRoom();
  SimulatedRoom(SimulatedRoom &&) noexcept;
  SimulatedRoom &operator=(SimulatedRoom &&) noexcept;

  // Times must not decrease. The first call starts the room.
  void advance(std::int64_t now_ns, RoomOutput &out);
  // Time of the next due event.
  [[nodiscard]] std::int64_t next_due_ns() const;

  // Input of the operator.
  void on_reply(const wire::CommandReply &reply);
  void on_navigation(const wire::NavigationState &state, std::int64_t now_ns);

  // The script has ended or a step has failed. The devices continue.
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
