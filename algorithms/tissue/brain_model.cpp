#include "algorithms/tissue/brain_model.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/material/constitutive.hpp"
#include "algorithms/tissue/material/units.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

constexpr double kNear_mm = 20.0;   // a probe nearer than this to the brain's box wakes the model
constexpr double kJump_mm = 5.0;    // between two samples of the probe, in addition to its possible motion
constexpr double kLever_mm = 50.0;  // at this distance from the tip a rotation is limited to the probe's maximum speed
constexpr double kShaft_mm = 400.0; // length of a shaft that could pass through the brain
constexpr double kQuiet_J = 1e-9;   // negligible energy: a gram at 1 mm/s
// Biomechanical models explain 74 to 82 % of measured brain displacements [PMC2749709]. The bound is the unexplained
// part, plus residual vibration.
constexpr double kUnexplained = 0.26;

const BrainModelOptions &checked(const BrainModelOptions &options) {
  const auto positive = [](const char *name, double value) {
    if (!(value > 0.0) || !std::isfinite(value)) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", must be positive");
    }
  };
  positive("max_probe_speed_mm_s", options.max_probe_speed_mm_s);
  positive("max_unseen_s", options.max_unseen_s);
  return options;
}

// The pose, if it is valid.
std::optional<ProbePose> pose_of(const ProbeObservation &probe) noexcept {
  const double length = probe.pose.shaft.norm();
  if (!probe.seen || !probe.pose.tip_mm.allFinite() || !std::isfinite(length) || length < 1e-6) {
    return std::nullopt;
  }
  return ProbePose{probe.pose.tip_mm, probe.pose.shaft / length};
}

PlacedProbe placed(const ProbeShape &shape) noexcept {
  PlacedProbe out;
  out.radius_m = static_cast<float>(shape.radius_mm / kMetre);
  out.tip = shape.tip;
  out.cone_sin = static_cast<float>(std::sin(shape.cone_half_angle_rad));
  out.cone_cos = static_cast<float>(std::cos(shape.cone_half_angle_rad));
  return out;
}

} // namespace

BrainModel::BrainModel(const TetMesh &mesh, std::span<const Vector3d> points_mm, const BrainModelOptions &options)
    : options_(checked(options)), solver_(mesh, options.material, options.solver),
      boundary_(boundary_of(solver_.mesh())), locator_(solver_.mesh()),
      skull_(solver_.mesh(), boundary_, options.skull),
      insertion_(solver_.mesh(), boundary_, locator_, options.probe, options.contact, options.insertion) {
  skull_.apply_supports(solver_);
  const std::array<Contact *, 2> probe = insertion_.contacts();
  solver_.set_contacts({probe[0], probe[1], &skull_});
  for (const Vector3d &point : points_mm) {
    points_.push_back(locator_.locate(point));
    predictions_.push_back({.inside = points_.back().inside(), .rest_mm = point});
  }
  for (const Vector3d &node : solver_.mesh().nodes_mm) {
    low_mm_ = low_mm_.cwiseMin(node);
    high_mm_ = high_mm_.cwiseMax(node);
  }
}

BrainModel::~BrainModel() = default;

void BrainModel::reset_to_rest() noexcept {
  solver_.reset();
  solver_.save();
  insertion_.reset();
  followed_ = false;
  unseen_s_ = 0.0;
}

void BrainModel::reset() noexcept {
  reset_to_rest();
  verdict_.reset();
  state_ = {};
  predict_points();
}

const BrainState &BrainModel::update(const ProbeObservation &probe, double elapsed_s, int max_steps) noexcept {
  verdict_.begin_update();
  elapsed_s = elapsed_s > 0.0 && std::isfinite(elapsed_s) ? elapsed_s : 0.0;
  const std::optional<ProbePose> seen = pose_of(probe);
  state_.steps = 0;
  state_.behind_s = 0.0;
  if (may_rest(seen)) {
    followed_ = false;
    describe();
    return state_;
  }
  const double step_s = solver_.step_s();
  const double wanted = elapsed_s > 0.0 ? std::max(1.0, std::round(elapsed_s / step_s)) : 0.0;
  state_.steps = static_cast<int>(std::min(wanted, static_cast<double>(std::max(max_steps, 0))));
  state_.behind_s = (wanted - state_.steps) * step_s;

  follow(seen, elapsed_s);
  if (seen && probe.force_N && std::isfinite(*probe.force_N)) {
    insertion_.measure(*probe.force_N, elapsed_s);
  }
  if (insertion_.left_mesh()) {
    verdict_.report(ModelStatus::kInvalid, ModelReason::kProbeLeftMesh);
  }
  if (insertion_.inside() && !insertion_.path_known()) {
    verdict_.report(ModelStatus::kExtrapolating, ModelReason::kPathUnknown);
  }
  if (state_.behind_s > 0.5 * elapsed_s) {
    verdict_.report(ModelStatus::kExtrapolating, ModelReason::kTooSlow);
  }
  verdict_.commit_or_roll_back(solver_, elapsed_s);
  if (verdict_.reason() == ModelReason::kStepRejected || verdict_.reason() == ModelReason::kInverted) {
    insertion_.force_rupture();
  } else if (verdict_.reason() == ModelReason::kDiverged) {
    reset_to_rest();
  }
  describe();
  predict_points();
  return state_;
}

// Nothing moves and no probe is near: the answer does not change, and no steps are made.
bool BrainModel::may_rest(const std::optional<ProbePose> &seen) const noexcept {
  if (insertion_.phase() != Phase::kOutside) {
    return false;
  }
  if (seen) {
    const Vector3d beyond = (low_mm_ - seen->tip_mm).cwiseMax(seen->tip_mm - high_mm_).cwiseMax(0.0);
    if (beyond.norm() < kNear_mm || passes_through(*seen)) {
      return false;
    }
  }
  const Energies energies = solver_.energies();
  return energies.kinetic_J < kQuiet_J && std::abs(energies.elastic_J) < kQuiet_J;
}

// The shaft crosses the brain at rest, with the tip on the far side.
bool BrainModel::passes_through(const ProbePose &pose) const noexcept {
  return skull_.surface().segment_hits(pose.tip_mm + options_.probe.radius_mm * pose.shaft,
                                       pose.tip_mm + kShaft_mm * pose.shaft);
}

// Moves the model's probe to the observed pose, or places it there when its path was not seen.
void BrainModel::follow(const std::optional<ProbePose> &seen, double elapsed_s) noexcept {
  if (!seen) {
    unseen_s_ += elapsed_s;
    if (followed_ && insertion_.phase() != Phase::kOutside) {
      verdict_.report(unseen_s_ > options_.max_unseen_s ? ModelStatus::kInvalid : ModelStatus::kExtrapolating,
                      ModelReason::kProbeNotSeen);
    }
    move_probe(pose_, elapsed_s);
    return;
  }
  const double path_mm = (seen->tip_mm - pose_.tip_mm).norm();
  const bool jumped = path_mm > options_.max_probe_speed_mm_s * (elapsed_s + unseen_s_) + kJump_mm;
  const bool hidden = unseen_s_ > 0.0 && path_mm > kJump_mm;
  unseen_s_ = 0.0;
  if (!followed_ || jumped || hidden) {
    place_probe(*seen);
  }
  move_probe(*seen, elapsed_s);
}

// For a first observation, or one after a gap: the probe is placed at its pose without dragging tissue along.
void BrainModel::place_probe(const ProbePose &pose) noexcept {
  if (followed_ && insertion_.phase() != Phase::kOutside) {
    verdict_.report(ModelStatus::kExtrapolating, ModelReason::kProbeJumped);
  }
  pose_ = pose;
  followed_ = true;
  const auto position = [this](int node) -> Vector3d {
    return solver_.mesh().nodes_mm[static_cast<std::size_t>(node)] + solver_.displacement_mm(node);
  };
  insertion_.reappear_outside();
  if (const MaterialPoint tip = locator_.locate(pose_.tip_mm, position); tip.inside()) {
    insertion_.reappear_inside(tip.tetrahedron);
  } else if (passes_through(pose_)) {
    // Tissue cannot yield to such a probe: it is ignored until it is elsewhere.
    insertion_.remove_probe();
    followed_ = false;
    verdict_.report(ModelStatus::kInvalid, ModelReason::kProbeLeftMesh);
  }
}

void BrainModel::move_probe(const ProbePose &to, double elapsed_s) noexcept {
  if (state_.steps == 0) {
    return;
  }
  const Vector3d path_mm = to.tip_mm - pose_.tip_mm;
  const Eigen::AngleAxisd turn(Eigen::Quaterniond::FromTwoVectors(pose_.shaft, to.shaft));
  const double farthest_mm = options_.max_probe_speed_mm_s * elapsed_s;
  const double fraction = std::min(1.0, farthest_mm / std::max({path_mm.norm(), kLever_mm * turn.angle(), 1e-9}));
  if (followed_ && fraction < 1.0) {
    verdict_.report(ModelStatus::kExtrapolating, ModelReason::kProbeJumped);
  }
  const ProbePose from = pose_;
  const double time_s = state_.steps * solver_.step_s();
  PlacedProbe probe = placed(options_.probe);
  probe.tip_velocity_m_s = to_metres(fraction * path_mm / time_s);
  for (int i = 1; i <= state_.steps; ++i) {
    const double part = fraction * i / state_.steps;
    pose_.tip_mm = from.tip_mm + part * path_mm;
    pose_.shaft = (Eigen::AngleAxisd(part * turn.angle(), turn.axis()) * from.shaft).normalized();
    probe.tip_m = to_metres(pose_.tip_mm);
    probe.shaft = pose_.shaft.cast<float>();
    probe.turning_per_s = (fraction * turn.angle() / time_s * turn.axis().cross(pose_.shaft)).cast<float>();
    insertion_.begin_step(probe, solver_);
    solver_.advance(1);
    insertion_.end_step(solver_);
    verdict_.observe(solver_);
  }
}

void BrainModel::describe() noexcept {
  state_.status = verdict_.status();
  state_.reason = verdict_.reason();
  state_.phase = insertion_.phase();
  state_.tip_force_N = insertion_.tip_force_N();
  state_.shaft_force_N = insertion_.shaft_force_N();
  state_.depth_mm = insertion_.depth_mm();
  state_.ruptures = insertion_.ruptures();
  state_.rupture_force_N = insertion_.rupture_force_N();
  state_.stiffness_scale = insertion_.stiffness_scale();
}

void BrainModel::predict_points() noexcept {
  for (std::size_t i = 0; i < points_.size(); ++i) {
    PointPrediction &prediction = predictions_[i];
    if (!prediction.inside) {
      continue;
    }
    prediction.displacement_mm = locator_.place(points_[i], [this](int node) { return solver_.displacement_mm(node); });
    prediction.error_bound_mm =
        std::hypot(kUnexplained, verdict_.residual_vibration()) * prediction.displacement_mm.norm();
    prediction.von_mises_Pa = von_mises_Pa(solver_.cauchy_Pa(points_[i].tetrahedron));
  }
}

} // namespace bregma::tissue
