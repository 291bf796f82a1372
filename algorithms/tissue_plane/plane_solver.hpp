// A plane body of soft tissue at rest under loads: total-Lagrangian triangles of constant strain [Miller 2007],
// explicit central differences with scaled masses, damped to rest (dynamic relaxation [Underwood 1983]; the damping
// follows the Rayleigh quotient of the motion [Joldes 2009]).
//
// Plane strain does not lock for nearly incompressible materials, because the pressure is nodal. A node's volume ratio
// is the volume-weighted mean over its triangles, its pressure kappa (ratio - 1), and a triangle's pressure the mean of
// its nodes. The forces are the exact gradient of that energy (average nodal pressure [Bonet 1998]). In plane stress
// the thickness of each triangle has the stretch at which the stress across the plane vanishes, and nothing locks.
//
// Lengths and displacements in the interface are in mm, forces in N per metre of thickness, stresses in Pa; SI
// internally. The solver is elastic: for a material that relaxes, PlaneSettings selects the instantaneous or the
// relaxed modulus. Not for several threads.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue_plane/plane_law.hpp"
#include "algorithms/tissue_plane/plane_mesh.hpp"

namespace bregma::tissue_plane {

enum class PlaneState { kStrain, kStress };

struct PlaneSettings {
  PlaneState state = PlaneState::kStrain;
  double shear_fraction =
      1.0; // fraction of the instantaneous shear modulus; relaxed tissue: Material::relaxed_fraction()
  bool follower =
      true; // true: pressure is normal to the deformed edge and scales with it; false: a dead load as at rest
};

struct PlaneRelaxationOptions {
  double tolerance = 1e-4; // unbalanced force over the forces of loads and supports (norms over all nodes)
  int max_steps = 50'000;
};

struct PlaneRelaxationResult {
  bool converged = false;
  int steps = 0;
  double residual = 0.0; // as PlaneRelaxationOptions::tolerance
  int inverted = 0;      // inverted triangles in the last step; with any, the result is not valid
  [[nodiscard]] bool valid() const { return converged && inverted == 0; }
};

// Keeps nodes out of a rigid body. Called once per step; must not allocate.
class PlaneContact {
public:
  virtual ~PlaneContact() = default;
  // next_m: predicted positions of the nodes in this step, in m; forbidden positions are corrected. Index: node.
  virtual void project(std::span<Eigen::Vector2d> next_m) = 0;
  // While it moves, the body does not count as at rest.
  [[nodiscard]] virtual bool arrived() const { return true; }
};

class PlaneSolver {
public:
  // Throws std::invalid_argument of check(mesh), check(material), or for a shear fraction outside (0, 1].
  PlaneSolver(const PlaneMesh &mesh, const tissue::Material &material, const PlaneSettings &settings = {});

  // Boundary conditions are valid until changed. A node is free unless it is held.
  void hold(int node, int axis, double displacement_mm); // axis 0: x, 1: y
  void hold(int node, const Eigen::Vector2d &displacement_mm = Eigen::Vector2d::Zero());
  void set_force(int node, const Eigen::Vector2d &force_N_m);
  // Replaces the previous edges. Edges are those of boundary_of, with the body on the left. A positive pressure acts on
  // the body.
  void set_pressure(std::span<const Eigen::Vector2i> edges, double pressure_Pa);
  void set_contact(PlaneContact *contact) { contact_ = contact; } // not owned; null: none
  // A start value for free nodes.
  void displace(int node, const Eigen::Vector2d &displacement_mm);
  // The given triangles around a node get a new node at the same place and at rest. Returns its index.
  int split(int node, std::span<const int> triangles);

  // Relaxes the body from its present state to rest. Never throws; an unstable body is not converged.
  PlaneRelaxationResult relax(const PlaneRelaxationOptions &limits = {});

  [[nodiscard]] const PlaneMesh &mesh() const { return mesh_; } // at rest; split nodes included
  [[nodiscard]] Eigen::Vector2d position_mm(int node) const { return 1e3 * at(x_, node); }
  [[nodiscard]] Eigen::Vector2d displacement_mm(int node) const { return position_mm(node) - at(mesh_.nodes_mm, node); }
  // Force of support and contact on the node, N/m.
  [[nodiscard]] Eigen::Vector2d reaction(int node) const { return at(internal_, node) - at(external_, node); }
  [[nodiscard]] PlaneStress stress(int triangle) const;
  // Volume-weighted means over the triangles around each node.
  [[nodiscard]] std::vector<PlaneStress> nodal_stress() const;
  // At a point of the body at rest, interpolated between the nodal means. Throws std::invalid_argument outside the
  // mesh.
  [[nodiscard]] PlaneStress stress_at(const Eigen::Vector2d &at_rest_mm) const;

private:
  struct Triangle {
    Eigen::Matrix2d inverse; // inverse of the edges at rest, 1/m: gradient of the motion = present edges * inverse
    double area_m2 = 0.0;
    int nodes[3] = {0, 0, 0};
  };
  template <class T> [[nodiscard]] static const T &at(const std::vector<T> &values, int i) {
    return values[static_cast<std::size_t>(i)];
  }
  template <class T> [[nodiscard]] static T &at(std::vector<T> &values, int i) {
    return values[static_cast<std::size_t>(i)];
  }
  [[nodiscard]] Eigen::Matrix2d gradient(const Triangle &t) const;
  [[nodiscard]] double pressure(std::size_t triangle) const;
  void collect_volumes();
  void compute_forces();
  void load_edges();
  void scale_masses();
  void move(double damping, double &unbalanced);
  [[nodiscard]] double holding_force() const;

  PlaneMesh mesh_;
  PlaneLaw law_;
  PlaneSettings settings_;
  PlaneContact *contact_ = nullptr;
  std::vector<Triangle> triangles_;
  std::vector<Eigen::Matrix2d> gradients_; // gradients of the last force evaluation
  std::vector<double> thickness_;          // stretch across the plane
  std::vector<double> ratio_;              // volume ratio of each triangle
  std::vector<Eigen::Vector2d> x_, v_, next_, internal_, last_internal_, external_, forces_, target_;
  std::vector<Eigen::Vector2d> free_; // per axis: 1 where free, 0 where held
  std::vector<double> mass_, node_area_m2_, node_ratio_, node_pressure_;
  std::vector<Eigen::Vector2i> edges_;
  double pressure_Pa_ = 0.0;
  double held_step_m_ = 0.0;
  double lowest_ = 0.0; // square of the lowest frequency seen in the motion, per step^2
  int inverted_ = 0;
};

} // namespace bregma::tissue_plane
