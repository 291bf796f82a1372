// The deformation pipeline: drives the tissue model with the navigated probe and the force sensor. For every target and
// every landmark in the brain it reports the imaged position, the predicted position and the validity. Without a model
// it reports that and predicts nothing.
//
// The stage tissue_model builds the model. One thread; no allocation in step(). The caller passes the time: ns UTC.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "algorithms/tissue/brain_model.hpp"
#include "server/stages/loaded_case.hpp"
#include "server/stages/views.hpp"
#include "server/stages/wire_values.hpp"

namespace bregma::server {

class DeformationPipeline {
public:
  void handle(const CaseChanged &change) noexcept;
  void handle(const TissueModelReady &ready) noexcept;

  // Turns the states into the last ones of their instances: the case is closed or replaced.
  void end_states(std::int64_t now_ns) noexcept;
  // max_steps: maximal number of solver steps.
  void step(const ProbeView &probe, const ForceView &force, std::int64_t now_ns, int max_steps) noexcept;

  // States of the case's targets, then of the landmarks in its brain, both in the case's order.
  [[nodiscard]] std::span<const wire::DeformationState> states() const noexcept { return {states_.data(), count_}; }
  [[nodiscard]] const PredictedTargets &predicted() const noexcept { return predicted_; }
  [[nodiscard]] const tissue::BrainModel *model() const noexcept { return model_; }
  [[nodiscard]] int steps_made() const noexcept { return steps_made_; } // solver steps in the last step()
  [[nodiscard]] std::uint64_t case_generation() const noexcept { return generation_; }

private:
  void follow(const std::vector<casefile::NamedPoint> &points, wire::FollowedKind kind) noexcept;
  void fill(wire::DeformationState &state, const tissue::PointPrediction &prediction, double measured_N) noexcept;

  std::array<wire::DeformationState, bregma_wire_MAX_TARGETS + bregma_wire_MAX_BRAIN_LANDMARKS> states_{};
  std::size_t count_ = 0, targets_ = 0; // number of states, and of targets among them
  std::uint64_t generation_ = 0;
  tissue::BrainModel *model_ = nullptr;
  PredictedTargets predicted_;
  std::int64_t stepped_ns_ = 0;
  int steps_made_ = 0;
};

} // namespace bregma::server
