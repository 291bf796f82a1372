// A whole operation in virtual time: the simulated operating room and the daemon's engine, in one thread, as fast as
// the processor allows. What runs is what the daemon runs, but for threads and DDS; the same seed gives the same
// operation.
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "drivers/sim/simulated_room.hpp"
#include "server/engine.hpp"

namespace bregma::test {

// A folder that goes with its owner.
class TemporaryFolder {
public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder &) = delete;
  TemporaryFolder &operator=(const TemporaryFolder &) = delete;
  [[nodiscard]] const std::filesystem::path &path() const { return path_; }

private:
  std::filesystem::path path_;
};

class VirtualOperation final : private server::ControlSink {
public:
  // Called for every state that navigation publishes, with the truth of the same frame where the room told it.
  using Observer = std::function<void(const wire::NavigationState &, const wire::SimulatedTruth *)>;

  // a_case: as loaded from its folder; the scenario's load_case step loads it again by that folder. The session's
  // snapshot goes to config.state.directory, or to a folder that goes with the operation when that is empty.
  VirtualOperation(const casefile::Case &a_case, const sim::Scenario &scenario, std::uint64_t seed,
                   server::Config config = {});

  void observe(Observer observer) { observer_ = std::move(observer); }
  // Runs the script to its end; false when a step failed (see failure()) or more than limit_s of virtual time went by.
  bool run(double limit_s = 600.0);

  [[nodiscard]] std::string failure() const;
  [[nodiscard]] server::Engine &engine() { return engine_; }
  [[nodiscard]] const std::vector<wire::Alarm> &alarms() const { return alarms_; }
  [[nodiscard]] const std::vector<wire::CommandReply> &replies() const { return all_replies_; }
  [[nodiscard]] const std::vector<sim::StepEvent> &events() const { return events_; }
  [[nodiscard]] const wire::RegistrationState &registration() const { return registration_; }
  [[nodiscard]] const wire::FiducialReport &fiducials() const { return fiducials_; }
  [[nodiscard]] const wire::AccuracyState &accuracy() const { return accuracy_; }
  [[nodiscard]] wire::SystemHealth health() const;
  [[nodiscard]] const std::string &step() const { return step_; }
  [[nodiscard]] std::int64_t now_ns() const { return now_ns_; }
  [[nodiscard]] std::uint64_t received_frames() const { return received_frames_; }

private:
  void publish(const wire::CommandReply &reply) override;
  void publish(const wire::Alarm &alarm) override { alarms_.push_back(alarm); }
  void publish(const wire::CapturedPoint &) override {}
  void log(const std::string &) override {}
  void case_changed(const casefile::Case *) override {}

  void deliver(const sim::RoomOutput &out);
  void publish_states();
  void give_replies();
  [[nodiscard]] const wire::SimulatedTruth *truth_of(std::uint64_t frame) const;

  TemporaryFolder folder_; // the daemon's state
  sim::SimulatedRoom room_;
  server::Config config_;
  server::Engine engine_;
  Observer observer_;
  std::int64_t now_ns_;
  bool timed_out_ = false;
  std::uint64_t received_frames_ = 0;
  std::deque<wire::CommandReply> replies_; // to the operator, when the daemon's call has returned
  std::deque<wire::SimulatedTruth> truths_;
  std::vector<wire::CommandReply> all_replies_;
  std::vector<wire::Alarm> alarms_;
  std::vector<sim::StepEvent> events_;
  std::string step_;
  wire::RegistrationState registration_{};
  wire::FiducialReport fiducials_{};
  wire::AccuracyState accuracy_{};
};

} // namespace bregma::test
