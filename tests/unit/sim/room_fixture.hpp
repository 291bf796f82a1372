// Fixtures for tests of the simulated room: a case made in code, a scripted daemon, and a run in virtual time.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "casefile/case.hpp"
#include "drivers/sim/simulated_room.hpp"

namespace bregma::sim::test {

inline constexpr std::int64_t kStart_ns = 1'700'000'000'000'000'000;

// An ellipsoid with a nose, eight fiducials, three landmarks, one trajectory, the tools Reference, Stylus, Probe.
[[nodiscard]] casefile::Case make_case();

[[nodiscard]] Scenario scenario_of(const std::string &toml); // throws with the reader's message

// Answers every command after a delay, DONE by default. Displays the true tip plus a bias.
class ScriptedDaemon {
public:
  void refuse(wire::CommandKind kind, const std::string &point, int times, const std::string &text);
  void ignore_all() { deaf_ = true; }
  void take(const RoomOutput &out, std::int64_t now_ns);
  void give(SimulatedRoom &room, std::int64_t now_ns);

  Eigen::Vector3d bias_mm = Eigen::Vector3d::Zero(); // error of the displayed tip of every tool
  bool live = true;
  std::vector<wire::Command> commands;

private:
  struct Refusal {
    int left;
    std::string text;
  };
  std::map<std::pair<int, std::string>, Refusal> refusals_;
  std::vector<std::pair<std::int64_t, wire::CommandReply>> replies_;
  std::vector<wire::NavigationState> states_;
  bool deaf_ = false;
};

struct Recording {
  RoomOutput all;
  std::vector<std::int64_t> frame_arrivals_ns; // when advance() gave frames[i]
  double seconds = 0.0;
  [[nodiscard]] std::string events_text() const; // the events, one per line
};

// Runs until the script has ended, or for this number of seconds.
[[nodiscard]] Recording play(SimulatedRoom &room, ScriptedDaemon &daemon, double max_seconds,
                             std::int64_t step_ns = 2'000'000);
[[nodiscard]] Recording play_for(SimulatedRoom &room, double seconds, std::int64_t step_ns = 2'000'000);

[[nodiscard]] bool same_bytes(const void *a, const void *b, std::size_t size);
template <class T> [[nodiscard]] bool same_bytes(const std::vector<T> &a, const std::vector<T> &b) {
  return a.size() == b.size() && same_bytes(a.data(), b.data(), a.size() * sizeof(T));
}

[[nodiscard]] const wire::TrueTool *find(const wire::SimulatedTruth &truth, const std::string &tool);
[[nodiscard]] const wire::TrackedTool *find(const wire::TrackerFrame &frame, const std::string &tool);
[[nodiscard]] Eigen::Vector3d translation(const wire::Pose &pose);

} // namespace bregma::sim::test
