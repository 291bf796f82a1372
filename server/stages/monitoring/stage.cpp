#include "server/stages/monitoring/stage.hpp"

#include "server/stages/schedules.hpp"

namespace bregma::server {

void declare(base::ParameterSet &set, MonitoringParameters &p) {
  set.number("monitoring.rate_hz", &p.rate_hz, "Hz", 0.5, 100, "Rate of the monitoring loop.");
  set.number("monitoring.false_alarm_rate", &p.false_alarm_rate, "", 1e-9, 0.1,
             "False-alarm probability of the drift test, per check touch.");
  set.number("monitoring.raise_after_ms", &p.raise_after_ms, "ms", 0, 60000,
             "A condition that holds for this long becomes an alarm.");
  set.number("monitoring.clear_after_ms", &p.clear_after_ms, "ms", 0, 60000,
             "An alarm is cleared when its condition has been absent for this long.");
  set.number("monitoring.max_age_ms", &p.max_age_ms, "ms", 1, 10000,
             "A pose that is older than this at its publication raises an alarm.");
  declare_priority(set, MonitoringStage::kName, p.priority);
}

MonitoringStage::MonitoringStage(const MonitoringParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kFifo,
                    .fifo_priority = static_cast<int>(parameters.priority),
                    .rate_hz = parameters.rate_hz}),
      host_(context.host), pipeline_(parameters, conditions), states_(context.link) {}

void MonitoringStage::connect(Inbox &inbox, CaseStore &cases, const runtime::LatestValue<TrackingView> &tracking,
                              const runtime::LatestValue<inputs::StreamHealth> &trackers,
                              const runtime::LatestValue<inputs::StreamHealth> &sensors,
                              const runtime::LatestValue<RegistrationEstimate> &estimate) {
  inbox_ = &inbox;
  lease_.connect(cases);
  tracking_.connect(tracking);
  trackers_.connect(trackers);
  sensors_.connect(sensors);
  estimate_.connect(estimate);
}

void MonitoringStage::step(const Moment &now) noexcept {
  inbox_->take_each([&](const MonitoringInput &input) noexcept {
    const auto *change = std::get_if<CaseChanged>(&input);
    if (change != nullptr) {
      pipeline_.end_state(now.utc_ns);
      states_(pipeline_.accuracy(), now.utc_ns);
    }
    pipeline_.handle(input);
    if (change != nullptr) {
      lease_.take(*change);
    }
  });
  (void)tracking_.refresh();
  (void)trackers_.refresh();
  (void)sensors_.refresh();
  (void)estimate_.refresh();
  pipeline_.step(
      {tracking_.value(), trackers_.value(), sensors_.value(), estimate_.value(), host_.recorder(), now.wall_lead_ns()},
      now.utc_ns);
  clock.store(pipeline_.clock());
  states_(pipeline_.accuracy(), now.utc_ns);
}

} // namespace bregma::server
