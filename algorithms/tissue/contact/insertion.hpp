// Insertion of a probe into tissue, and its withdrawal, as in [thesis, section 6.3.2]: the tip indents the surface
// until it ruptures, then cuts its path; during withdrawal there is friction only. An existing hole is entered again
// without a second rupture, and an existing cut is passed again without cutting. The measured force corrects stiffness
// and cutting force. docs/tissue_probe.md
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
  double rupture_force_N = 0.12;  // force along the probe at which the surface ruptures
  double rupture_stress_Pa = 1e9; // von Mises stress under the tip; 1e9 or more: not tested
  double cutting_force_N = 0.06;
  double shaft_friction_N_per_mm = 0.0006;
};

class Insertion {
public:
  // Throws std::invalid_argument for a probe without size, or forces out of range.
  Insertion(const TetMesh &mesh, const TetBoundary &boundary, const TetLocator &locator, const ProbeShape &probe,
            const SurfaceContact::Options &contact, const InsertionParameters &parameters);

  // For ExplicitSolver::set_contacts.
  [[nodiscard]] std::array<Contact *, 2> contacts() noexcept { return {&surface_, &cut_}; }

  // ---- position of the probe when its path was not seen ----
  void reset() noexcept; // no probe, no cuts
  void remove_probe() noexcept;
  void reappear_outside() noexcept;
  void reappear_inside(int tetrahedron) noexcept; // tetrahedron: contains the tip

  // ---- a step of the solver ----
  void begin_step(const PlacedProbe &probe, const ExplicitSolver &solver) noexcept;
  void end_step(const ExplicitSolver &solver) noexcept;
  // To be called when tetrahedra were inverted: the indentation counts as a rupture, at any force.
  void force_rupture() noexcept;

  // A sample of the force sensor; positive: the tissue pushes back.
  void measure(double force_N, double elapsed_s) noexcept;

  [[nodiscard]] Phase phase() const noexcept { return phase_; }
  [[nodiscard]] bool inside() const noexcept { return phase_ == Phase::kPenetration || phase_ == Phase::kWithdrawal; }
  // The probe was seen from the surface to its present position.
  [[nodiscard]] bool path_known() const noexcept { return path_known_; }
  // The tip has left the mesh while the shaft is in it.
  [[nodiscard]] bool left_mesh() const noexcept;
  [[nodiscard]] double depth_mm() const noexcept {
    return depth_mm_;
  } // length of the shaft inside, or depth of the indentation
  [[nodiscard]] double tip_force_N() const noexcept { return static_cast<double>(tip_force_N_); }
  [[nodiscard]] double shaft_force_N() const noexcept { return static_cast<double>(shaft_force_N_); } // by friction
  [[nodiscard]] int ruptures() const noexcept { return ruptures_; }                                   // number so far
  [[nodiscard]] double rupture_force_N() const noexcept { return rupture_force_N_; } // tip force at the last rupture
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
  bool searched_ = false; // surface_ was searched at searched_for_
  PlacedProbe searched_for_;
  float advance_m_ = 0.0F;                          // move of the tip in this step along the shaft, into the tissue
  float back_m_ = 0.0F;                             // distance of the tip from its farthest position in this phase
  float alone_s_ = 0.0F;                            // time since the last contact with tissue
  float tip_force_N_ = 0.0F, shaft_force_N_ = 0.0F; // smoothed
  double depth_mm_ = 0.0;
  int ruptures_ = 0;
  double rupture_force_N_ = 0.0;
  std::vector<Eigen::Vector3f> cut_m_; // path of the tip in the tissue at rest
  std::vector<Eigen::Vector3f> entries_m_;
};

} // namespace bregma::tissue
