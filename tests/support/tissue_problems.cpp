#include "tests/support/tissue_problems.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "tests/support/tissue_meshes.hpp"
#include "tests/support/tissue_references.hpp"

namespace bregma::test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using tissue::ExplicitSolver;
using tissue::TetMesh;

constexpr double kMetre = 1000.0; // mm
constexpr unsigned kJitterSeed = 20261125;
constexpr double kJitter = 0.15;
constexpr tissue::RelaxationOptions kTight{1e-5, 40000, false};

const Vector3d &rest(const TetMesh &mesh, int node) { return mesh.nodes_mm[static_cast<std::size_t>(node)]; }

void fix_at(ExplicitSolver &solver, const std::vector<int> &nodes, unsigned axes) {
  for (const int node : nodes) {
    solver.fix(node, axes);
  }
}

void move(ExplicitSolver &solver, int node, unsigned axes, const Vector3d &to_mm) {
  solver.fix(node, axes);
  solver.set_displacement_mm(node, to_mm);
}

// Nodal forces of a traction on the surface triangles whose corners are all among the nodes. The quadrature is exact
// for cubics, so that quadratic tractions are exact. traction_Pa(position in mm).
template <class Traction>
void pull_at(ExplicitSolver &solver, const std::vector<int> &nodes, const Traction &traction_Pa) {
  std::vector<Vector3d> force(solver.mesh().nodes_mm.size(), Vector3d::Zero());
  const auto among = [&](int node) { return std::binary_search(nodes.begin(), nodes.end(), node); };
  for (const Eigen::Vector3i &t : boundary_of(solver.mesh()).triangles) {
    if (!std::all_of(t.begin(), t.end(), among)) {
      continue;
    }
    Matrix3d corners;
    for (int i = 0; i < 3; ++i) {
      corners.col(i) = rest(solver.mesh(), t[i]) / kMetre;
    }
    const double area = 0.5 * (corners.col(1) - corners.col(0)).cross(corners.col(2) - corners.col(0)).norm();
    for (int point = 0; point < 4; ++point) {
      Vector3d shape = point == 3 ? Vector3d::Constant(1.0 / 3.0) : Vector3d::Constant(0.2);
      if (point < 3) {
        shape[point] = 0.6;
      }
      const double weight = area * (point == 3 ? -27.0 / 48.0 : 25.0 / 48.0);
      const Vector3d traction = traction_Pa(Vector3d(corners * shape * kMetre));
      for (int i = 0; i < 3; ++i) {
        force[static_cast<std::size_t>(t[i])] += weight * shape[i] * traction;
      }
    }
  }
  for (const int node : nodes) {
    solver.set_force_N(node, force[static_cast<std::size_t>(node)]);
  }
}

// Errors relative to reference fields of the position at rest (mm). Displacements (mm) are weighted by the nodal
// masses, stresses at the centroids by the volumes of the tetrahedra.
template <class Displacement, class Stress>
void compare_fields(const ExplicitSolver &solver, const Displacement &displacement_mm, const Stress &stress_Pa,
                    FieldAnswer &out) {
  double off = 0.0;
  double whole = 0.0;
  for (int i = 0; i < solver.nodes(); ++i) {
    const Vector3d wanted = displacement_mm(rest(solver.mesh(), i));
    off += solver.mass_kg(i) * (solver.displacement_mm(i) - wanted).squaredNorm();
    whole += solver.mass_kg(i) * wanted.squaredNorm();
  }
  out.displacement_error = std::sqrt(off / whole);
  off = whole = 0.0;
  for (int e = 0; e < solver.elements(); ++e) {
    const Eigen::Vector4i &t = solver.mesh().tetrahedra[static_cast<std::size_t>(e)];
    Matrix3d edges;
    for (int i = 0; i < 3; ++i) {
      edges.col(i) = rest(solver.mesh(), t[i + 1]) - rest(solver.mesh(), t[0]);
    }
    const Vector3d middle = rest(solver.mesh(), t[0]) + 0.25 * edges.rowwise().sum();
    const Matrix3d wanted = stress_Pa(middle);
    off += edges.determinant() * (solver.cauchy_Pa(e) - wanted).squaredNorm();
    whole += edges.determinant() * wanted.squaredNorm();
  }
  out.stress_error = std::sqrt(off / whole);
  out.elements = solver.elements();
  out.edge_mm = std::cbrt(volume_mm3(solver.mesh()) / solver.nodes());
}

} // namespace

double Compared::error() const { return std::abs(value - reference) / std::abs(reference); }

tissue::Material elastic(tissue::Law law, double young_Pa, double poisson) {
  tissue::Material material;
  material.name = "verification";
  material.law = law;
  material.young_Pa = young_Pa;
  material.poisson = poisson;
  return material;
}

tissue::Material brain(tissue::Law law, double poisson) {
  tissue::Material material = elastic(law, 2100.0, poisson);
  material.ogden_alpha = -4.7;
  return material;
}

// ---- homogeneous ----

PatchAnswer patch(const tissue::Material &material, const Matrix3d &gradient, const tissue::SolverOptions &options) {
  const Vector3d size_mm(20.0, 15.0, 25.0);
  const TetMesh mesh = jittered_block({4, 3, 5}, size_mm, kJitter, kJitterSeed);
  ExplicitSolver solver(mesh, material, options);
  const Matrix3d h = gradient - Matrix3d::Identity();
  const std::vector<int> surface = boundary_of(mesh).nodes;
  for (const int node : surface) {
    move(solver, node, tissue::kAllAxes, h * rest(mesh, node));
  }
  (void)solver.relax(kTight);

  PatchAnswer out;
  double largest = 0.0;
  for (int i = 0; i < solver.nodes(); ++i) {
    const Vector3d wanted = h * rest(mesh, i);
    largest = std::max(largest, wanted.norm());
    out.displacement_error = std::max(out.displacement_error, (solver.displacement_mm(i) - wanted).norm());
  }
  out.displacement_error /= largest;

  // Principal stresses rotated to the axes of the left stretch tensor.
  const Eigen::SelfAdjointEigenSolver<Matrix3d> left(gradient * gradient.transpose());
  const Vector3d principal = principal_cauchy_Pa(material, left.eigenvalues().cwiseSqrt());
  const Matrix3d cauchy = left.eigenvectors() * principal.asDiagonal() * left.eigenvectors().transpose();
  out.reference_Pa = gradient.determinant() * cauchy * gradient.inverse().transpose();
  for (int e = 0; e < solver.elements(); ++e) {
    out.stress_error = std::max(out.stress_error, (solver.cauchy_Pa(e) - cauchy).cwiseAbs().maxCoeff());
  }
  out.stress_error /= cauchy.cwiseAbs().maxCoeff();
  // Mean stress from the reaction forces at the surface: V P = sum f X^T.
  out.nominal_Pa.setZero();
  for (const int node : surface) {
    out.nominal_Pa -= solver.elastic_force_N(node) * rest(mesh, node).transpose() / kMetre;
  }
  out.nominal_Pa *= kMetre * kMetre * kMetre / size_mm.prod();
  return out;
}

UniaxialAnswer uniaxial(const tissue::Material &material, double stretch, const tissue::SolverOptions &options) {
  constexpr double kSide_mm = 20.0;
  constexpr double kHeight_mm = 30.0;
  const TetMesh mesh = jittered_block({4, 4, 6}, {kSide_mm, kSide_mm, kHeight_mm}, kJitter, kJitterSeed);
  ExplicitSolver solver(mesh, material, options);
  fix_at(solver, nodes_at(mesh, 0, 0.0), tissue::kAxisX);
  fix_at(solver, nodes_at(mesh, 1, 0.0), tissue::kAxisY);
  fix_at(solver, nodes_at(mesh, 2, 0.0), tissue::kAxisZ);
  const std::vector<int> top = nodes_at(mesh, 2, kHeight_mm);
  constexpr int kStages = 5; // a step of more than one cell would invert elements
  for (int stage = 1; stage <= kStages; ++stage) {
    for (const int node : top) {
      Vector3d to = solver.displacement_mm(node);
      to.z() = (stretch - 1.0) * kHeight_mm * stage / kStages;
      move(solver, node, tissue::kAxisZ, to);
    }
    (void)solver.relax(kTight);
  }

  const UniaxialReference reference = uniaxial_reference(material, stretch);
  UniaxialAnswer out;
  out.force_N.reference = reference.nominal_Pa * kSide_mm * kSide_mm / (kMetre * kMetre);
  for (const int node : top) {
    out.force_N.value -= solver.elastic_force_N(node).z();
  }
  const std::vector<int> side = nodes_at(mesh, 0, kSide_mm);
  for (const int node : side) {
    out.across_mm.value += solver.displacement_mm(node).x() / static_cast<double>(side.size());
  }
  out.across_mm.reference = (reference.across - 1.0) * kSide_mm;
  return out;
}

// ---- spheres ----

namespace {

constexpr double kInner_mm = 20.0;
constexpr double kOuter_mm = 40.0;

TetMesh sphere(int layers) { return sphere_octant(kInner_mm, kOuter_mm, layers, 2 * layers); }

void fix_octant(ExplicitSolver &solver) {
  fix_at(solver, nodes_at(solver.mesh(), 0, 0.0), tissue::kAxisX);
  fix_at(solver, nodes_at(solver.mesh(), 1, 0.0), tissue::kAxisY);
  fix_at(solver, nodes_at(solver.mesh(), 2, 0.0), tissue::kAxisZ);
}

} // namespace

FieldAnswer pressurised_sphere(double poisson, int layers, const tissue::SolverOptions &options) {
  const tissue::Material material = elastic(tissue::Law::kLinear, 2100.0, poisson);
  const TetMesh mesh = sphere(layers);
  ExplicitSolver solver(mesh, material, options);
  fix_octant(solver);
  const LameSphere lame{kInner_mm / kMetre, kOuter_mm / kMetre, 50.0, material.young_Pa, poisson};
  const std::vector<int> inner = nodes_at_radius(mesh, kInner_mm);
  pull_at(solver, inner, [&](const Vector3d &p) { return Vector3d(lame.pressure_Pa * p.normalized()); });

  FieldAnswer out;
  out.relaxation = solver.relax(kTight);
  compare_fields(
      solver,
      [&](const Vector3d &p) {
        return Vector3d(kMetre * lame.radial_displacement_m(p.norm() / kMetre) * p.normalized());
      },
      [&](const Vector3d &p) {
        const double r = p.norm() / kMetre;
        const Matrix3d radial = p.normalized() * p.normalized().transpose();
        return Matrix3d(lame.radial_stress_Pa(r) * radial + lame.hoop_stress_Pa(r) * (Matrix3d::Identity() - radial));
      },
      out);
  out.known.reference = kMetre * lame.radial_displacement_m(lame.inner_m);
  for (const int node : inner) {
    out.known.value += solver.displacement_mm(node).dot(rest(mesh, node).normalized());
  }
  out.known.value /= static_cast<double>(inner.size());
  return out;
}

Compared blown_sphere(double poisson, int layers, const tissue::SolverOptions &options) {
  constexpr double kGrowth = 1.5;
  const tissue::Material material = elastic(tissue::Law::kNeoHookean, 2100.0, poisson);
  const TetMesh mesh = sphere(layers);
  ExplicitSolver solver(mesh, material, options);
  fix_octant(solver);
  const std::vector<int> inner = nodes_at_radius(mesh, kInner_mm);
  constexpr int kStages = 10; // small enough to avoid inverted tetrahedra
  for (int stage = 1; stage <= kStages; ++stage) {
    for (const int node : inner) {
      move(solver, node, tissue::kAllAxes, (kGrowth - 1.0) * stage / kStages * rest(mesh, node));
    }
    (void)solver.relax(kTight);
  }
  // The radial forces are the pressure times the current inner surface, an eighth of 4 pi r^2.
  double force = 0.0;
  for (const int node : inner) {
    force -= solver.elastic_force_N(node).dot(rest(mesh, node).normalized());
  }
  const double now_m = kGrowth * kInner_mm / kMetre;
  return {force / (0.5 * M_PI * now_m * now_m),
          blown_sphere_pressure_Pa(material.shear_Pa(), kInner_mm / kMetre, kOuter_mm / kMetre, now_m)};
}

// ---- beams ----

FieldAnswer plane_strain_beam(tissue::Law law, double poisson, int rows, const tissue::SolverOptions &options) {
  constexpr double kLength_mm = 80.0;
  constexpr double kHeight_mm = 20.0;
  const tissue::Material material = elastic(law, 2100.0, poisson);
  const double edge_mm = kHeight_mm / rows;
  TetMesh mesh = tissue::block_mesh({4 * rows, rows, 2}, {kLength_mm, kHeight_mm, 2.0 * edge_mm});
  for (Vector3d &node : mesh.nodes_mm) {
    node.y() -= 0.5 * kHeight_mm;
  }
  ExplicitSolver solver(mesh, material, options);
  fix_at(solver, nodes_at(mesh, 2, 0.0), tissue::kAxisZ);
  fix_at(solver, nodes_at(mesh, 2, 2.0 * edge_mm), tissue::kAxisZ);
  // Small strain: the end is displaced by a thousandth of the length.
  PlaneStrainBeam beam{kLength_mm / kMetre, kHeight_mm / kMetre, 1.0, material.young_Pa, poisson};
  beam.force_N_per_m = -1e-3 * beam.length_m / beam.displacement_m(beam.length_m, 0.0).y();
  const auto displacement = [&](const Vector3d &p) {
    const Eigen::Vector2d u = kMetre * beam.displacement_m(p.x() / kMetre, p.y() / kMetre);
    return Vector3d(u.x(), u.y(), 0.0);
  };
  for (const int node : nodes_at(mesh, 0, 0.0)) {
    move(solver, node, tissue::kAllAxes, displacement(rest(mesh, node)));
  }
  const std::vector<int> end = nodes_at(mesh, 0, kLength_mm);
  pull_at(solver, end, [&](const Vector3d &p) { return Vector3d(0.0, beam.shear_stress_Pa(p.y() / kMetre), 0.0); });

  FieldAnswer out;
  out.relaxation = solver.relax(kTight);
  compare_fields(
      solver, displacement,
      [&](const Vector3d &p) {
        Matrix3d stress = Matrix3d::Zero();
        stress(0, 0) = beam.axial_stress_Pa(p.x() / kMetre, p.y() / kMetre);
        stress(0, 1) = stress(1, 0) = beam.shear_stress_Pa(p.y() / kMetre);
        stress(2, 2) = poisson * stress(0, 0);
        return stress;
      },
      out);
  for (const int node : end) {
    out.known.value += solver.displacement_mm(node).y() / static_cast<double>(end.size());
    out.known.reference += displacement(rest(mesh, node)).y() / static_cast<double>(end.size());
  }
  return out;
}

Compared slender_cantilever(double poisson, int rows, const tissue::SolverOptions &options) {
  constexpr double kLength_mm = 100.0;
  constexpr double kSide_mm = 10.0;
  const tissue::Material material = elastic(tissue::Law::kLinear, 2100.0, poisson);
  const TetMesh mesh = tissue::block_mesh({10 * rows, rows, rows}, {kLength_mm, kSide_mm, kSide_mm});
  ExplicitSolver solver(mesh, material, options);
  // Supported so that the section can deform in its plane, as in Timoshenko's beam.
  for (const int node : nodes_at(mesh, 0, 0.0)) {
    const Vector3d &p = rest(mesh, node);
    solver.fix(node, tissue::kAxisX | (p.y() == 0.5 * kSide_mm ? tissue::kAxisY : 0U) |
                         (p.z() == 0.5 * kSide_mm ? tissue::kAxisZ : 0U));
  }
  constexpr double kForce_N = 1e-5;
  const std::vector<int> end = nodes_at(mesh, 0, kLength_mm);
  pull_at(solver, end,
          [](const Vector3d &) { return Vector3d(0.0, kForce_N / (kSide_mm * kSide_mm) * kMetre * kMetre, 0.0); });
  (void)solver.relax({2e-6, 100000, false});
  Compared out;
  for (const int node : end) {
    out.value += solver.displacement_mm(node).y() / static_cast<double>(end.size());
  }
  out.reference = kMetre * timoshenko_deflection_m(kForce_N, kLength_mm / kMetre, kSide_mm / kMetre, kSide_mm / kMetre,
                                                   material.young_Pa, poisson);
  return out;
}

// ---- relaxation ----

std::vector<Compared> relaxing_bar(const tissue::Material &material, const std::vector<double> &times_s,
                                   const tissue::SolverOptions &options) {
  constexpr double kSide_mm = 10.0;
  constexpr double kHeight_mm = 20.0;
  constexpr double kStrain = 0.002;
  const TetMesh mesh = tissue::block_mesh({2, 2, 4}, {kSide_mm, kSide_mm, kHeight_mm});
  ExplicitSolver solver(mesh, material, options);
  fix_at(solver, nodes_at(mesh, 0, 0.0), tissue::kAxisX);
  fix_at(solver, nodes_at(mesh, 1, 0.0), tissue::kAxisY);
  fix_at(solver, nodes_at(mesh, 2, 0.0), tissue::kAxisZ);
  // All nodes start at the instantaneous solution, so that there is no transient vibration.
  const double across = uniaxial_reference(material, 1.0 + kStrain).across - 1.0;
  const std::vector<int> top = nodes_at(mesh, 2, kHeight_mm);
  for (int i = 0; i < solver.nodes(); ++i) {
    solver.set_displacement_mm(i, rest(mesh, i).cwiseProduct(Vector3d(across, across, kStrain)));
  }
  fix_at(solver, top, tissue::kAxisZ);
  std::vector<Compared> out;
  double time_s = 0.0;
  for (const double to_s : times_s) {
    while (time_s < to_s) {
      solver.advance(1);
      time_s += solver.step_s();
    }
    Compared stress;
    for (const int node : top) {
      stress.value -= solver.elastic_force_N(node).z() / (kSide_mm * kSide_mm) * kMetre * kMetre;
    }
    stress.reference = relaxing_bar_Pa(material, kStrain, time_s);
    out.push_back(stress);
  }
  return out;
}

} // namespace bregma::test
