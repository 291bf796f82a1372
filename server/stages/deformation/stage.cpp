#include "server/stages/deformation/stage.hpp"

#include <algorithm>
#include <chrono>

#include "server/stages/schedules.hpp"

namespace bregma::server {
namespace {

constexpr double kSolverFraction = 0.7; // fraction of the period
constexpr double kStepSmoothing = 0.1;

} // namespace

void declare(base::ParameterSet &set, DeformationParameters &p) {
  set.number("deformation.rate_hz", &p.rate_hz, "Hz", 0.5, 200, "Rate of the deformation loop.");
  set.number("deformation.field_rate_hz", &p.field_rate_hz, "Hz", 0, 60,
             "Rate at which the displacements of all nodes are published; 0: never.");
  declare_priority(set, DeformationStage::kName, p.priority);
}

int SolverBudget::steps() const noexcept {
  if (fixed_) {
    return *fixed_;
  }
  return step_ns_ > 0.0 ? std::max(1, static_cast<int>(kSolverFraction * static_cast<double>(period_ns_) / step_ns_))
                        : 1;
}

void SolverBudget::spent(std::int64_t duration_ns, int steps) noexcept {
  if (steps > 0) {
    const double each_ns = static_cast<double>(duration_ns) / steps;
    step_ns_ = step_ns_ > 0.0 ? step_ns_ + kStepSmoothing * (each_ns - step_ns_) : each_ns;
  }
}

DeformationStage::DeformationStage(const DeformationParameters &parameters, const StageContext &context)
    : Stage(kName, {.thread = ThreadClass::kBatch,
                    .fifo_priority = static_cast<int>(parameters.priority),
                    .rate_hz = parameters.rate_hz}),
      budget_(period_ns(parameters.rate_hz), context.host.fixed_solver_steps()), states_(context.link),
      fields_(context.link),
      field_period_ns_(parameters.field_rate_hz > 0.0 ? period_ns(parameters.field_rate_hz) : 0) {}

void DeformationStage::connect(CaseStore &cases, const runtime::LatestValue<TissueModelReady> &model,
                               const runtime::LatestValue<ProbeView> &probe,
                               const runtime::LatestValue<ForceView> &force) {
  lease_.connect(cases);
  model_.connect(model);
  probe_.connect(probe);
  force_.connect(force);
}

void DeformationStage::step(const Moment &now) noexcept {
  if (const auto change = lease_.newer()) {
    pipeline_.handle(*change);
    lease_.take(*change);
  }
  take_model();
  (void)probe_.refresh();
  (void)force_.refresh();
  const auto began = std::chrono::steady_clock::now();
  pipeline_.step(probe_.value(), force_.value(), now.utc_ns, budget_.steps());
  budget_.spent(std::chrono::nanoseconds(std::chrono::steady_clock::now() - began).count(), pipeline_.steps_made());
  predicted.store(pipeline_.predicted());
  for (const wire::DeformationState &state : pipeline_.states()) {
    states_(state, now.utc_ns);
  }
  publish_field(now);
}

// A model may arrive before this stage has taken its case. It is void if it arrives after the case was closed.
void DeformationStage::take_model() noexcept {
  model_waits_ = model_.refresh() || model_waits_;
  if (model_waits_ && model_.value().generation <= lease_.generation()) {
    model_waits_ = false;
    pipeline_.handle(model_.value());
  }
}

void DeformationStage::publish_field(const Moment &now) noexcept {
  const tissue::BrainModel *model = pipeline_.model();
  if (model == nullptr || field_period_ns_ == 0 || now.monotonic_ns - field_ns_ < field_period_ns_ ||
      fields_.matched_readers() == 0) {
    return;
  }
  field_ns_ = now.monotonic_ns;
  float *field_mm = model_.value().field_mm; // field of the pipeline's model
  const int nodes = model->solver().nodes();
  for (int i = 0; i < nodes; ++i) {
    Eigen::Vector3f::Map(field_mm + 3 * static_cast<std::ptrdiff_t>(i)) =
        model->solver().displacement_mm(i).cast<float>();
  }
  wire::DeformationField field{};
  (void)wire::set_name(field.model, "brain");
  field.time_ns = now.utc_ns;
  field.status = pipeline_.states().empty() ? bregma_wire_DEFORMATION_NO_MODEL : pipeline_.states().front().status;
  field.displacement_mm._buffer = field_mm;
  field.displacement_mm._length = field.displacement_mm._maximum = static_cast<std::uint32_t>(3 * nodes);
  fields_(field, now.utc_ns);
}

} // namespace bregma::server
