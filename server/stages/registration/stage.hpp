// Stage registration: estimates the pose of the head at its rate if the samples have changed (pipeline.hpp).
#pragma once

#include <cstdint>

#include "base/parameters.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/runtime/mailbox.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/registration/pipeline.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

struct RegistrationParameters {
  double rate_hz = 10.0;
  std::int64_t priority = 0;
};
void declare(base::ParameterSet &set, RegistrationParameters &parameters);

class RegistrationStage final : public Stage {
public:
  static constexpr const char *kName = "registration";
  using Parameters = RegistrationParameters;
  using Inbox = runtime::Mailbox<RegistrationInput, 1024>;

  RegistrationStage(const RegistrationParameters &parameters, const StageContext &context);
  void connect(Inbox &inbox, CaseStore &cases, const runtime::LatestValue<PoseSearchAnswer> &answer);

  void step(const Moment &now) noexcept override;

  runtime::LatestValue<RegistrationEstimate> estimate;
  runtime::LatestValue<PoseSearchRequest> search; // request for a search without a start pose

private:
  RegistrationPipeline pipeline_;
  Publisher<wire::RegistrationState> states_;
  Publisher<wire::FiducialReport> reports_;
  Inbox *inbox_ = nullptr;
  CaseLease lease_;
  runtime::LatestInput<PoseSearchAnswer> answer_;
};

} // namespace bregma::server
