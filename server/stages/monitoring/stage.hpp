// Stage monitoring: predicted TRE, drift test and alarm conditions at its rate (pipeline.hpp).
#pragma once

#include <cstdint>

#include "base/parameters.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/runtime/mailbox.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/host.hpp"
#include "server/stages/monitoring/pipeline.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

void declare(base::ParameterSet &set, MonitoringParameters &parameters);

class MonitoringStage final : public Stage {
public:
  static constexpr const char *kName = "monitoring";
  using Parameters = MonitoringParameters;
  using Inbox = runtime::Mailbox<MonitoringInput, 1024>;

  MonitoringStage(const MonitoringParameters &parameters, const StageContext &context);
  void connect(Inbox &inbox, CaseStore &cases, const runtime::LatestValue<TrackingView> &tracking,
               const runtime::LatestValue<inputs::StreamHealth> &trackers,
               const runtime::LatestValue<inputs::StreamHealth> &sensors,
               const runtime::LatestValue<RegistrationEstimate> &estimate);

  void step(const Moment &now) noexcept override;

  AlarmEvents conditions; // for the session
  runtime::LatestValue<ClockView> clock;

private:
  Host &host_;
  MonitoringPipeline pipeline_;
  Publisher<wire::AccuracyState> states_;
  Inbox *inbox_ = nullptr;
  CaseLease lease_;
  runtime::LatestInput<TrackingView> tracking_;
  runtime::LatestInput<inputs::StreamHealth> trackers_;
  runtime::LatestInput<inputs::StreamHealth> sensors_;
  runtime::LatestInput<RegistrationEstimate> estimate_;
};

} // namespace bregma::server
