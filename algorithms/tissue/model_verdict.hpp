// What an answer of the brain model is worth, and why: the worst of what is said in an update; and what becomes of
// steps of the solver that went wrong.
//
// One thread at a time; nothing allocates or throws.
#pragma once

#include <string_view>

#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {

enum class ModelStatus { kValid, kExtrapolating, kInvalid };
enum class ModelReason {
  kNone,
  kSettling,      // the tissue still swings
  kProbeNotSeen,  // the model holds the probe where it was last
  kProbeJumped,   // the model follows at the fastest speed it may
  kPathUnknown,   // the probe reappeared inside: how it came there was not seen
  kTooSlow,       // fewer steps than the time that passed
  kProbeLeftMesh, // the shaft goes through, and out again
  kInverted,      // nodes were held or tetrahedra turned inside out, as when tissue snaps back after a rupture
  kStepRejected,  // the same, with energy that comes from nowhere: back to the last good state
  kDiverged       // steps were rejected for too long: back to rest
};

[[nodiscard]] std::string_view name_of(ModelStatus status);
// For a person, wherever a reason is shown; empty for none.
[[nodiscard]] std::string_view sentence_of(ModelReason reason);

class ModelVerdict {
public:
  void reset() noexcept { *this = {}; }
  void begin_update() noexcept;
  // The first of the worst stays.
  void report(ModelStatus status, ModelReason reason) noexcept;

  // After a step of the solver.
  void observe(const ExplicitSolver &solver) noexcept;
  // After an update's steps: keeps the solver's state where it is sound. Where it is not, lets it go on while its
  // energy could be that of tissue that snaps back (taken back, it would snap back again and again), and else puts back
  // the last state that was kept. After kRejected_s of either, says that the model has diverged, and leaves it to the
  // caller to put all to rest.
  void commit_or_roll_back(ExplicitSolver &solver, double elapsed_s) noexcept;

  [[nodiscard]] ModelStatus status() const noexcept { return status_; }
  [[nodiscard]] ModelReason reason() const noexcept { return reason_; }
  // How far the tissue may swing beyond where it would rest, as a share of its displacement: if all of the kinetic
  // energy became elastic.
  [[nodiscard]] double residual_vibration() const noexcept { return residual_vibration_; }

private:
  void override_reason(ModelReason reason) noexcept;

  ModelStatus status_ = ModelStatus::kValid;
  ModelReason reason_ = ModelReason::kNone;
  bool went_wrong_ = false;
  double residual_vibration_ = 0.0;
  double rejected_s_ = 0.0; // of updates in a row
  double kept_J_ = 0.0;     // energy of the solver's state that was kept last
};

} // namespace bregma::tissue
