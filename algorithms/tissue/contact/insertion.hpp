// A probe's way into tissue and out again, as in seed 000, section 6.4: the tip indents the surface until it ruptures,
// then cuts its way; coming back, it only rubs. A hole that was made is entered again without a second rupture, and a
// way that was cut is gone again without cutting. What a force sensor measures corrects stiffness and cutting force.
// docs/tissue_probe.md
//
// Frame: that of the mesh, mm; forces N along the probe, stresses Pa. One thread at a time; nothing but the constructor
// allocates or throws. Mesh, boundary and locator outlive it.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "algorithms/tissue/contact/force_correction.hpp"
#include "algorithms/tissue/contact/probe_contact.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"

namespace bregma::tissue {

enum class Phase { kOutside, kIndentation, kPenetration, kWithdrawal };
[[nodiscard]] std::string_view name_of(Phase phase);

struct InsertionParameters {
  double rupture_force_N = 0.12;  // along the probe, at which the surface breaks
  double rupture_stress_Pa = 1e9; // von Mises, in the tissue before the tip; from 1e9 on it is not looked at
  double cutting_force_N = 0.06;
  double shaft_friction_N_per_mm = 0.0006;
};

class Insertion {
public:
  // Throws std::invalid_argument for a probe without a size, or forces out of range.
  Insertion(const TetMesh &mesh, const TetBoundary &boundary, const TetLocator &locator, const ProbeShape &probe,
            const SurfaceContact::Options &contact, const InsertionParameters &parameters);

  // For ExplicitSolver::set_contacts.
  [[nodiscard]] std::array<Contact *, 2> contacts() noexcept { return {&surface_, &cut_}; }

  // ---- where the probe is, when its way there was not seen ----
  void reset() noexcept;        // nowhere; what was cut is whole
  void remove_probe() noexcept; // nowhere
  void reappear_outside() noexcept;
  void reappear_inside(int tetrahedron) noexcept; // that the tip is in

  // ---- a step of the solver ----
  void begin_step(const PlacedProbe &probe, const ExplicitSolver &solver) noexcept;
  void end_step(const ExplicitSolver &solver) noexcept;
  // The step was taken back: a dent that would turn the tissue inside out has torn it, whatever the force.
  void force_rupture() noexcept;

  // A sensor's sample, positive where the tissue pushes back.
  void measure(double force_N, double elapsed_s) noexcept;

  [[nodiscard]] Phase phase() const noexcept { return phase_; }
  [[nodiscard]] bool inside() const noexcept { return phase_ == Phase::kPenetration || phase_ == Phase::kWithdrawal; }
  // The way inside was seen from the surface on.
  [[nodiscard]] bool path_known() const noexcept { return path_known_; }
  // The tip has come out of the mesh again while the shaft is in it.
  [[nodiscard]] bool left_mesh() const noexcept;
  [[nodiscard]] double depth_mm() const noexcept { return depth_mm_; } // of the shaft inside, or of the dent
  [[nodiscard]] double tip_force_N() const noexcept { return static_cast<double>(tip_force_N_); }
  [[nodiscard]] double shaft_force_N() const noexcept { return static_cast<double>(shaft_force_N_); } // by friction
  [[nodiscard]] int ruptures() const noexcept { return ruptures_; }                                   // so far
  [[nodiscard]] double rupture_force_N() const noexcept { return rupture_force_N_; }                  // of the last one
  [[nodiscard]] double stiffness_scale() const noexcept { return correction_.scale(); }

private:
  void indent(const ExplicitSolver &solver) noexcept;
  void rupture() noexcept;
  void reset_to_outside() noexcept;
  [[nodiscard]] bool touches_with_tip() const noexcept;
  [[nodiscard]] bool at_entry() const noexcept;
  [[nodiscard]] bool cut_before() const noexcept;
  void remember_cut() noexcept;

  ProbeShape shape_;
  InsertionParameters parameters_;
  SurfaceContact surface_;
  CutContact cut_;
  ForceCorrection correction_;

  Phase phase_ = Phase::kOutside;
  bool path_known_ = true;
  PlacedProbe probe_;
  bool searched_ = false; // for the surface near searched_for_
  PlacedProbe searched_for_;
  float advance_m_ = 0.0F;                          // of the tip along the shaft in the present step, into the tissue
  float back_m_ = 0.0F;                             // of the tip, from its farthest in the present phase
  float alone_s_ = 0.0F;                            // since the tip touched the surface, or had tissue around it
  float tip_force_N_ = 0.0F, shaft_force_N_ = 0.0F; // smoothed
  double depth_mm_ = 0.0;
  int ruptures_ = 0;
  double rupture_force_N_ = 0.0;
  std::vector<Eigen::Vector3f> cut_m_; // where the tip has been, at rest
  std::vector<Eigen::Vector3f> entries_m_;
};

} // namespace bregma::tissue
