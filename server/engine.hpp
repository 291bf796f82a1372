// The daemon without threads and without DDS: the session, the pipelines and the border, and what passes between them.
//
// Every part belongs to one thread, named below; the parts meet only in rings and latest values. The daemon
// (server/daemon.hpp) gives each its thread; tests and benchmarks call them one after the other in virtual time, so
// that what they measure is what runs.
//
//   control ---- NavigationInput, RegistrationInput, MonitoringInput, CaseChanged (rings) ----> loops
//   control <--- NavigationEvent, AlarmCondition (rings), RegistrationState (latest value) ---- loops
//
// Time is passed in: ns UTC, host clock.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "server/config.hpp"
#include "server/inputs/border.hpp"
#include "server/pipelines/deformation.hpp"
#include "server/pipelines/monitoring.hpp"
#include "server/pipelines/navigation.hpp"
#include "server/pipelines/pose_recovery.hpp"
#include "server/pipelines/registration.hpp"
#include "server/pipelines/tissue_builder.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/session/session.hpp"

namespace bregma::server {

// What the control side says to the outside.
class ControlOutlet {
public:
  virtual ~ControlOutlet() = default;
  virtual void publish(const wire::CommandReply &reply) = 0;
  virtual void publish(const wire::Alarm &alarm) = 0;
  virtual void publish(const wire::CapturedPoint &point) = 0;
  virtual void log(const std::string &line) = 0;
  // A case was loaded or closed (nullptr).
  virtual void case_changed(const casefile::Case *loaded) = 0;
};

class Engine final : private SessionPorts {
public:
  // Throws std::invalid_argument for a configuration that check() refuses.
  Engine(const Config &config, ControlOutlet &outlet, Session::Executor executor = {});
  ~Engine() override;
  Engine(const Engine &) = delete;
  Engine &operator=(const Engine &) = delete;

  // ---- control thread ----
  [[nodiscard]] Session &session() { return *session_; }
  // What the loops have said since the last call, answers that were waited for, cases that no loop uses any more.
  void poll(std::int64_t now_ns);
  // Of messages between threads that did not fit their ring: always 0 in a healthy daemon.
  [[nodiscard]] std::uint64_t dropped_messages() const;

  // ---- navigation thread ----
  // Takes in what the control thread has said. Call before frames and ticks.
  void receive_navigation() noexcept;
  // True when the frame passed the border; navigation().states() are then those of this frame.
  bool take(const wire::TrackerFrame &frame, std::uint64_t writer, std::int64_t now_ns) noexcept;
  void tick_navigation(std::int64_t now_ns) noexcept;
  void tracker_writers(std::uint32_t alive) noexcept { tracker_border_.set_writers_alive(alive); }
  // A few times a second: what monitoring and health see of the tracker.
  void share_tracker_health(std::int64_t now_ns) noexcept;
  [[nodiscard]] const NavigationPipeline &navigation() const noexcept { return navigation_; }

  // ---- sensor thread ----
  bool take(const wire::RobotState &sample, std::uint64_t writer, std::int64_t now_ns) noexcept;
  bool take(const wire::RangeSample &sample, std::uint64_t writer, std::int64_t now_ns) noexcept;
  bool take(const wire::ForceSample &sample, std::uint64_t writer, std::int64_t now_ns) noexcept;
  void sensor_writers(std::uint32_t robots, std::uint32_t ranges, std::uint32_t forces) noexcept;
  void share_sensor_health(std::int64_t now_ns) noexcept;

  // ---- registration thread ----
  const RegistrationPipeline &step_registration(std::int64_t now_ns) noexcept;

  // ---- monitoring thread ----
  const wire::AccuracyState &step_monitoring(const recording::RecorderStatus &recorder, std::uint64_t overruns,
                                             std::int64_t now_ns) noexcept;

  // ---- deformation thread ----
  // most_steps: of the tissue solver, that there is time for.
  const DeformationPipeline &step_deformation(std::int64_t now_ns, int most_steps) noexcept;

  // ---- tissue builder thread, which is no loop either ----
  // What is to be logged, empty for nothing.
  std::string step_tissue_builder();

  // ---- pose search thread, which is no loop: it works as long as a search takes ----
  void step_pose_recovery();

  // ---- any thread ----
  void add_devices(wire::SystemHealth &health) const;

private:
  // A ring, and what waits for a place in it.
  template <class Message, std::size_t Capacity> struct Outbox {
    runtime::SpscRing<Message, Capacity> ring;
    std::deque<Message> backlog;
    void send(const Message &message);
    void flush();
  };

  [[nodiscard]] base::Result<void> use_case(std::shared_ptr<const casefile::Case> loaded) override;
  void send(const NavigationMessage &message) override;
  void send(const RegistrationMessage &message) override;
  void send(const MonitoringMessage &message) override;
  void publish(const wire::CommandReply &reply) override { outlet_.publish(reply); }
  void publish(const wire::Alarm &alarm) override { outlet_.publish(alarm); }
  void publish(const wire::CapturedPoint &point) override { outlet_.publish(point); }
  void log(const std::string &line) override { outlet_.log(line); }
  void free_unused_cases();
  void share_predicted_targets() noexcept;

  Config config_;
  ControlOutlet &outlet_;

  // Control thread.
  std::vector<std::pair<std::uint64_t, std::unique_ptr<LoadedCase>>> cases_; // by generation, the present one last
  std::uint64_t generation_ = 0;
  std::uint64_t seen_registration_ = 0;

  // Between threads. Navigation sees a case before any message about it, because both take the same ring.
  Outbox<NavigationInput, 256> to_navigation_;
  Outbox<RegistrationInput, 1024> to_registration_;
  Outbox<MonitoringInput, 1024> to_monitoring_;
  Outbox<CaseChanged, 16> to_deformation_;
  Outbox<CaseChanged, 16> to_pose_recovery_;
  Outbox<CaseChanged, 16> to_tissue_builder_;
  NavigationEvents navigation_events_;
  AlarmEvents alarm_events_;
  runtime::LatestValue<wire::RegistrationState> registration_state_;
  runtime::LatestValue<TrackingView> tracking_;
  runtime::LatestValue<inputs::StreamHealth> tracker_health_;
  runtime::LatestValue<inputs::StreamHealth> sensor_health_;
  runtime::LatestValue<PoseRecoveryRequest> search_request_;
  runtime::LatestValue<PoseRecoveryAnswer> search_answer_;
  runtime::LatestValue<ProbeView> probe_;
  runtime::LatestValue<ForceView> force_;
  runtime::LatestValue<TissueModelReady> tissue_model_;
  runtime::LatestValue<PredictedTargets> predicted_;
  std::atomic<std::uint64_t> taken_generation_[6] = {}; // by who uses the case, in the order of enum Loop

  // Each its thread's alone.
  inputs::Border<wire::TrackerFrame> tracker_border_;
  NavigationPipeline navigation_;
  inputs::Border<wire::RobotState> robot_border_;
  inputs::Border<wire::RangeSample> range_border_;
  inputs::Border<wire::ForceSample> force_border_;
  RegistrationPipeline registration_;
  PoseRecoveryAnswer answer_{};
  std::uint64_t seen_answer_ = 0;
  PoseRecovery pose_recovery_;
  PoseRecoveryRequest request_{};
  std::uint64_t seen_request_ = 0;
  bool request_waits_ = false; // for the case that it is about, or for its turn
  MonitoringPipeline monitoring_;
  MonitoringView monitoring_view_;
  std::uint64_t seen_by_monitoring_[4] = {};
  DeformationPipeline deformation_;
  ProbeView probe_view_;
  ForceView force_view_;
  std::uint64_t seen_by_deformation_[3] = {};
  TissueModelReady ready_;
  TissueBuilder tissue_builder_;
  PredictedTargets targets_;
  std::uint64_t seen_targets_ = 0;

  std::unique_ptr<Session> session_; // last: it calls the ports
};

} // namespace bregma::server
