// Validity of the brain model's answer, with the reason: the worst status reported in an update. Also decides whether
// the solver's steps are kept or rolled back.
//
// One thread at a time; nothing allocates or throws.
#pragma once

#include <string_view>

#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {

enum class ModelStatus { kValid, kExtrapolating, kInvalid };
enum class ModelReason {
  kNone,
  kSettling,      // the tissue is still settling
  kProbeNotSeen,  // the model keeps the probe's last pose
  kProbeJumped,   // the model follows at its maximum speed
  kPathUnknown,   // the probe reappeared inside, its path was not seen
  kTooSlow,       // fewer steps than the elapsed time requires
  kProbeLeftMesh, // the shaft passes through the brain
  kInverted,      // nodes were clamped or tetrahedra inverted, as when tissue snaps back after a rupture
  kStepRejected,  // the same, with unphysical energy: back to the last good state
  kDiverged       // steps were rejected for too long: back to rest
};

[[nodiscard]] std::string_view name_of(ModelStatus status);
[[nodiscard]] std::string_view sentence_of(ModelReason reason); // text for the operator

class ModelVerdict {
public:
  void reset() noexcept { *this = {}; }
  void begin_update() noexcept;
  // The worst status counts; of equal ones the first.
  void report(ModelStatus status, ModelReason reason) noexcept;

  // After a step of the solver.
  void observe(const ExplicitSolver &solver) noexcept;
  // To be called after an update's steps. Saves the solver's state if it is valid. If not, the state is kept as long as
  // its energy could be that of tissue that snaps back (rolled back, it would snap back again); otherwise the last
  // saved state is restored. After kRejected_s of either, reports that the model has diverged; the caller then resets
  // the model to rest.
  void commit_or_roll_back(ExplicitSolver &solver, double elapsed_s) noexcept;

  [[nodiscard]] ModelStatus status() const noexcept { return status_; }
  [[nodiscard]] ModelReason reason() const noexcept { return reason_; }
  // Bound of the residual vibration about the equilibrium, as a fraction of the displacement: the amplitude if all
  // kinetic energy became elastic energy.
  [[nodiscard]] double residual_vibration() const noexcept { return residual_vibration_; }

private:
  void override_reason(ModelReason reason) noexcept;

  ModelStatus status_ = ModelStatus::kValid;
  ModelReason reason_ = ModelReason::kNone;
  bool went_wrong_ = false;
  double residual_vibration_ = 0.0;
  double rejected_s_ = 0.0; // time of consecutive updates
  double kept_J_ = 0.0;     // energy of the solver's state that was kept last
};

} // namespace bregma::tissue
