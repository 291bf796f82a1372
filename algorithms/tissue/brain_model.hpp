// The brain under a tracked probe: mesh, material, skull and contacts put together, driven at the rate of a loop.
//
// Phases as in seed 000, section 6.4: the tip indents the surface until it ruptures, then cuts its way; coming back, it
// only rubs. What a force sensor measures corrects the model's stiffness and its cutting force.
//
// Never an answer without its state: what the model cannot know (a probe that was not seen, that jumped, or left the
// mesh; steps that were not made in time) is said with the answer. Frame: that of the mesh (Image), mm; forces N,
// stresses Pa, time s. One thread at a time; update() neither allocates nor throws.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "algorithms/tissue/explicit_solver.hpp"
#include "algorithms/tissue/force_correction.hpp"
#include "algorithms/tissue/probe_contact.hpp"
#include "algorithms/tissue/skull.hpp"

namespace bregma::tissue {

enum class Phase { kOutside, kIndentation, kPenetration, kWithdrawal };
enum class ModelStatus { kValid, kExtrapolating, kInvalid };
enum class ModelReason {
  kNone,
  kSettling,      // the tissue still swings
  kProbeNotSeen,  // the model holds the probe where it was last
  kProbeJumped,   // the model follows at the fastest speed it may
  kPathUnknown,   // the probe reappeared inside: how it came there was not seen
  kTooSlow,       // fewer steps than the time that passed
  kProbeLeftMesh, // the shaft goes through, and out again
  kStepRejected,  // nodes were held or tetrahedra turned inside out: back to the last good state
  kDiverged       // steps were rejected for too long: back to rest
};

[[nodiscard]] std::string_view name_of(Phase phase);
[[nodiscard]] std::string_view name_of(ModelStatus status);
[[nodiscard]] std::string_view sentence_of(ModelReason reason); // for a person

struct InsertionParameters {
  double rupture_force_N = 0.12;  // along the probe, at which the surface breaks
  double rupture_stress_Pa = 1e9; // von Mises, in the tissue before the tip
  double cutting_force_N = 0.06;
  double shaft_friction_N_per_mm = 0.0006;
};

struct BrainModelOptions {
  Material material;
  SolverOptions solver{.damping_per_s = 20.0};
  SkullOptions skull;
  ProbeShape probe;
  SurfaceContact::Options contact;
  InsertionParameters insertion;
  double fastest_probe_mm_s = 100.0; // what moves faster is followed at this speed
  double longest_unseen_s = 1.0;     // then the answer is invalid
};

struct ProbeObservation {
  bool seen = false;
  ProbePose pose;
  std::optional<double> force_N; // measured along the shaft, positive where the tissue pushes back
};

struct PointPrediction {
  bool inside = false; // the mesh; else nothing is predicted
  Eigen::Vector3d rest_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d displacement_mm = Eigen::Vector3d::Zero();
  double error_bound_mm = 0.0;
  double von_mises_Pa = 0.0;
};

struct BrainState {
  ModelStatus status = ModelStatus::kValid;
  ModelReason reason = ModelReason::kNone;
  Phase phase = Phase::kOutside;
  double tip_force_N = 0.0;     // along the shaft, at the tip
  double shaft_force_N = 0.0;   // along the shaft, by friction
  double depth_mm = 0.0;        // of the shaft inside the tissue; before the rupture, of the dent
  int ruptures = 0;             // so far
  double rupture_force_N = 0.0; // of the last one
  double stiffness_scale = 1.0; // measured against modelled force of the dent
  double behind_s = 0.0;        // time that was not simulated in this update
  int steps = 0;                // of this update
};

class BrainModel {
public:
  // points_mm: targets and landmarks to follow. Throws std::invalid_argument as the parts do.
  BrainModel(const TetMesh &mesh, std::span<const Eigen::Vector3d> points_mm, const BrainModelOptions &options);
  ~BrainModel();
  BrainModel(const BrainModel &) = delete;
  BrainModel &operator=(const BrainModel &) = delete;

  // elapsed_s since the last call; at most most_steps of the solver are made.
  const BrainState &update(const ProbeObservation &probe, double elapsed_s, int most_steps) noexcept;
  void reset() noexcept; // to rest, without a probe

  [[nodiscard]] const BrainState &state() const noexcept { return state_; }
  [[nodiscard]] std::span<const PointPrediction> points() const noexcept { return predictions_; }
  [[nodiscard]] const ExplicitSolver &solver() const noexcept { return solver_; }
  [[nodiscard]] ExplicitSolver &solver() noexcept { return solver_; }
  [[nodiscard]] const TetBoundary &boundary() const noexcept { return boundary_; }
  [[nodiscard]] const ProbePose &probe() const noexcept { return pose_; } // as the model has it

private:
  [[nodiscard]] bool may_rest(const ProbeObservation &probe) const noexcept;
  void engage(const ProbeObservation &probe, double elapsed_s) noexcept;
  void move_probe(const ProbePose &to, double elapsed_s, int steps) noexcept;
  void step(const PlacedProbe &probe) noexcept;
  void change_phase(float step_s) noexcept;
  void rupture() noexcept;
  [[nodiscard]] bool cut_before() const noexcept;
  void remember_cut() noexcept;
  void judge(double elapsed_s) noexcept;
  void predict_points() noexcept;
  void say(ModelStatus status, ModelReason reason) noexcept; // the worst of what is said stays

  BrainModelOptions options_;
  ExplicitSolver solver_;
  TetBoundary boundary_;
  TetLocator locator_;
  Skull skull_;
  SurfaceContact surface_;
  CutContact cut_;
  ForceCorrection correction_;

  BrainState state_;
  std::vector<MaterialPoint> points_;
  std::vector<PointPrediction> predictions_;

  Eigen::Vector3d low_mm_ = Eigen::Vector3d::Constant(1e9), high_mm_ = Eigen::Vector3d::Constant(-1e9); // at rest
  ProbePose pose_;
  bool engaged_ = false; // pose_ has been set
  double unseen_s_ = 0.0, rejected_s_ = 0.0;
  bool path_known_ = true;
  Eigen::Vector3d searched_at_mm_ = Eigen::Vector3d::Constant(1e9);
  float advance_m_ = 0.0F;                      // of the tip along the shaft in the present step, into the tissue
  float back_m_ = 0.0F;                         // of the tip, from its farthest in the present phase
  float tip_force_ = 0.0F, shaft_force_ = 0.0F; // smoothed
  float untouched_s_ = 0.0F;
  int held_nodes_ = 0, inverted_ = 0;
  std::vector<Eigen::Vector3f> cut_m_; // where the tip has been, at rest
  std::vector<Eigen::Vector3f> entries_m_;
};

} // namespace bregma::tissue
