#include "algorithms/tissue/contact/insertion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "algorithms/tissue/material/constitutive.hpp"
#include "algorithms/tissue/material/units.hpp"

namespace bregma::tissue {
namespace {

constexpr float kSmoothing_s = 0.01F; // smoothing of contact forces, which are impulses
// Time without contact after which the probe counts as outside: after the rupture the surface takes some milliseconds
// to close around the tip.
constexpr float kContactLoss_s = 0.05F;
constexpr float kSearchAgain_m = 2e-3F;   // move of the tip after which triangles near the probe are searched again
constexpr float kSearchAgainTurn = 0.02F; // the same for its rotation, rad: 2 mm at the end of 100 mm
constexpr float kTurn_m = 0.5e-3F;        // retreat of the tip that is more than tremor and changes the phase
constexpr float kTipRadii = 2.0F;         // height up the shaft that counts as tip
constexpr double kSectionRadiusEdges =
    0.5; // minimum radius of a section in edges: on fewer, the force would tear the mesh, not the tissue
constexpr double kSectionSpacingEdges = 0.5; // minimum spacing in edges: no two centres in one tetrahedron
constexpr double kSectionSpacing_mm = 1.0;   // spacing of the sections along the shaft
constexpr float kCutMemory_m = 0.5e-3F;      // spacing of the remembered cut
constexpr float kCutWidth_m = 1.5e-3F;       // tissue nearer to the cut than this counts as cut
constexpr std::size_t kMaxCutPoints = 4096;  // two metres of cuts
constexpr std::size_t kMaxEntries = 64;
constexpr double kNoStress_Pa = 1e9; // a limit that is not tested

void check(const ProbeShape &probe, const InsertionParameters &parameters) {
  const auto positive = [](const char *name, double value) {
    if (!(value > 0.0) || !std::isfinite(value)) {
      throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", must be positive");
    }
  };
  positive("probe.radius_mm", probe.radius_mm);
  positive("probe.cone_half_angle_rad", probe.cone_half_angle_rad);
  positive("insertion.rupture_force_N", parameters.rupture_force_N);
  positive("insertion.rupture_stress_Pa", parameters.rupture_stress_Pa);
  for (const double force : {parameters.cutting_force_N, parameters.shaft_friction_N_per_mm}) {
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

Insertion::Insertion(const TetMesh &mesh, const TetBoundary &boundary, const TetLocator &locator,
                     const ProbeShape &probe, const SurfaceContact::Options &contact,
                     const InsertionParameters &parameters)
    : shape_((check(probe, parameters), probe)), parameters_(parameters), surface_(mesh, boundary, contact),
      cut_(mesh, locator, std::max(kSectionSpacing_mm, kSectionSpacingEdges * mean_edge_mm(mesh)),
           std::max(probe.radius_mm, kSectionRadiusEdges * mean_edge_mm(mesh))) {
  cut_m_.reserve(kMaxCutPoints);
  entries_m_.reserve(kMaxEntries);
}

// ---- position of the probe ----

void Insertion::reset() noexcept {
  remove_probe();
  correction_.reset();
  cut_m_.clear();
  entries_m_.clear();
  ruptures_ = 0;
  rupture_force_N_ = 0.0;
  tip_force_N_ = shaft_force_N_ = 0.0F;
}

void Insertion::remove_probe() noexcept {
  reset_to_outside();
  surface_.set_active(false);
}

void Insertion::reappear_outside() noexcept { reset_to_outside(); }

void Insertion::reappear_inside(int tetrahedron) noexcept {
  surface_.set_active(false);
  cut_.begin(tetrahedron);
  phase_ = Phase::kPenetration;
  path_known_ = false;
  alone_s_ = back_m_ = 0.0F;
}

void Insertion::reset_to_outside() noexcept {
  phase_ = Phase::kOutside;
  depth_mm_ = 0.0;
  alone_s_ = 0.0F;
  path_known_ = true;
  cut_.end();
  surface_.set_active(true);
  searched_ = false;
}

bool Insertion::left_mesh() const noexcept {
  return inside() && !cut_.tip().inside() && static_cast<double>(cut_.length_m()) * kMetre > 2.0 * shape_.radius_mm;
}

// ---- a step ----

void Insertion::begin_step(const PlacedProbe &probe, const ExplicitSolver &solver) noexcept {
  probe_ = probe;
  surface_.place(probe);
  cut_.place(probe);
  if (!inside() && (!searched_ || (probe.tip_m - searched_for_.tip_m).norm() > kSearchAgain_m ||
                    (probe.shaft - searched_for_.shaft).norm() > kSearchAgainTurn)) {
    surface_.search(solver);
    searched_for_ = probe;
    searched_ = true;
  }
  advance_m_ = -probe.tip_velocity_m_s.dot(probe.shaft) * static_cast<float>(solver.step_s());
  const bool cuts = phase_ == Phase::kPenetration && !cut_before();
  const double cutting_N = std::max(0.0, parameters_.cutting_force_N + correction_.extra_cutting_N());
  // The pressure that cuts under the tip also cuts at the side of the shaft.
  const double sideways_N_per_mm = 2.0 * cutting_N / (std::numbers::pi * shape_.radius_mm);
  cut_.set_forces({.cutting_N = cuts ? static_cast<float>(cutting_N) : 0.0F,
                   .friction_N_per_m = static_cast<float>(parameters_.shaft_friction_N_per_mm * kMetre),
                   .sideways_N_per_m = static_cast<float>(sideways_N_per_mm * kMetre)});
}

void Insertion::end_step(const ExplicitSolver &solver) noexcept {
  const auto step_s = static_cast<float>(solver.step_s());
  // The measured scale applies to the indentation only. There it also corrects a mesh that is too stiff under a small
  // tip, so that it does not describe the tissue's response to a known force, as at the cut.
  const float scale = phase_ == Phase::kIndentation ? static_cast<float>(correction_.scale()) : 1.0F;
  const float follow = std::min(1.0F, step_s / kSmoothing_s);
  const float tip_N = -surface_.force_N().dot(probe_.shaft) + cut_.tip_force_N();
  const float shaft_N = -cut_.shaft_force_N().dot(probe_.shaft);
  tip_force_N_ += follow * (tip_N * scale - tip_force_N_);
  shaft_force_N_ += follow * (shaft_N * scale - shaft_force_N_);

  const bool held = inside() ? cut_.length_m() > 0.0F : surface_.touching() > 0;
  alone_s_ = held ? 0.0F : alone_s_ + step_s;
  switch (phase_) {
  case Phase::kOutside:
    if (held) {
      phase_ = Phase::kIndentation;
      correction_.touch();
    }
    break;
  case Phase::kIndentation:
    indent(solver);
    break;
  case Phase::kPenetration:
  case Phase::kWithdrawal:
    depth_mm_ = static_cast<double>(cut_.length_m()) * kMetre;
    if (alone_s_ > kContactLoss_s) {
      reset_to_outside();
      break;
    }
    back_m_ = std::max(0.0F, back_m_ + (phase_ == Phase::kPenetration ? -advance_m_ : advance_m_));
    if (back_m_ > kTurn_m) {
      phase_ = phase_ == Phase::kPenetration ? Phase::kWithdrawal : Phase::kPenetration;
      back_m_ = 0.0F;
    }
    remember_cut();
    break;
  }
}

void Insertion::indent(const ExplicitSolver &solver) noexcept {
  depth_mm_ = surface_.depth_mm();
  if (alone_s_ > kContactLoss_s) {
    reset_to_outside();
    return;
  }
  const bool by_force = tip_force_N() > parameters_.rupture_force_N;
  const bool by_stress = parameters_.rupture_stress_Pa < kNoStress_Pa && surface_.touched_tetrahedron() >= 0 &&
                         von_mises_Pa(solver.cauchy_Pa(surface_.touched_tetrahedron())) * stiffness_scale() >
                             parameters_.rupture_stress_Pa;
  if (touches_with_tip() && (by_force || by_stress || at_entry())) {
    rupture();
  }
}

void Insertion::rupture() noexcept {
  if (!at_entry()) {
    ++ruptures_;
    rupture_force_N_ = tip_force_N();
    if (entries_m_.size() < kMaxEntries) {
      entries_m_.push_back(surface_.touched_rest_m());
    }
  }
  phase_ = Phase::kPenetration;
  alone_s_ = back_m_ = 0.0F;
  surface_.set_active(false);
  cut_.begin(surface_.touched_tetrahedron());
}

void Insertion::force_rupture() noexcept {
  if (phase_ == Phase::kIndentation && surface_.touched_tetrahedron() >= 0 && touches_with_tip()) {
    rupture();
  }
}

void Insertion::measure(double force_N, double elapsed_s) noexcept {
  const double modelled_N = tip_force_N() + shaft_force_N();
  if (phase_ == Phase::kIndentation) {
    correction_.indent(modelled_N / stiffness_scale(), force_N, elapsed_s);
    if (correction_.dropped()) {
      rupture();
    }
  } else if (phase_ == Phase::kPenetration) {
    correction_.cut(modelled_N, force_N, elapsed_s);
  }
}

// ---- cuts ----

// A shaft that lies on the surface does not rupture it.
bool Insertion::touches_with_tip() const noexcept {
  return surface_.touched_height_m() < kTipRadii * static_cast<float>(shape_.radius_mm / kMetre);
}

// The surface has ruptured before where the tip touches it.
bool Insertion::at_entry() const noexcept {
  const auto radius_m = static_cast<float>(shape_.radius_mm / kMetre);
  return std::any_of(entries_m_.begin(), entries_m_.end(), [&](const Eigen::Vector3f &entry) {
    return (entry - surface_.touched_rest_m()).norm() < radius_m;
  });
}

// The tissue at the tip lies along an earlier cut, and not at its end.
bool Insertion::cut_before() const noexcept {
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

void Insertion::remember_cut() noexcept {
  if (!cut_.tip().inside() || cut_before() || cut_m_.size() == kMaxCutPoints) {
    return;
  }
  if (cut_m_.empty() || (cut_m_.back() - cut_.tip_rest_m()).norm() > kCutMemory_m) {
    cut_m_.push_back(cut_.tip_rest_m());
  }
}

} // namespace bregma::tissue
