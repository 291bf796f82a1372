// Tissue in motion: total-Lagrangian explicit dynamics on tetrahedra, and dynamic relaxation to the static answer.
//
// Formulation: [Miller 2007]; elements: element_kernel.hpp. Central differences, lumped masses. The step is a fraction
// of 2 / omega_max. omega_max comes from an iteration on the present stiffness and is checked again while the tissue
// deforms: a step that has become too long is shortened before it becomes unstable.
//
// Lengths mm, forces N, stresses Pa, time s; inside, SI in floats. One thread at a time calls; the solver has its own
// team. advance() and relax() neither allocate nor throw.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"
#include "algorithms/tissue/solver/element_kernel.hpp"

namespace bregma::parallel {
class Team;
}

namespace bregma::tissue {

struct SolverOptions {
  int threads = 1;
  double step_fraction =
      0.85; // fraction of the critical step; the margin allows for contacts that stiffen between two checks
  double minimum_step_s = 0.0; // elements that need a shorter step get additional mass (mass scaling); 0: none
  double damping_per_s = 0.0;  // mass-proportional damping of all velocities
  // Fraction of the pressure that comes from each tetrahedron's own volume. 0: nodal averaging. 1: the plain
  // constant-strain tetrahedron of other programs, which locks; for comparison with them.
  double element_pressure_fraction = 0.0;
  const ElementKernel *kernel = nullptr; // null: the fastest that this processor has
};

// The nodes between the prediction of a step and its end, for the contacts, which move nodes out of forbidden regions.
// A move also changes the velocity. It corresponds to the contact force m move / dt^2.
struct NodeMotion {
  std::span<NodeVector> displacement_m;
  std::span<NodeVector> velocity_m_s;
  std::span<const NodeVector> inverse_mass_per_kg; // by axis; 0 where a node is fixed
  std::span<const Eigen::Vector3f> rest_m;
  float step_s = 0.0F;

  [[nodiscard]] Eigen::Vector3f position_m(int node) const noexcept {
    const NodeVector &u = displacement_m[static_cast<std::size_t>(node)];
    return rest_m[static_cast<std::size_t>(node)] + Eigen::Vector3f(u.x, u.y, u.z);
  }
  // Fixed axes stay.
  void move(int node, const Eigen::Vector3f &by_m) const noexcept {
    const auto i = static_cast<std::size_t>(node);
    const NodeVector &free = inverse_mass_per_kg[i];
    NodeVector &u = displacement_m[i];
    NodeVector &v = velocity_m_s[i];
    const float x = free.x > 0.0F ? by_m.x() : 0.0F;
    const float y = free.y > 0.0F ? by_m.y() : 0.0F;
    const float z = free.z > 0.0F ? by_m.z() : 0.0F;
    u.x += x;
    u.y += y;
    u.z += z;
    v.x += x / step_s;
    v.y += y / step_s;
    v.z += z / step_s;
  }
};

class Contact {
public:
  virtual ~Contact() = default;
  virtual void apply(const NodeMotion &nodes) noexcept = 0;
};

struct Energies {
  double kinetic_J = 0.0;
  double elastic_J = 0.0; // without relaxation
};

struct RelaxationOptions {
  double tolerance = 1e-4; // unbalanced over total forces, and remaining over total displacement
  int max_steps = 20000;
  // true: the shear modulus after all relaxation; false: without relaxation. advance() continues from the result.
  bool relaxed = false;
};

struct RelaxationResult {
  bool converged = false; // never with inverted tetrahedra
  int steps = 0;
  double residual = 0.0; // compared with the tolerance
};

enum Axes : unsigned { kAxisX = 1, kAxisY = 2, kAxisZ = 4, kAllAxes = 7 };

class ExplicitSolver {
public:
  // Throws std::invalid_argument for a mesh or a material that check() refuses, more Prony terms than kMaxPronyTerms,
  // or options out of range.
  ExplicitSolver(const TetMesh &mesh, const Material &material, const SolverOptions &options = {});
  ~ExplicitSolver();
  ExplicitSolver(const ExplicitSolver &) = delete;
  ExplicitSolver &operator=(const ExplicitSolver &) = delete;

  [[nodiscard]] int nodes() const noexcept { return static_cast<int>(rest_.size()); }
  [[nodiscard]] int elements() const noexcept { return static_cast<int>(mesh_.tetrahedra.size()); }
  [[nodiscard]] const TetMesh &mesh() const noexcept { return mesh_; }
  [[nodiscard]] const Material &material() const noexcept { return material_; }
  [[nodiscard]] double step_s() const noexcept { return static_cast<double>(step_s_); }
  [[nodiscard]] double added_mass_fraction() const noexcept { return added_mass_fraction_; } // by mass scaling
  [[nodiscard]] double mass_kg(int node) const noexcept;

  // ---- loads and supports, valid until changed ----
  // A fixed axis keeps its displacement, which set_displacement_mm changes.
  void fix(int node, unsigned axes = kAllAxes) noexcept;
  void release(int node) noexcept;
  void set_displacement_mm(int node, const Eigen::Vector3d &displacement_mm) noexcept;
  void set_force_N(int node, const Eigen::Vector3d &force_N) noexcept;
  void clear_forces() noexcept;
  // Called in this order after each prediction, and in relax(). They outlive the solver or are cleared first.
  void set_contacts(std::vector<Contact *> contacts);

  // ---- motion ----
  void advance(int steps) noexcept;
  RelaxationResult relax(const RelaxationOptions &options = {}) noexcept;
  void stop_motion() noexcept; // velocities to zero
  void reset() noexcept;       // to rest: displacement, velocity, relaxation

  // Saves the present state; restores it without motion. Initially: rest.
  void save() noexcept;
  void restore() noexcept;

  // ---- results ----
  [[nodiscard]] Eigen::Vector3d displacement_mm(int node) const noexcept;
  [[nodiscard]] Eigen::Vector3d velocity_mm_s(int node) const noexcept;
  [[nodiscard]] Eigen::Vector3d
  elastic_force_N(int node) const noexcept;             // force of the tissue on the node in the last step
  [[nodiscard]] Energies energies() const noexcept;     // in the last step
  [[nodiscard]] int inverted_elements() const noexcept; // in the last step
  // Nodes whose move in the last step was clamped because it exceeded a large part of an edge: a sign of an impossible
  // load. The solver recovers from it, but its results are not valid meanwhile.
  [[nodiscard]] int clamped_nodes() const noexcept;
  [[nodiscard]] bool finite() const noexcept; // all displacements and velocities
  // Cauchy stress of a tetrahedron, relaxation and nodal pressure included.
  [[nodiscard]] Eigen::Matrix3d cauchy_Pa(int element) const noexcept;
  [[nodiscard]] Eigen::Matrix3d deformation_gradient(int element) const noexcept;
  [[nodiscard]] std::uint64_t steps() const noexcept { return steps_; }

private:
  struct Range {
    std::size_t begin = 0, end = 0;
  };
  struct ThreadPart { // work and results of one thread
    Range packs, nodes;
    std::vector<float> volume_change;
    std::vector<NodeVector> force;
    ElementSums sums;
    double volume_energy = 0.0;
    int clamped = 0;
  };
  struct Integration {
    float step = 0.0F;
    float keep = 1.0F; // factor on the velocity
    float pull = 0.0F; // factor on f / m
    float max_move = 0.0F;
  };

  struct Slot { // position of a tetrahedron
    std::size_t pack, lane;
  };
  [[nodiscard]] Slot slot_of(std::size_t element) const noexcept;
  void build_packs();
  void build_masses(double minimum_step_s);
  void evaluate(int thread, std::vector<NodeVector> &nodes, bool viscous, float shear_Pa) noexcept;
  void predict(int thread, const std::vector<NodeVector> &inverse_mass, const Integration &how) noexcept;
  void step(int thread, const std::vector<NodeVector> &inverse_mass, const Integration &how, bool viscous,
            float shear_Pa) noexcept;
  void check_step() noexcept;
  void apply_stiffness(const std::vector<NodeVector> &direction, const std::vector<NodeVector> &inverse_mass,
                       float shear_Pa, std::vector<NodeVector> &out) noexcept;
  void set_prony_equilibrium(bool relaxed) noexcept;
  [[nodiscard]] float largest_eigenvalue(int iterations, const std::vector<NodeVector> &inverse_mass,
                                         std::vector<NodeVector> &mode, float shear_Pa) noexcept;
  [[nodiscard]] NodeVector total_force(std::size_t node) const noexcept;
  [[nodiscard]] float lowest_eigenvalue() const noexcept;
  [[nodiscard]] double unbalanced(const Integration &how) const noexcept;
  [[nodiscard]] double remaining_motion(const Integration &how) const noexcept;
  [[nodiscard]] bool diverges(const Integration &how) const noexcept;

  TetMesh mesh_;
  Material material_;
  SolverOptions options_;
  const ElementKernel *kernel_;
  std::unique_ptr<parallel::Team> team_;
  std::vector<ThreadPart> parts_;
  std::vector<Contact *> contacts_;

  std::vector<ElementPack> packs_;
  std::vector<RelaxedPack> relaxed_, saved_relaxed_;
  std::vector<PronyStep> prony_;
  float step_s_ = 0.0F, step_at_rest_s_ = 0.0F, saved_step_s_ = 0.0F;
  float edge_m_ = 0.0F;
  double added_mass_fraction_ = 0.0;
  std::uint64_t steps_ = 0;

  // By node.
  std::vector<Eigen::Vector3f> rest_;
  std::vector<float> mass_kg_, volume_m3_, stiffness_bound_N_m_;
  std::vector<NodeVector> inverse_mass_, inverse_fictitious_; // by axis; 0 where fixed
  std::vector<unsigned> fixed_;
  std::vector<NodeVector> displacement_, velocity_, external_, elastic_, saved_displacement_;
  std::vector<NodeVector> remainder_;                                           // rounding remainder of displacement_
  std::vector<NodeVector> mode_pull_, ascent_, ascent_pull_, turn_, turn_pull_; // work space for finding the next two
  std::vector<NodeVector> mode_, relax_mode_; // estimates of the stiffest mode, in motion and in relax()
  std::vector<NodeVector> probe_, force_before_, velocity_before_, displacement_before_; // state at the last check
};

} // namespace bregma::tissue
