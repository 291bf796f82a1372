// The brain under a tracked probe: mesh, material, skull and contacts combined, updated at the rate of a loop.
//
// insertion.hpp has the phases, model_verdict.hpp the validity of an answer. Every answer carries its state. The state
// names what the model cannot know: a probe that was not seen, jumped, or left the mesh; steps that were not made in
// time. docs/tissue_probe.md
//
// Frame: that of the mesh (Image), mm; forces N, stresses Pa, time s. One thread at a time; update() neither allocates
// nor throws, for any input.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "algorithms/tissue/contact/insertion.hpp"
#include "algorithms/tissue/contact/skull.hpp"
#include "algorithms/tissue/model_verdict.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {

struct BrainModelOptions {
  Material material;
  // The damping of 13 Hz modes by a viscosity of 6.6 Pa s (the living brain at 1 to 40 Hz [Herthum 2021]), in tissue of
  // the thesis' stiffness. Slower modes are damped more than by that viscosity, faster ones less.
  SolverOptions solver{.damping_per_s = 60.0};
  SkullOptions skull;
  ProbeShape probe;
  SurfaceContact::Options contact;
  InsertionParameters insertion;
  double max_probe_speed_mm_s = 100.0; // a faster probe is followed at this speed
  double max_unseen_s = 1.0;           // after that the answer is invalid
};

struct ProbeObservation {
  bool seen = false;
  ProbePose pose;
  std::optional<double> force_N; // measured along the shaft; positive: the tissue pushes back
};

struct PointPrediction {
  bool inside = false; // inside the mesh; outside there is no prediction
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
  double depth_mm = 0.0;        // length of the shaft in the tissue; before the rupture, depth of the indentation
  int ruptures = 0;             // number so far
  double rupture_force_N = 0.0; // tip force at the last rupture
  double stiffness_scale = 1.0; // measured over modelled force of the indentation
  double behind_s = 0.0;        // elapsed time that this update did not simulate
  int steps = 0;                // solver steps of this update
};

class BrainModel {
public:
  // points_mm: targets and landmarks to follow. Throws std::invalid_argument like its parts.
  BrainModel(const TetMesh &mesh, std::span<const Eigen::Vector3d> points_mm, const BrainModelOptions &options);
  ~BrainModel();
  BrainModel(const BrainModel &) = delete;
  BrainModel &operator=(const BrainModel &) = delete;

  // elapsed_s: time since the last call; at most max_steps solver steps are made. A pose that is not finite or has no
  // direction counts as not seen, a force that is not finite as not measured, a time that is not positive as zero.
  const BrainState &update(const ProbeObservation &probe, double elapsed_s, int max_steps) noexcept;
  void reset() noexcept; // to rest, without a probe

  [[nodiscard]] const BrainState &state() const noexcept { return state_; }
  [[nodiscard]] std::span<const PointPrediction> points() const noexcept { return predictions_; }
  [[nodiscard]] const ExplicitSolver &solver() const noexcept { return solver_; }
  [[nodiscard]] ExplicitSolver &solver() noexcept { return solver_; }
  [[nodiscard]] const TetBoundary &boundary() const noexcept { return boundary_; }
  [[nodiscard]] const ProbePose &probe() const noexcept { return pose_; } // the model's probe

private:
  [[nodiscard]] bool may_rest(const std::optional<ProbePose> &seen) const noexcept;
  void follow(const std::optional<ProbePose> &seen, double elapsed_s) noexcept;
  void place_probe(const ProbePose &pose) noexcept;
  void move_probe(const ProbePose &to, double elapsed_s) noexcept;
  void describe() noexcept;
  void predict_points() noexcept;
  void reset_to_rest() noexcept;
  [[nodiscard]] bool passes_through(const ProbePose &pose) const noexcept;

  BrainModelOptions options_;
  ExplicitSolver solver_;
  TetBoundary boundary_;
  TetLocator locator_;
  Skull skull_;
  Insertion insertion_;
  ModelVerdict verdict_;

  BrainState state_;
  std::vector<MaterialPoint> points_;
  std::vector<PointPrediction> predictions_;

  Eigen::Vector3d low_mm_ = Eigen::Vector3d::Constant(1e9), high_mm_ = Eigen::Vector3d::Constant(-1e9); // at rest
  ProbePose pose_;
  bool followed_ = false; // pose_ is the pose of a probe
  double unseen_s_ = 0.0;
};

} // namespace bregma::tissue
