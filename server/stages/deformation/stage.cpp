#include "server/stages/deformation/stage.hpp"

#include <algorithm>
#include <chrono>
#include <utility>
#include <vector>

#include "server/stages/deformation/nodal_fields.hpp"
#include "server/stages/schedules.hpp"

namespace bregma::server {
namespace {

constexpr double kSolverFraction = 0.7; // fraction of the period
constexpr double kStepSmoothing = 0.1;

wire::DeformationField empty_field(std::int64_t now_ns) noexcept {
  wire::DeformationField field{};
  (void)wire::set_name(field.model, "brain");
  field.time_ns = now_ns;
  field.status = bregma_wire_DEFORMATION_NO_MODEL;
  return field;
}

// The sequence refers to the values and does not own them.
template <class Sequence> void refer_to(std::vector<float> &values, Sequence &sequence) {
  sequence._buffer = values.data();
  sequence._length = sequence._maximum = static_cast<std::uint32_t>(values.size());
}

} // namespace

void declare(base::ParameterSet &set, DeformationParameters &p) {
  set.number("deformation.rate_hz", &p.rate_hz, "Hz", 0.5, 200, "Rate of the deformation loop.");
  set.number("deformation.field_rate_hz", &p.field_rate_hz, "Hz", 0, 60,
             "Rate at which the displacements and stresses of all nodes are published; 0: never.");
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
      fields_(context.link), field_period_ns_(parameters.field_rate_hz > 0.0 ? period_ns(parameters.field_rate_hz) : 0),
      stress_periods_(static_cast<int>(std::max<std::int64_t>(1, field_period_ns_ / period_ns(parameters.rate_hz)))) {}

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
    end_states(now);
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

void DeformationStage::end_states(const Moment &now) noexcept {
  pipeline_.end_states(now.utc_ns);
  for (const wire::DeformationState &state : pipeline_.states()) {
    states_(state, now.utc_ns);
  }
  field_read_ = false;
  if (std::exchange(field_ns_, 0) != 0) {
    wire::DeformationField last = empty_field(now.utc_ns);
    last.ended = true;
    fields_(last, now.utc_ns);
  }
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
  NodalFields *fields = pipeline_.model() != nullptr ? model_.value().fields : nullptr; // of the pipeline's model
  if (fields == nullptr || field_period_ns_ == 0) {
    return;
  }
  if (field_read_) {
    fields->continue_stress(pipeline_.model()->solver().elements() / stress_periods_ + 1, now.utc_ns);
  }
  if (now.monotonic_ns - field_ns_ < field_period_ns_) {
    return;
  }
  field_ns_ = now.monotonic_ns;
  field_read_ = fields_.matched_readers() > 0;
  if (!field_read_) {
    fields->forget_stress(); // it would be old when a reader joins
    return;
  }
  fields->update_displacements();
  wire::DeformationField field = empty_field(now.utc_ns);
  field.status = pipeline_.states().empty() ? bregma_wire_DEFORMATION_NO_MODEL : pipeline_.states().front().status;
  refer_to(fields->displacement_mm(), field.displacement_mm);
  field.von_mises_time_ns = fields->stress_time_ns();
  if (field.von_mises_time_ns > 0) {
    refer_to(fields->von_mises_Pa(), field.von_mises_Pa);
  }
  fields_(field, now.utc_ns);
}

} // namespace bregma::server
