#include "server/stages/health/stage.hpp"

#include <algorithm>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "idl/version.hpp"
#include "server/runtime/process_memory.hpp"

namespace bregma::server {

void declare(base::ParameterSet &set, HealthParameters &p) {
  set.number("health.rate_hz", &p.rate_hz, "Hz", 0.5, 50, "Rate at which the system's health is published.");
}

HealthStage::HealthStage(const HealthParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kWorker, .rate_hz = parameters.rate_hz}), host_(context.host),
      health_(context.link), boot_id_(context.host.boot_id()) {}

void HealthStage::connect(const runtime::LatestValue<inputs::StreamHealth> &trackers,
                          const runtime::LatestValue<inputs::StreamHealth> &sensors,
                          const runtime::LatestValue<inputs::StreamHealth> &scanner,
                          const runtime::LatestValue<SessionView> &session, const NavigationEvents &events,
                          const AlarmEvents &conditions, const runtime::LatestValue<ClockView> &clock) {
  trackers_.connect(trackers);
  sensors_.connect(sensors);
  scanner_.connect(scanner);
  session_.connect(session);
  clock_.connect(clock);
  events_ = &events;
  conditions_ = &conditions;
}

void HealthStage::step(const Moment &now) noexcept {
  (void)trackers_.refresh();
  (void)sensors_.refresh();
  (void)scanner_.refresh();
  (void)session_.refresh();
  (void)clock_.refresh();
  started_ns_ = started_ns_ == 0 ? now.utc_ns : started_ns_;
  wire::SystemHealth health{};
  (void)wire::set_name(health.daemon, wire::kDaemonName);
  health.time_ns = now.utc_ns;
  health.started_time_ns = started_ns_;
  health.session = session_.value().state;
  health.refused_commands = session_.value().refused_commands;
  wire::set_text(health.case_folder, session_.value().case_folder);
  inputs::add_to(health, trackers_.value());
  inputs::add_to(health, sensors_.value());
  if (scanner_.value().device_count > 0 && scanner_.value().devices[0].taken > 0) { // most rooms have no scanner
    inputs::add_to(health, scanner_.value());
  }
  health.wire_generation = wire::kWireVersion.generation;
  health.wire_revision = wire::kWireVersion.revision;
  host_.complete(health);
  const recording::RecorderStatus recorder = host_.recorder();
  health.recorded = recorder.recorded;
  health.record_dropped = recorder.dropped + events_->dropped() + conditions_->dropped();
  health.recorder_failing = recorder.failing;
  health.recording_free_bytes = recorder.space.free_bytes;
  health.recording_bytes_per_s = recorder.space.bytes_per_s;
  health.resident_bytes = runtime::resident_bytes();
  std::copy(boot_id_.begin(), boot_id_.end(), health.boot_id);
  health.published_boot_ns = now.boot_ns;
  health.wall_time_ns = now.utc_ns + now.wall_lead_ns();
  health.clock_error_ns = now.wall_error_ns;
  health.clock_steps = clock_.value().steps;
  health.clock_step_ns = clock_.value().step_ns;
  health.clock_step_time_ns = clock_.value().step_time_ns;
  health_(health, now.utc_ns);
}

} // namespace bregma::server
