#include "server/stages/deformation/pipeline.hpp"

#include <algorithm>
#include <iterator>

namespace bregma::server {
namespace {

constexpr std::int64_t kForceAge_ns = 100'000'000;
constexpr double kMaxStep_s = 0.25; // maximal simulated time after a pause of the loop

// The model's reasons follow "none" on the wire in the order of tissue::ModelReason.
wire::DeformationReason reason_of(tissue::ModelReason reason) {
  static_assert(bregma_wire_DEFORMATION_REASON_DIVERGED - bregma_wire_DEFORMATION_REASON_NONE ==
                static_cast<int>(tissue::ModelReason::kDiverged));
  return static_cast<wire::DeformationReason>(bregma_wire_DEFORMATION_REASON_NONE + static_cast<int>(reason));
}

wire::DeformationStatus status_of(tissue::ModelStatus status) {
  switch (status) {
  case tissue::ModelStatus::kValid:
    return bregma_wire_DEFORMATION_VALID;
  case tissue::ModelStatus::kExtrapolating:
    return bregma_wire_DEFORMATION_EXTRAPOLATING;
  case tissue::ModelStatus::kInvalid:
    break;
  }
  return bregma_wire_DEFORMATION_INVALID;
}

wire::ProbePhase phase_of(tissue::Phase phase) {
  constexpr wire::ProbePhase kPhases[] = {bregma_wire_PROBE_OUTSIDE, bregma_wire_PROBE_INDENTATION,
                                          bregma_wire_PROBE_PENETRATION, bregma_wire_PROBE_WITHDRAWAL};
  return kPhases[static_cast<std::size_t>(phase)];
}

void say_no_model(wire::DeformationState &state, wire::DeformationReason reason) {
  state.status = bregma_wire_DEFORMATION_NO_MODEL;
  state.reason = reason;
  put_unknown(state.displaced_mm);
  for (double *value :
       {&state.error_bound_mm, &state.von_mises_Pa, &state.tip_force_N, &state.shaft_force_N, &state.measured_force_N,
        &state.depth_mm, &state.rupture_force_N, &state.stiffness_scale, &state.behind_ms}) {
    *value = wire::kUnknown;
  }
}

} // namespace

void DeformationPipeline::end_states(std::int64_t now_ns) noexcept {
  for (wire::DeformationState &state : std::span(states_).first(count_)) {
    say_no_model(state, bregma_wire_DEFORMATION_REASON_NONE);
    state.time_ns = now_ns;
    state.ended = true;
  }
}

void DeformationPipeline::handle(const CaseChanged &change) noexcept {
  generation_ = change.generation;
  model_ = nullptr;
  count_ = targets_ = 0;
  steps_made_ = 0;
  if (change.loaded == nullptr) {
    return;
  }
  follow(change.loaded->data->targets, bregma_wire_FOLLOWED_TARGET);
  targets_ = std::min(count_, std::size(predicted_.status));
  follow(change.loaded->data->brain_landmarks, bregma_wire_FOLLOWED_LANDMARK);
}

void DeformationPipeline::follow(const std::vector<casefile::NamedPoint> &points, wire::FollowedKind kind) noexcept {
  // load_case rejects cases with more points.
  const std::size_t room = std::min(points.size(), states_.size() - count_);
  for (const casefile::NamedPoint &point : std::span(points).first(room)) {
    wire::DeformationState &state = states_[count_++];
    state = {};
    (void)wire::set_name(state.point, point.name);
    state.kind = kind;
    put(point.position_mm, state.imaged_mm);
    say_no_model(state, bregma_wire_DEFORMATION_REASON_BUILDING);
  }
}

void DeformationPipeline::handle(const TissueModelReady &ready) noexcept {
  if (ready.generation != generation_) {
    return; // model of a closed case
  }
  model_ = ready.model;
  stepped_ns_ = 0;
  for (std::size_t i = 0; model_ == nullptr && i < count_; ++i) {
    say_no_model(states_[i], bregma_wire_DEFORMATION_REASON_REFUSED);
  }
}

void DeformationPipeline::step(const ProbeView &probe, const ForceView &force, std::int64_t now_ns,
                               int max_steps) noexcept {
  double measured_N = wire::kUnknown;
  steps_made_ = 0;
  if (model_ != nullptr) {
    tissue::ProbeObservation seen;
    seen.seen = probe.live && now_ns <= probe.valid_until_ns;
    seen.pose = {Vector3d::Map(probe.tip_mm), Vector3d::Map(probe.shaft)};
    if (seen.seen && now_ns - force.acquired_ns < kForceAge_ns) {
      // A force up the shaft is the force with which the tissue pushes back.
      measured_N = Vector3d::Map(force.force_N).dot(Vector3d::Map(probe.shaft_in_tool));
      seen.force_N = measured_N;
    }
    const double elapsed_s = stepped_ns_ == 0 ? 0.0 : static_cast<double>(now_ns - stepped_ns_) * 1e-9;
    stepped_ns_ = now_ns;
    (void)model_->update(seen, std::clamp(elapsed_s, 0.0, kMaxStep_s), max_steps);
    steps_made_ = model_->state().steps;
  }
  predicted_.generation = generation_;
  predicted_.time_ns = now_ns;
  for (std::size_t i = 0; i < count_; ++i) {
    states_[i].time_ns = now_ns;
    if (model_ != nullptr) {
      fill(states_[i], model_->points()[i], measured_N);
    }
    if (i < targets_) {
      predicted_.status[i] = states_[i].status;
      std::copy_n(states_[i].displaced_mm, 3, predicted_.position_mm[i]);
    }
  }
}

void DeformationPipeline::fill(wire::DeformationState &state, const tissue::PointPrediction &prediction,
                               double measured_N) noexcept {
  const tissue::BrainState &brain = model_->state();
  state.status = status_of(brain.status);
  state.reason = reason_of(brain.reason);
  if (!prediction.inside) {
    state.status = bregma_wire_DEFORMATION_INVALID;
    state.reason = bregma_wire_DEFORMATION_REASON_POINT_OUTSIDE;
  }
  if (state.status == bregma_wire_DEFORMATION_INVALID) {
    put_unknown(state.displaced_mm);
    state.error_bound_mm = state.von_mises_Pa = wire::kUnknown;
  } else {
    put(prediction.rest_mm + prediction.displacement_mm, state.displaced_mm);
    state.error_bound_mm = prediction.error_bound_mm;
    state.von_mises_Pa = prediction.von_mises_Pa;
  }
  state.phase = phase_of(brain.phase);
  state.tip_force_N = brain.tip_force_N;
  state.shaft_force_N = brain.shaft_force_N;
  state.measured_force_N = measured_N;
  state.depth_mm = brain.depth_mm;
  state.ruptures = static_cast<std::uint32_t>(brain.ruptures);
  state.rupture_force_N = brain.ruptures > 0 ? brain.rupture_force_N : wire::kUnknown;
  state.stiffness_scale = brain.stiffness_scale;
  state.behind_ms = 1e3 * brain.behind_s;
  state.elements = static_cast<std::uint32_t>(model_->solver().elements());
}

} // namespace bregma::server
