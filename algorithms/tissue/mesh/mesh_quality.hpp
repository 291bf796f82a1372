// Quality of a tetrahedral mesh for an explicit solver: shapes, and the time step that they allow.
// Lengths mm; pure functions, safe from any thread.
#pragma once

#include <array>
#include <vector>

#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

// Stable length 1 / sqrt(sum over the corners of 1 / h^2) with the altitudes h: the contribution of a tetrahedron's
// shape and size to its stable time step, see stable_step_s. Between half and all of its smallest altitude; 0 or less
// for a flat or inverted tetrahedron.
[[nodiscard]] double stable_length_mm(const Eigen::Vector3d &a, const Eigen::Vector3d &b, const Eigen::Vector3d &c,
                                      const Eigen::Vector3d &d);
// The minimum over the mesh.
[[nodiscard]] double stable_length_mm(const TetMesh &mesh);

// The time step up to which central differences with lumped masses are stable, for any boundary conditions:
//
//   dt = L / c,   c = sqrt((K + 4/3 mu) / rho)   L = 1 / sqrt(sum 1 / h^2), the mesh's smallest
//
// from the bound on the largest frequency of a constant-strain element, w^2 <= n / rho (lambda + 2 mu) sum |grad N|^2
// with n = 4 nodes and |grad N| = 1 / h, and dt = 2 / w [Flanagan 1984]. The rule of
// thumb, minimum altitude / c, is up to twice that and not safe: a regular tetrahedron reaches the bound. Undeformed
// tissue, undamped, at its instantaneous moduli. Throws std::invalid_argument as check(material) does.
[[nodiscard]] double stable_step_s(double stable_length_mm, const Material &material);

// Per tetrahedron 3 inradius / circumradius: 1 for a regular one, 0 for a flat one. Those of the lattice have 0.95.
[[nodiscard]] std::vector<double> radius_ratios(const TetMesh &mesh);

struct MeshQuality {
  static constexpr int kBins = 18;
  static constexpr double kBin_deg = 10.0;

  int nodes = 0;
  int tetrahedra = 0;
  int boundary_nodes = 0;
  int boundary_triangles = 0;
  double volume_mm3 = 0.0;
  double min_dihedral_deg = 0.0;
  double max_dihedral_deg = 0.0;
  std::array<int, kBins> dihedral_histogram{}; // six angles per tetrahedron
  double min_radius_ratio = 0.0;
  double percentile5_radius_ratio = 0.0;
  double mean_radius_ratio = 0.0;
  double min_edge_mm = 0.0;
  double max_edge_mm = 0.0;
  double min_altitude_mm = 0.0;
  double stable_length_mm = 0.0;
};

// Throws std::invalid_argument as check(mesh) does.
[[nodiscard]] MeshQuality quality_of(const TetMesh &mesh);

} // namespace bregma::tissue
