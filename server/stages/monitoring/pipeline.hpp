// The monitoring pipeline: accuracy of the registration (FRE as a consistency figure, predicted TRE at every target,
// drift), state of devices, loops and recorder, and the resulting alarms.
//
// One thread; a step does not allocate, throw, lock or log.
#pragma once

#include <cstdint>
#include <optional>
#include <variant>

#include "algorithms/monitoring/drift_monitor.hpp"
#include "server/inputs/input_guard.hpp"
#include "server/recording/recorder.hpp"
#include "server/stages/loaded_case.hpp"
#include "server/stages/monitoring/alarm_conditions.hpp"
#include "server/stages/monitoring/clock_watch.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

using MonitoringInput = std::variant<CaseChanged, MonitoringMessage>;

// Latest outputs of the other stages.
struct MonitoringView {
  const TrackingView &tracking;
  const inputs::StreamHealth &trackers;
  const inputs::StreamHealth &sensors;
  const wire::RegistrationState &registration;
  recording::RecorderStatus recorder;
  std::int64_t wall_lead_ns = 0; // the wall clock minus steady UTC
};

// Of the stage; the pipeline does not use rate and priority.
struct MonitoringParameters {
  double rate_hz = 10.0;
  double false_alarm_rate = 1e-4; // false-alarm probability of the drift test, per check touch
  double raise_after_ms = 200.0;  // a condition becomes an alarm when it has held for this time
  double clear_after_ms = 1000.0; // and the alarm is cleared when the condition has been absent for this time
  double max_age_ms = 50.0;       // maximal age of a pose when it is published; above it an alarm is raised
  std::int64_t priority = 40;
};

class MonitoringPipeline {
public:
  // alarms: to the session's stage; must outlive the pipeline.
  MonitoringPipeline(const MonitoringParameters &parameters, AlarmEvents &alarms);

  void handle(const MonitoringInput &input) noexcept;
  void step(const MonitoringView &view, std::int64_t now_ns) noexcept;

  [[nodiscard]] const wire::AccuracyState &accuracy() const noexcept { return accuracy_; }
  [[nodiscard]] const ClockView &clock() const noexcept { return clock_watch_.view(); }
  // Turns accuracy() into the last one of its instance: the case is closed or replaced.
  void end_state(std::int64_t now_ns) noexcept;

private:
  void on(const CaseChanged &change) noexcept;
  void on(const MonitoringMessage &message) noexcept;
  void add(const JudgedCheck &touch) noexcept;
  void add(const SurfaceSample &sample) noexcept;
  void restart_drift() noexcept;
  void predict_targets() noexcept;
  void watch_devices(const MonitoringView &view, std::int64_t now_ns) noexcept;
  void watch_loss(const wire::DeviceHealth &device, std::int64_t now_ns) noexcept;
  void watch_tracking(const TrackingView &tracking, std::int64_t now_ns) noexcept;
  void watch_hand_eye(const TrackingView &tracking, std::int64_t now_ns) noexcept;
  void watch_hand_eye_checks(const TrackingView &tracking, std::int64_t now_ns) noexcept;
  void watch_plausibility(const TrackingView &tracking, std::int64_t now_ns) noexcept;
  void watch_unknown(const MonitoringView &view, std::int64_t now_ns) noexcept;
  void watch_system(const MonitoringView &view, std::int64_t now_ns) noexcept;
  void watch_clock(std::int64_t wall_lead_ns, std::int64_t now_ns) noexcept;
  [[nodiscard]] AlarmConditions::Kind kind(const char *name, wire::AlarmSeverity severity,
                                           SessionEffect effect) const noexcept;

  MonitoringParameters parameters_;
  AlarmConditions alarms_;
  LoadedCase *case_ = nullptr;
  SessionChanged session_{bregma_wire_SESSION_IDLE, false};
  std::optional<geometry::UncertainPose<geometry::frame::Image, geometry::frame::Reference>> accepted_;
  geometry::Vector3d excess_mm_ = geometry::Vector3d::Zero(); // of the accepted registration
  monitoring::DriftMonitor drift_;
  std::uint64_t rejected_seen_[bregma_wire_MAX_DEVICES] = {};     // in the order of trackers, then sensors
  std::uint64_t other_writer_seen_[bregma_wire_MAX_DEVICES] = {}; // in the same order, like the next
  std::uint32_t takeovers_seen_[bregma_wire_MAX_DEVICES] = {};
  std::uint64_t records_lost_seen_ = 0;
  std::uint64_t refusals_seen_[1 + bregma_wire_MAX_TOOLS] = {}; // of the reference, then of the tools
  std::int64_t tracked_since_ns_ = 0; // a tracker beside an arm sends since then; 0: it does not
  ClockWatch clock_watch_;
  wire::AccuracyState accuracy_{};
};

} // namespace bregma::server
