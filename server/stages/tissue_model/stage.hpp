// Stage tissue model: the worker that makes the tissue model after a case was loaded. Meanwhile the deformation stage
// continues and reports that the model is being built.
#pragma once

#include <cstdint>
#include <string>

#include "algorithms/tissue/brain_model.hpp"
#include "base/parameters.hpp"
#include "case_model/brain.hpp"
#include "server/runtime/latest_value.hpp"
#include "server/stages/case_store.hpp"
#include "server/stages/host.hpp"
#include "server/stages/stage.hpp"
#include "server/stages/tissue_model/tissue_builder.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct TissueModelParameters {
  std::int64_t elements = 20000; // 0: no tissue model
  double entry_edge_mm = case_model::BrainMeshOptions{}.entry_edge_mm;
  std::int64_t threads = 1;
  std::string material = "thesis";
  bool sliding = true;
  double gap_mm = 0.0;
  double craniotomy_radius_mm = case_model::kCraniotomyRadius_mm;
  double probe_radius_mm = 3.0;
  double rupture_force_N = tissue::InsertionParameters{}.rupture_force_N;
  double cutting_force_N = tissue::InsertionParameters{}.cutting_force_N;
  double shaft_friction_N_per_mm = tissue::InsertionParameters{}.shaft_friction_N_per_mm;
};
void declare(base::ParameterSet &set, TissueModelParameters &parameters);

class TissueModelStage final : public Stage {
public:
  static constexpr const char *kName = "tissue model";
  using Parameters = TissueModelParameters;

  TissueModelStage(const TissueModelParameters &parameters, const StageContext &context);
  void connect(CaseStore &cases);

  void step(const Moment &now) noexcept override;

  runtime::LatestValue<TissueModelReady> model;

private:
  Host &host_;
  TissueBuilder builder_;
  CaseLease lease_;
};

} // namespace bregma::server
