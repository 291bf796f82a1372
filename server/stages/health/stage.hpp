// Stage health: publishes the state of devices, loops, recorder and memory. A worker, because it reads the memory use
// from the kernel.
#pragma once

#include <cstdint>

#include "base/parameters.hpp"
#include "server/inputs/input_guard.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/host.hpp"
#include "server/stages/monitoring/alarm_conditions.hpp"
#include "server/stages/navigation/pipeline.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct HealthParameters {
  double rate_hz = 2.0;
};
void declare(base::ParameterSet &set, HealthParameters &parameters);

class HealthStage final : public Stage {
public:
  static constexpr const char *kName = "health";
  using Parameters = HealthParameters;

  HealthStage(const HealthParameters &parameters, const StageContext &context);
  void connect(const runtime::LatestValue<inputs::StreamHealth> &trackers,
               const runtime::LatestValue<inputs::StreamHealth> &sensors,
               const runtime::LatestValue<inputs::StreamHealth> &scanner,
               const runtime::LatestValue<SessionView> &session, const NavigationEvents &events,
               const AlarmEvents &conditions, const runtime::LatestValue<ClockView> &clock);

  void step(const Moment &now) noexcept override;

private:
  Host &host_;
  Publisher<wire::SystemHealth> health_;
  runtime::LatestInput<inputs::StreamHealth> trackers_;
  runtime::LatestInput<inputs::StreamHealth> sensors_;
  runtime::LatestInput<inputs::StreamHealth> scanner_;
  runtime::LatestInput<SessionView> session_;
  runtime::LatestInput<ClockView> clock_;
  wire::BootIdentity boot_id_;
  const NavigationEvents *events_ = nullptr;
  const AlarmEvents *conditions_ = nullptr;
  std::int64_t started_ns_ = 0; // UTC of the first step
};

} // namespace bregma::server
