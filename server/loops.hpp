// The threads of the daemon around the engine's parts, with their DDS endpoints and recorder channels.
//
// | thread       | woken by                     | publishes                              |
// | navigation   | tracker frame, floor tick    | NavigationState                        |
// | sensors      | robot, range, force sample   | -                                      |
// | registration | its rate                     | RegistrationState, FiducialReport      |
// | monitoring   | its rate                     | AccuracyState                          |
// | deformation  | its rate                     | DeformationState                       |
//
// The loops write their topics themselves: handing a sample to a publisher thread costs one more wake-up, which is
// dearer than the write (docs/latency.md).
//
// Threads: construct, start, stop on the control thread; the readers from any.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "idl/dds.hpp"
#include "server/engine.hpp"
#include "server/publisher.hpp"
#include "server/runtime/clock.hpp"
#include "server/runtime/loop.hpp"

namespace bregma::server {

class Loops {
public:
  // All outlive the loops. Throws dds::Error.
  Loops(const Config &config, Engine &engine, const dds::Participant &participant, recording::Recorder &recorder,
        const runtime::Clock &clock);
  ~Loops() { stop(); }
  Loops(const Loops &) = delete;
  Loops &operator=(const Loops &) = delete;

  void start();
  void stop();

  void add_health(wire::SystemHealth &health) const;
  // Of the loops that must advance by themselves, for a watchdog: name and count of steps.
  [[nodiscard]] std::vector<std::pair<std::string, std::function<std::uint64_t()>>> heartbeats() const;

private:
  void navigate() noexcept;
  void watch_sensors() noexcept;
  void take_frames() noexcept;
  void publish_navigation(std::int64_t now_ns) noexcept;
  void step_registration() noexcept;
  void step_monitoring() noexcept;
  void step_deformation() noexcept;
  void search_poses();
  void build_tissue_models();
  void publish_field(const DeformationPipeline &deformation, std::int64_t now_ns) noexcept;
  [[nodiscard]] std::uint64_t overruns() const noexcept;

  const Config config_;
  Engine &engine_;
  recording::Recorder &recorder_;
  const runtime::Clock &clock_;
  dds::Guard stop_guard_;
  std::atomic<bool> stopping_{false};

  recording::Channel &navigation_channel_;
  Publisher<wire::NavigationState> navigation_states_;
  dds::Reader<wire::TrackerFrame> frames_;
  dds::WaitSet navigation_wait_;
  runtime::LoopStatistics navigation_statistics_;
  bool published_ = false; // since the last floor tick; the navigation thread's

  recording::Channel &sensor_channel_;
  dds::Reader<wire::RobotState> robots_;
  dds::Reader<wire::RangeSample> ranges_;
  dds::Reader<wire::ForceSample> forces_;
  dds::WaitSet sensor_wait_;
  runtime::LoopStatistics sensor_statistics_;

  Publisher<wire::RegistrationState> registration_states_;
  Publisher<wire::FiducialReport> fiducial_reports_;
  Publisher<wire::AccuracyState> accuracy_states_;
  Publisher<wire::DeformationState> deformation_states_;
  dds::Writer<wire::DeformationField> fields_;
  std::vector<float> field_mm_; // x, y, z a node; grows when a model comes, the deformation loop's
  std::int64_t field_ns_ = 0;
  double solver_step_ns_ = 0.0; // what one step of the tissue solver takes, smoothed; the deformation loop's

  runtime::PeriodicLoop registration_loop_;
  runtime::PeriodicLoop monitoring_loop_;
  runtime::PeriodicLoop deformation_loop_;
  std::thread navigation_thread_;
  std::thread sensor_thread_;
  std::thread search_thread_;
  std::thread tissue_thread_;
};

} // namespace bregma::server
