#include "algorithms/tissue/model_verdict.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace bregma::tissue {
namespace {

constexpr double kRejected_s = 0.25;
constexpr double kMaxEnergyGain =
    2.0; // energy ratio of tissue that snaps back; a higher ratio comes from an unstable solver
constexpr double kSettlingEnergyFraction =
    0.25;                           // kinetic over elastic energy: half of the displacement may be vibration
constexpr double kUnseen_mm = 0.25; // vibration within a hand's tremor and the tracker's noise
constexpr double kUnmoved_J = 1e-9; // kinetic energy that does not matter: 1 mm/s of a gram

double farthest_mm(const ExplicitSolver &solver) noexcept {
  double farthest = 0.0;
  for (int i = 0; i < solver.nodes(); ++i) {
    farthest = std::max(farthest, solver.displacement_mm(i).norm());
  }
  return farthest;
}

} // namespace

std::string_view name_of(ModelStatus status) {
  constexpr std::string_view kNames[] = {"valid", "extrapolating", "invalid"};
  return kNames[static_cast<std::size_t>(status)];
}

std::string_view sentence_of(ModelReason reason) {
  constexpr std::string_view kSentences[] = {"",
                                             "the tissue is still settling",
                                             "the probe is not seen",
                                             "the probe has jumped",
                                             "the probe's path is not known",
                                             "too slow",
                                             "the probe has left the mesh",
                                             "tetrahedra are inverted for a moment",
                                             "a step was rejected",
                                             "the model was reset to rest"};
  return kSentences[static_cast<std::size_t>(reason)];
}

void ModelVerdict::begin_update() noexcept {
  status_ = ModelStatus::kValid;
  reason_ = ModelReason::kNone;
  went_wrong_ = false;
  residual_vibration_ = 0.0;
}

void ModelVerdict::report(ModelStatus status, ModelReason reason) noexcept {
  if (status > status_) {
    status_ = status;
    reason_ = reason;
  }
}

// This reason takes precedence over all others.
void ModelVerdict::override_reason(ModelReason reason) noexcept {
  status_ = ModelStatus::kInvalid;
  reason_ = reason;
}

void ModelVerdict::observe(const ExplicitSolver &solver) noexcept {
  went_wrong_ = went_wrong_ || solver.clamped_nodes() > 0 || solver.inverted_elements() > 0;
}

void ModelVerdict::commit_or_roll_back(ExplicitSolver &solver, double elapsed_s) noexcept {
  const bool finite = solver.finite();
  const Energies energies = solver.energies();
  const double energy_J = energies.kinetic_J + energies.elastic_J;
  if (finite && solver.clamped_nodes() == 0 && solver.inverted_elements() == 0) {
    rejected_s_ = 0.0;
    kept_J_ = energy_J;
    solver.save();
    if (energies.kinetic_J > kUnmoved_J) {
      residual_vibration_ = std::sqrt(energies.kinetic_J / std::max(energies.elastic_J, kUnmoved_J));
    }
    if (went_wrong_) {
      override_reason(ModelReason::kInverted);
    } else if (energies.kinetic_J > kUnmoved_J + kSettlingEnergyFraction * energies.elastic_J &&
               residual_vibration_ * farthest_mm(solver) > kUnseen_mm) {
      report(ModelStatus::kExtrapolating, ModelReason::kSettling);
    }
    return;
  }
  rejected_s_ += elapsed_s;
  if (!finite || rejected_s_ > kRejected_s) {
    rejected_s_ = 0.0;
    override_reason(ModelReason::kDiverged);
  } else if (energy_J < kMaxEnergyGain * kept_J_) {
    override_reason(ModelReason::kInverted);
  } else {
    solver.restore();
    override_reason(ModelReason::kStepRejected);
  }
}

} // namespace bregma::tissue
