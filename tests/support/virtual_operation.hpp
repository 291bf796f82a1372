// A complete operation in virtual time: the simulated operating room and the daemon's stages in one thread, as fast as
// the processor allows. The stages, schedule and rates are those of bregmad, without threads and DDS. Equal seeds
// publish equal bytes (tests/component/repeat_test.cpp).
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "drivers/sim/simulated_room.hpp"
#include "server/config.hpp"
#include "server/process_alarms.hpp"
#include "server/stages/host.hpp"
#include "server/wiring.hpp"
#include "tests/support/memory_topics.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/virtual_link.hpp"
#include "tests/support/virtual_loops.hpp"

namespace bregma::test {

// bregmad's defaults without a tissue model, which would dominate the computing time.
[[nodiscard]] server::Config quick_config();

// What lies between the room and the daemon. Without one every sample arrives as it was sent.
class Line {
public:
  virtual ~Line() = default;
  // Called at every moment of the operation. sent: what the room has sent since the last call. Passes to the daemon
  // what arrives by now.
  virtual void carry(const sim::RoomOutput &sent, std::int64_t now_ns, MemoryTopics &to) = 0;
  // Time of the next sample that arrives, or of another event of the line; Stage::kNever if there is none.
  [[nodiscard]] virtual std::int64_t next_due_ns() const = 0;
};

class VirtualOperation final : private server::Host {
public:
  // Called for every published navigation state, with the truth of the same frame if available.
  using Observer = std::function<void(const wire::NavigationState &, const wire::SimulatedTruth *)>;

  // a_case: as loaded from its folder; the scenario's load_case step loads it again from there. The session's snapshot
  // is written to the configured state directory, or to a temporary folder if that is empty.
  VirtualOperation(const casefile::Case &a_case, const sim::Scenario &scenario, std::uint64_t seed,
                   server::Config config = quick_config());
  ~VirtualOperation() override;

  void observe(Observer observer) { observer_ = std::move(observer); }
  // line must outlive the run.
  void set_line(Line &line) { line_ = &line; }
  // The daemon's process is stopped (SIGSTOP) until this time.
  void stop_daemon(std::int64_t until_ns) { stopped_until_ns_ = until_ns; }
  // The daemon's process is killed. Another one starts at this time, with the same state directory.
  void kill_daemon(std::int64_t restart_ns);
  [[nodiscard]] bool daemon_runs() const { return now_ns_ >= stopped_until_ns_; }
  // What the recorder reports from now on.
  void set_recorder(const recording::RecorderStatus &status) { recorder_ = status; }
  // The other daemons that the process hears on its domain from now on; empty: none.
  void set_other_daemons(const std::string &names) { process_facts_.other_daemons = names; }
  [[nodiscard]] const std::string &state_directory();
  // For observers of other topics and of steps.
  [[nodiscard]] MemoryTopics &topics() { return topics_; }
  [[nodiscard]] VirtualLoops &loops() { return loops_; }
  // The driver's host, and its network if there is no other line.
  [[nodiscard]] VirtualLink &link() { return link_; }
  // Called before every advance, for changes during the run.
  void before_advance(std::function<void(std::int64_t utc_ns)> call) { before_advance_ = std::move(call); }
  // Runs the script to its end. False if a step failed (see failure()) or the virtual time exceeds limit_s.
  bool run(double limit_s = 600.0);

  [[nodiscard]] std::string failure() const;
  [[nodiscard]] const server::Session &session() const { return wiring_->session(); }
  [[nodiscard]] const std::vector<wire::Alarm> &alarms() const { return alarms_; }
  [[nodiscard]] const std::vector<wire::CommandReply> &replies() const { return replies_; }
  [[nodiscard]] const std::vector<sim::StepEvent> &events() const { return events_; }
  // The latest message of each type.
  [[nodiscard]] const wire::RegistrationState &registration() const { return registration_; }
  [[nodiscard]] const wire::FiducialReport &fiducials() const { return fiducials_; }
  [[nodiscard]] const wire::AccuracyState &accuracy() const { return accuracy_; }
  [[nodiscard]] const wire::SystemHealth &health() const { return health_; }
  [[nodiscard]] const std::string &step() const { return step_; }
  [[nodiscard]] std::int64_t now_ns() const { return now_ns_; }
  [[nodiscard]] std::uint64_t received_frames() const { return received_frames_; }

private:
  [[nodiscard]] std::optional<int> fixed_solver_steps() const noexcept override;
  [[nodiscard]] recording::RecorderStatus recorder() const noexcept override { return recorder_; }
  [[nodiscard]] wire::BootIdentity boot_id() const override { return kDaemonBoot; }
  [[nodiscard]] server::AlarmEvents *conditions() noexcept override { return &process_alarms_.events; }

  void start_killed_daemon();
  void deliver(sim::RoomOutput &out);
  void on_state(const wire::NavigationState &state);
  [[nodiscard]] const wire::SimulatedTruth *truth_of(std::uint64_t frame) const;

  TemporaryFolder folder_; // the daemon's state
  sim::SimulatedRoom room_;
  server::Config config_;
  MemoryTopics topics_;
  std::unique_ptr<server::Wiring> wiring_;
  VirtualLoops loops_;
  VirtualLink link_;
  Observer observer_;
  Line *line_ = nullptr;
  recording::RecorderStatus recorder_;
  server::ProcessFacts process_facts_;
  server::ProcessAlarms process_alarms_;
  std::function<void(std::int64_t)> before_advance_ = [](std::int64_t) {};
  std::int64_t now_ns_;
  std::int64_t stopped_until_ns_ = 0;
  bool killed_ = false;
  bool timed_out_ = false;
  std::uint64_t received_frames_ = 0;
  std::deque<wire::SimulatedTruth> truths_;
  std::vector<wire::CommandReply> replies_;
  std::vector<wire::Alarm> alarms_;
  std::vector<sim::StepEvent> events_;
  std::string step_;
  wire::RegistrationState registration_{};
  wire::FiducialReport fiducials_{};
  wire::AccuracyState accuracy_{};
  wire::SystemHealth health_{};
};

} // namespace bregma::test
