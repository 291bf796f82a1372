// Stage deformation: steps the tissue model with the navigated probe and the force sensor, and publishes the predicted
// positions of targets and landmarks (pipeline.hpp).
#pragma once

#include <cstdint>
#include <optional>

#include "base/parameters.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/deformation/pipeline.hpp"
#include "server/stages/host.hpp"
#include "server/stages/ports.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct DeformationParameters {
  double rate_hz = 60.0;
  double field_rate_hz = 10.0; // 0: the fields of all nodes are not published
  std::int64_t priority = 0;   // with SCHED_FIFO the solver would block a core needed by DDS threads
};
void declare(base::ParameterSet &set, DeformationParameters &parameters);

// Number of solver steps per period. One thread.
class SolverBudget {
public:
  // fixed: constant number per period; nullopt: from the measured time of earlier steps.
  SolverBudget(std::int64_t period_ns, std::optional<int> fixed) : period_ns_(period_ns), fixed_(fixed) {}
  [[nodiscard]] int steps() const noexcept;
  void spent(std::int64_t duration_ns, int steps) noexcept;

private:
  std::int64_t period_ns_;
  std::optional<int> fixed_;
  double step_ns_ = 0.0; // smoothed time of one step
};

class DeformationStage final : public Stage {
public:
  static constexpr const char *kName = "deformation";
  using Parameters = DeformationParameters;

  DeformationStage(const DeformationParameters &parameters, const StageContext &context);
  void connect(CaseStore &cases, const runtime::LatestValue<TissueModelReady> &model,
               const runtime::LatestValue<ProbeView> &probe, const runtime::LatestValue<ForceView> &force);

  void step(const Moment &now) noexcept override;

  runtime::LatestValue<PredictedTargets> predicted;

private:
  void take_model() noexcept;
  void publish_field(const Moment &now) noexcept;
  void end_states(const Moment &now) noexcept;

  DeformationPipeline pipeline_;
  SolverBudget budget_;
  Publisher<wire::DeformationState> states_;
  Publisher<wire::DeformationField> fields_;
  CaseLease lease_;
  runtime::LatestInput<TissueModelReady> model_;
  bool model_waits_ = false; // a model waits for its case
  runtime::LatestInput<ProbeView> probe_;
  runtime::LatestInput<ForceView> force_;
  std::int64_t field_period_ns_; // 0: never
  int stress_periods_;           // of the loop per sweep of the stress
  std::int64_t field_ns_ = 0;    // monotonic time of the last field; 0: none of this case
  bool field_read_ = false;      // at that time
};

} // namespace bregma::server
