#include "algorithms/tissue/brain_model.hpp"

#include <cmath>
#include <stdexcept>

#include "algorithms/tissue/constitutive.hpp"
#include "algorithms/tissue/units.hpp"

namespace bregma::tissue {
namespace {

constexpr float kSmoothing_s = 0.01F;   // of contact forces, which come in impulses
constexpr float kLetGo_s = 0.05F;       // without a touch, until the tip counts as outside
constexpr double kSearchAgain_mm = 2.0; // of the probe's way, between two looks for triangles near it
constexpr double kTipEdges = 0.5;      // a point force on less than this many edges would tear the mesh, not the tissue
constexpr double kRejected_s = 0.25;   // of rejected updates in a row, until the tissue is put back to rest
constexpr double kHeldEdges = 0.5;     // between the points held along the shaft: no two in one tetrahedron
constexpr double kCutSpacing_mm = 1.0; // of the points along the shaft
constexpr float kCutMemory_m = 0.5e-3F; // spacing of the remembered cut
constexpr float kCutWidth_m = 1.5e-3F;  // tissue nearer to the cut than this is cut
constexpr std::size_t kMostCut = 4096;  // two metres of cuts
constexpr std::size_t kMostEntries = 64;
constexpr float kTurn_m = 0.5e-3F; // of the tip's way back, from which it is no tremor: the phase is another
constexpr double kNear_mm = 20.0;  // of the brain's box: a probe nearer than this wakes the model
constexpr double kJump_mm = 5.0;   // between two looks at the probe, beyond what it can have moved
constexpr double kSwinging = 0.05; // kinetic against elastic energy
constexpr double kQuiet_J = 1e-9;  // kinetic energy that does not matter: 1 mm/s of a gram
// Biomechanical models explain 74 to 82 % of measured brain displacements (PMC2749709): the bound is what they do not.
constexpr double kUnexplained = 0.26;

void check(const BrainModelOptions &options) {
  const auto positive = [](const char *name, double value) {
    if (!(value > 0.0) || !std::isfinite(value)) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", must be positive");
    }
  };
  positive("probe.radius_mm", options.probe.radius_mm);
  positive("probe.cone_half_angle_rad", options.probe.cone_half_angle_rad);
  positive("insertion.rupture_force_N", options.insertion.rupture_force_N);
  positive("insertion.rupture_stress_Pa", options.insertion.rupture_stress_Pa);
  positive("fastest_probe_mm_s", options.fastest_probe_mm_s);
  positive("longest_unseen_s", options.longest_unseen_s);
  for (const double force : {options.insertion.cutting_force_N, options.insertion.shaft_friction_N_per_mm}) {
    if (!(force >= 0.0) || !std::isfinite(force)) {
      throw std::invalid_argument("insertion: a cutting or friction force of " + std::to_string(force) +
                                  ", must not be negative");
    }
  }
}

} // namespace

std::string_view name_of(Phase phase) {
  constexpr std::string_view kNames[] = {"outside", "indentation", "penetration", "withdrawal"};
  return kNames[static_cast<std::size_t>(phase)];
}

std::string_view name_of(ModelStatus status) {
  constexpr std::string_view kNames[] = {"valid", "extrapolating", "invalid"};
  return kNames[static_cast<std::size_t>(status)];
}

std::string_view sentence_of(ModelReason reason) {
  constexpr std::string_view kSentences[] = {"",
                                             "the tissue still swings",
                                             "the probe is not seen; the model holds it where it was",
                                             "the probe has moved faster than the model may follow",
                                             "the probe reappeared inside the brain; its path is not known",
                                             "the model cannot keep up with the clock",
                                             "the probe has left the mesh on its far side",
                                             "the step was taken back: tissue would have been turned inside out",
                                             "the model could not follow and was put back to rest"};
  return kSentences[static_cast<std::size_t>(reason)];
}

BrainModel::BrainModel(const TetMesh &mesh, std::span<const Eigen::Vector3d> points_mm,
                       const BrainModelOptions &options)
    : options_((check(options), options)), solver_(mesh, options.material, options.solver),
      boundary_(boundary_of(solver_.mesh())), locator_(solver_.mesh()),
      skull_(solver_.mesh(), boundary_, options.skull), surface_(solver_.mesh(), boundary_, options.contact),
      cut_(solver_.mesh(), locator_, std::max(kCutSpacing_mm, kHeldEdges * locator_.mean_edge_mm()),
           std::max(options.probe.radius_mm, kTipEdges * locator_.mean_edge_mm())) {
  skull_.hold(solver_);
  solver_.set_contacts({&surface_, &cut_, &skull_});
  for (const Eigen::Vector3d &point : points_mm) {
    points_.push_back(locator_.locate(point));
    predictions_.push_back({.inside = points_.back().inside(), .rest_mm = point});
  }
  for (const Eigen::Vector3d &node : solver_.mesh().nodes_mm) {
    low_mm_ = low_mm_.cwiseMin(node);
    high_mm_ = high_mm_.cwiseMax(node);
  }
  cut_m_.reserve(kMostCut);
  entries_m_.reserve(kMostEntries);
}

BrainModel::~BrainModel() = default;

void BrainModel::reset() noexcept {
  solver_.reset();
  surface_.set_active(false);
  cut_.end();
  correction_.reset();
  cut_m_.clear();
  entries_m_.clear();
  state_ = {};
  engaged_ = false;
  unseen_s_ = rejected_s_ = 0.0;
  path_known_ = true;
  tip_force_ = shaft_force_ = 0.0F;
  predict_points();
}

void BrainModel::say(ModelStatus status, ModelReason reason) noexcept {
  if (status > state_.status) {
    state_.status = status;
    state_.reason = reason;
  }
}

// ---- the probe's way ----

const BrainState &BrainModel::update(const ProbeObservation &probe, double elapsed_s, int most_steps) noexcept {
  state_.status = ModelStatus::kValid;
  state_.reason = ModelReason::kNone;
  held_nodes_ = inverted_ = 0;

  if (may_rest(probe)) {
    engaged_ = false;
    state_.steps = 0;
    state_.behind_s = 0.0;
    return state_;
  }
  const double step_s = solver_.step_s();
  const int wanted = std::max(1, static_cast<int>(std::lround(elapsed_s / step_s)));
  state_.steps = std::clamp(wanted, 0, most_steps);
  state_.behind_s = static_cast<double>(wanted - state_.steps) * step_s;

  engage(probe, elapsed_s);
  if (engaged_) {
    const ProbePose to = probe.seen ? probe.pose : pose_;
    move_probe(to, elapsed_s, state_.steps);
  } else {
    solver_.advance(state_.steps);
  }
  if (probe.seen && probe.force_N) {
    const double modelled = state_.tip_force_N + state_.shaft_force_N;
    if (state_.phase == Phase::kIndentation) {
      correction_.indent(modelled / state_.stiffness_scale, *probe.force_N, elapsed_s);
      if (correction_.dropped()) {
        rupture();
      }
    } else if (state_.phase == Phase::kPenetration) {
      correction_.cut(modelled, *probe.force_N, elapsed_s);
    }
  }
  state_.stiffness_scale = correction_.scale();
  judge(elapsed_s);
  predict_points();
  return state_;
}

// Nothing moves and no probe is near: the answer stays what it is, and costs nothing.
bool BrainModel::may_rest(const ProbeObservation &probe) const noexcept {
  if (state_.phase != Phase::kOutside) {
    return false;
  }
  if (probe.seen) {
    const Eigen::Vector3d beyond = (low_mm_ - probe.pose.tip_mm).cwiseMax(probe.pose.tip_mm - high_mm_).cwiseMax(0.0);
    if (beyond.norm() < kNear_mm) {
      return false;
    }
  }
  const Energies energies = solver_.energies();
  return energies.kinetic_J < kQuiet_J && std::abs(energies.elastic_J) < kQuiet_J;
}

// Where the probe is taken for when it appears, disappears, or jumps.
void BrainModel::engage(const ProbeObservation &probe, double elapsed_s) noexcept {
  if (!probe.seen) {
    unseen_s_ += elapsed_s;
    if (engaged_ && state_.phase != Phase::kOutside) {
      say(unseen_s_ > options_.longest_unseen_s ? ModelStatus::kInvalid : ModelStatus::kExtrapolating,
          ModelReason::kProbeNotSeen);
    }
    return;
  }
  const double way = (probe.pose.tip_mm - pose_.tip_mm).norm();
  const bool jumped = way > options_.fastest_probe_mm_s * (elapsed_s + unseen_s_) + kJump_mm;
  const bool seen_again = unseen_s_ > 0.0;
  unseen_s_ = 0.0;
  if (engaged_ && !jumped && !(seen_again && way > kJump_mm)) {
    return;
  }
  // A first look, or one after a gap that hides the way: the probe is set where it is, without dragging tissue along.
  pose_ = probe.pose;
  engaged_ = true;
  surface_.set_active(true);
  cut_.end();
  state_.phase = Phase::kOutside;
  path_known_ = true;
  searched_at_mm_.setConstant(1e9);
  const auto position = [this](int node) -> Eigen::Vector3d {
    return solver_.mesh().nodes_mm[static_cast<std::size_t>(node)] + solver_.displacement_mm(node);
  };
  if (const MaterialPoint tip = locator_.locate(pose_.tip_mm, position); tip.inside()) {
    surface_.set_active(false);
    cut_.begin(tip.tetrahedron);
    state_.phase = Phase::kPenetration;
    back_m_ = 0.0F;
    path_known_ = false;
  }
}

void BrainModel::move_probe(const ProbePose &to, double elapsed_s, int steps) noexcept {
  const double farthest = options_.fastest_probe_mm_s * elapsed_s;
  const Eigen::Vector3d way = to.tip_mm - pose_.tip_mm;
  const double share = way.norm() > farthest ? farthest / way.norm() : 1.0;
  if (share < 1.0) {
    say(ModelStatus::kExtrapolating, ModelReason::kProbeJumped);
  }
  const Eigen::Vector3d from_tip = pose_.tip_mm;
  const Eigen::Vector3d from_shaft = pose_.shaft;
  const Eigen::Vector3d turn = share * (to.shaft - from_shaft);
  if ((from_tip - searched_at_mm_).norm() > kSearchAgain_mm && state_.phase != Phase::kPenetration) {
    surface_.search(solver_);
    searched_at_mm_ = from_tip;
  }

  PlacedProbe placed;
  placed.radius_m = static_cast<float>(options_.probe.radius_mm / kMetre);
  placed.tip = options_.probe.tip;
  placed.cone_sin = static_cast<float>(std::sin(options_.probe.cone_half_angle_rad));
  placed.cone_cos = static_cast<float>(std::cos(options_.probe.cone_half_angle_rad));
  const double time_s = static_cast<double>(steps) * solver_.step_s();
  if (time_s > 0.0) {
    placed.tip_velocity_m_s = to_metres(share * way / time_s);
    placed.turning_per_s = (turn / time_s).cast<float>();
  }
  for (int i = 1; i <= steps; ++i) {
    const double part = static_cast<double>(i) / static_cast<double>(steps);
    pose_.tip_mm = from_tip + part * share * way;
    pose_.shaft = (from_shaft + part * turn).normalized();
    placed.tip_m = to_metres(pose_.tip_mm);
    placed.shaft = pose_.shaft.cast<float>();
    step(placed);
  }
}

void BrainModel::step(const PlacedProbe &probe) noexcept {
  surface_.place(probe);
  cut_.place(probe);
  advance_m_ = -probe.tip_velocity_m_s.dot(probe.shaft) * static_cast<float>(solver_.step_s());
  const bool cuts = state_.phase == Phase::kPenetration && !cut_before();
  // The measured scale is that of the dent, where it also takes up what the mesh makes too stiff under so small a tip:
  // it does not say how far the tissue gives way to a force that is known, as at the cut.
  const float scale = state_.phase == Phase::kIndentation ? static_cast<float>(state_.stiffness_scale) : 1.0F;
  const double cutting = std::max(0.0, options_.insertion.cutting_force_N + correction_.extra_cutting_N());
  cut_.set_forces({cuts ? static_cast<float>(cutting) : 0.0F,
                   static_cast<float>(options_.insertion.shaft_friction_N_per_mm * kMetre)});
  solver_.advance(1);
  held_nodes_ += solver_.limited_nodes();
  inverted_ += solver_.inverted_elements();

  const auto step_s = static_cast<float>(solver_.step_s());
  const float along = -surface_.force_N().dot(probe.shaft) + cut_.tip_force_N();
  const float rub = -cut_.shaft_force_N().dot(probe.shaft);
  const float follow = std::min(1.0F, step_s / kSmoothing_s);
  tip_force_ += follow * (along * scale - tip_force_);
  shaft_force_ += follow * (rub * scale - shaft_force_);
  state_.tip_force_N = static_cast<double>(tip_force_);
  state_.shaft_force_N = static_cast<double>(shaft_force_);
  change_phase(step_s);
}

// ---- phases ----

void BrainModel::change_phase(float step_s) noexcept {
  untouched_s_ = surface_.touching() > 0 ? 0.0F : untouched_s_ + step_s;
  switch (state_.phase) {
  case Phase::kOutside:
    if (surface_.touching() > 0) {
      state_.phase = Phase::kIndentation;
      correction_.touch();
    }
    break;
  case Phase::kIndentation: {
    state_.depth_mm = surface_.depth_mm();
    if (untouched_s_ > kLetGo_s) {
      state_.phase = Phase::kOutside;
      state_.depth_mm = 0.0;
      break;
    }
    const bool broken = std::any_of(entries_m_.begin(), entries_m_.end(), [this](const Eigen::Vector3f &entry) {
      return (entry - surface_.touched_rest_m()).norm() < static_cast<float>(options_.probe.radius_mm / kMetre);
    });
    const bool torn = state_.tip_force_N > options_.insertion.rupture_force_N ||
                      (surface_.touched_tetrahedron() >= 0 && options_.insertion.rupture_stress_Pa < 1e9 &&
                       von_mises_Pa(solver_.cauchy_Pa(surface_.touched_tetrahedron())) * state_.stiffness_scale >
                           options_.insertion.rupture_stress_Pa);
    if (broken || torn) {
      rupture();
    }
    break;
  }
  case Phase::kPenetration:
  case Phase::kWithdrawal:
    state_.depth_mm = static_cast<double>(cut_.length_m()) * kMetre;
    if (cut_.length_m() <= 0.0F) {
      state_.phase = Phase::kOutside;
      state_.depth_mm = 0.0;
      path_known_ = true;
      cut_.end();
      surface_.set_active(true);
      searched_at_mm_.setConstant(1e9);
      break;
    }
    back_m_ = std::max(0.0F, back_m_ + (state_.phase == Phase::kPenetration ? -advance_m_ : advance_m_));
    if (back_m_ > kTurn_m) {
      state_.phase = state_.phase == Phase::kPenetration ? Phase::kWithdrawal : Phase::kPenetration;
      back_m_ = 0.0F;
    }
    remember_cut();
    break;
  }
}

void BrainModel::rupture() noexcept {
  const bool known = std::any_of(entries_m_.begin(), entries_m_.end(), [this](const Eigen::Vector3f &entry) {
    return (entry - surface_.touched_rest_m()).norm() < static_cast<float>(options_.probe.radius_mm / kMetre);
  });
  if (!known) {
    ++state_.ruptures;
    state_.rupture_force_N = state_.tip_force_N;
    if (entries_m_.size() < kMostEntries) {
      entries_m_.push_back(surface_.touched_rest_m());
    }
  }
  state_.phase = Phase::kPenetration;
  back_m_ = 0.0F;
  surface_.set_active(false);
  cut_.begin(surface_.touched_tetrahedron());
}

// The tissue at the tip lies along an earlier cut, and not at its end.
bool BrainModel::cut_before() const noexcept {
  if (cut_m_.size() < 3 || !cut_.tip().inside()) {
    return false;
  }
  const Eigen::Vector3f tip = cut_.tip_rest_m();
  std::size_t nearest = 0;
  float least = 1e9F;
  for (std::size_t i = 0; i < cut_m_.size(); ++i) {
    const float distance = (cut_m_[i] - tip).squaredNorm();
    if (distance < least) {
      least = distance;
      nearest = i;
    }
  }
  return least < kCutWidth_m * kCutWidth_m && nearest + 2 < cut_m_.size();
}

void BrainModel::remember_cut() noexcept {
  if (!cut_.tip().inside() || cut_before() || cut_m_.size() == kMostCut) {
    return;
  }
  if (cut_m_.empty() || (cut_m_.back() - cut_.tip_rest_m()).norm() > kCutMemory_m) {
    cut_m_.push_back(cut_.tip_rest_m());
  }
}

// ---- what the answer is worth ----

void BrainModel::judge(double elapsed_s) noexcept {
  const bool finite = solver_.finite();
  if (!finite || held_nodes_ > 0 || inverted_ > 0) {
    rejected_s_ += elapsed_s;
    if (!finite || rejected_s_ > kRejected_s) {
      const BrainState before = state_;
      reset();
      state_.ruptures = before.ruptures;
      state_.rupture_force_N = before.rupture_force_N;
      state_.steps = before.steps;
      say(ModelStatus::kInvalid, ModelReason::kDiverged);
      return;
    }
    solver_.restore();
    if (state_.phase == Phase::kIndentation && surface_.touched_tetrahedron() >= 0) {
      rupture(); // a dent that would turn the tissue inside out has torn it, whatever the force
    }
    say(ModelStatus::kInvalid, ModelReason::kStepRejected);
    return;
  }
  rejected_s_ = 0.0;
  solver_.save();
  const bool inside = state_.phase == Phase::kPenetration || state_.phase == Phase::kWithdrawal;
  if (inside && !cut_.tip().inside() && state_.depth_mm > 2.0 * options_.probe.radius_mm) {
    say(ModelStatus::kInvalid, ModelReason::kProbeLeftMesh);
  }
  if (inside && !path_known_) {
    say(ModelStatus::kExtrapolating, ModelReason::kPathUnknown);
  }
  if (state_.behind_s > 0.5 * elapsed_s) {
    say(ModelStatus::kExtrapolating, ModelReason::kTooSlow);
  }
  const Energies energies = solver_.energies();
  if (energies.kinetic_J > kQuiet_J + kSwinging * energies.elastic_J) {
    say(ModelStatus::kExtrapolating, ModelReason::kSettling);
  }
}

void BrainModel::predict_points() noexcept {
  for (std::size_t i = 0; i < points_.size(); ++i) {
    PointPrediction &prediction = predictions_[i];
    if (!prediction.inside) {
      continue;
    }
    prediction.displacement_mm = locator_.place(points_[i], [this](int node) { return solver_.displacement_mm(node); });
    prediction.error_bound_mm = kUnexplained * prediction.displacement_mm.norm();
    prediction.von_mises_Pa = von_mises_Pa(solver_.cauchy_Pa(points_[i].tetrahedron));
  }
}

} // namespace bregma::tissue
