// Indentation of a block, compared with CalculiX. The comparison answers two questions.
//
// Is the solver correct? C3D4 on the same mesh has the same shape functions. Its pressure is constant per tetrahedron
// instead of per node, so it becomes stiffer as the tissue approaches incompressibility. With the option of pressures
// per tetrahedron, the solver must reproduce C3D4's result. These figures have limits.
// Is the element accurate? C3D10 on the same tetrahedra has quadratic displacements and serves as the reference
// solution. Nodal pressures and C3D4 are reported relative to it, without limits.
//
// The edge of the displaced patch is singular, so forces converge slowly in every formulation. All figures are
// reported on successively refined meshes.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <stdexcept>

#include "algorithms/tissue/mesh/lattice_mesh.hpp"
#include "algorithms/tissue/solver/explicit_solver.hpp"
#include "bench/accuracy/tissue_calculix_job.hpp"
#include "bench/accuracy/tissue_parts.hpp"
#include "casefile/mesh_file.hpp"

namespace bregma::bench {
namespace {

using Eigen::Vector3d;

constexpr double kSide_mm = 90.0;
constexpr double kDepth_mm = 6.0;
constexpr int kStages = 4; // initial number of load increments in CalculiX

enum class Shape { kPunch, kDimple }; // a square of 30 mm; a circular cos^2 profile of 60 mm, without an edge

Indentation block_indentation(Shape shape, int cells, double poisson) {
  Indentation out;
  out.mesh = tissue::block_mesh({cells, cells, cells}, Vector3d::Constant(kSide_mm));
  out.material = tissue::named_material("thesis");
  out.material.poisson = poisson;
  const Vector3d middle(0.5 * kSide_mm, 0.5 * kSide_mm, kSide_mm);
  if (shape == Shape::kPunch) {
    out.prescribed_mm = [](const Vector3d &) { return Vector3d(0.0, 0.0, -kDepth_mm); };
  } else {
    out.prescribed_mm = [middle](const Vector3d &p) {
      const double wave = std::cos(0.5 * std::numbers::pi * (p - middle).norm() / 30.0);
      return Vector3d(0.0, 0.0, -kDepth_mm * wave * wave);
    };
  }
  for (std::size_t i = 0; i < out.mesh.nodes_mm.size(); ++i) {
    const Vector3d off = out.mesh.nodes_mm[i] - middle;
    const bool within = shape == Shape::kPunch ? off.cwiseAbs().maxCoeff() < 15.0 + 1e-6 : off.norm() < 30.0 - 1e-6;
    if (out.mesh.nodes_mm[i].z() == 0.0) {
      out.held.push_back(static_cast<int>(i));
    } else if (off.z() == 0.0 && within) {
      out.pushed.push_back(static_cast<int>(i));
    }
  }
  return out;
}

// The case's brain, with its highest point as entry. The surface within 12 mm of the entry is displaced inwards by
// 5 mm, a ring of 30 mm around it is free, and the rest is fixed.
Indentation brain_indentation(const std::string &case_folder, int tetrahedra) {
  Indentation out;
  const auto surface = casefile::read_mesh(std::filesystem::path(case_folder) / "surfaces" / "brain.ply");
  if (!surface) {
    throw std::runtime_error(case_folder + ": no brain");
  }
  tissue::LatticeMeshOptions options;
  options.tetrahedra = tetrahedra;
  out.mesh = tissue::fill_surface(*surface, options).mesh;
  out.material = tissue::named_material("thesis");
  out.prescribed_mm = [](const Vector3d &) { return Vector3d(0.0, 0.0, -5.0); };
  const std::vector<int> boundary = tissue::boundary_of(out.mesh).nodes;
  const auto at = [&](int node) -> const Vector3d & { return out.mesh.nodes_mm[static_cast<std::size_t>(node)]; };
  const int entry =
      *std::max_element(boundary.begin(), boundary.end(), [&](int a, int b) { return at(a).z() < at(b).z(); });
  for (const int node : boundary) {
    const double away_mm = (at(node) - at(entry)).norm();
    if (away_mm < 12.0) {
      out.pushed.push_back(node);
    } else if (away_mm > 30.0) {
      out.held.push_back(node);
    }
  }
  return out;
}

struct Answer {
  std::vector<Vector3d> displacement_mm;
  Vector3d force_N = Vector3d::Zero();
  double wall_s = 0.0;
  tissue::RelaxationResult relaxation;
};

Answer relax(const Indentation &problem, double element_pressure_fraction) {
  tissue::SolverOptions options;
  options.element_pressure_fraction = element_pressure_fraction;
  options.threads = 2;
  const auto begin = std::chrono::steady_clock::now();
  tissue::ExplicitSolver solver(problem.mesh, problem.material, options);
  for (const int node : problem.held) {
    solver.fix(node);
  }
  Answer out;
  for (int stage = 1; stage <= kStages; ++stage) {
    for (const int node : problem.pushed) {
      solver.fix(node);
      solver.set_displacement_mm(node, problem.prescribed_mm(problem.mesh.nodes_mm[static_cast<std::size_t>(node)]) *
                                           stage / kStages);
    }
    // Only the last stage must converge.
    const tissue::RelaxationResult relaxation = solver.relax({stage < kStages ? 1e-2 : 1e-4, 20000, false});
    out.relaxation.steps += relaxation.steps;
    out.relaxation.converged = relaxation.converged;
  }
  out.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  for (int i = 0; i < solver.nodes(); ++i) {
    out.displacement_mm.push_back(solver.displacement_mm(i));
  }
  for (const int node : problem.pushed) {
    out.force_N -= solver.elastic_force_N(node);
  }
  return out;
}

double field_difference(const std::vector<Vector3d> &a, const std::vector<Vector3d> &reference) {
  double off = 0.0;
  double whole = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    off += (a[i] - reference[i]).squaredNorm();
    whole += reference[i].squaredNorm();
  }
  return kPercent * std::sqrt(off / whole);
}

double force_difference(const Vector3d &a, const Vector3d &reference) {
  return kPercent * (a - reference).norm() / reference.norm();
}

void compare(Report &report, const std::string &shape, const Indentation &problem, bool quadratic) {
  const double poisson = problem.material.poisson;
  const std::string folder = "out/bench/calculix";
  const Answer ours = relax(problem, 0.0);
  const Answer same_element = relax(problem, 1.0);
  const CalculixAnswer linear = run_calculix(problem, CalculixElement::kC3D4, folder);
  std::string line(240, '\0');
  const auto note = [&](const char *pattern, auto... values) {
    line.resize(240);
    line.resize(static_cast<std::size_t>(std::snprintf(line.data(), line.size(), pattern, values...)));
    report.note(line);
  };
  note("%s, nu %.3f, %zu tetrahedra: force %.5f N (%d steps%s, %.2f s), C3D4 %.5f N (%.2f s)", shape.c_str(), poisson,
       problem.mesh.tetrahedra.size(), ours.force_N.norm(), ours.relaxation.steps,
       ours.relaxation.converged ? "" : ", NOT converged", ours.wall_s, linear.force_N.norm(), linear.wall_s);
  const std::string name = "calculix." + shape + ".nu" + std::to_string(std::lround(1000.0 * poisson)) + "." +
                           std::to_string(problem.mesh.tetrahedra.size());
  report.add(at_most(name + ".same_element.field_to_c3d4",
                     field_difference(same_element.displacement_mm, linear.displacement_mm), "%", 2.0));
  report.add(
      at_most(name + ".same_element.force_to_c3d4", force_difference(same_element.force_N, linear.force_N), "%", 3.0));
  report.add(figure(name + ".field_to_c3d4", field_difference(ours.displacement_mm, linear.displacement_mm), "%"));
  report.add(figure(name + ".force_to_c3d4", force_difference(ours.force_N, linear.force_N), "%"));
  report.add(with_peer(figure(name + ".wall", ours.wall_s, "s"), linear.wall_s, "CalculiX C3D4"));
  if (quadratic) {
    const CalculixAnswer exact = run_calculix(problem, CalculixElement::kC3D10, folder);
    note("  C3D10 %.5f N (%.2f s)", exact.force_N.norm(), exact.wall_s);
    report.add(
        with_peer(figure(name + ".field_to_c3d10", field_difference(ours.displacement_mm, exact.displacement_mm), "%"),
                  field_difference(linear.displacement_mm, exact.displacement_mm), "CalculiX C3D4"));
    report.add(with_peer(figure(name + ".force_to_c3d10", force_difference(ours.force_N, exact.force_N), "%"),
                         force_difference(linear.force_N, exact.force_N), "CalculiX C3D4"));
  }
}

} // namespace

void calculix_figures(Report &report, const TissueBenchOptions &options) {
  if (!calculix_available()) {
    report.note("calculix: NOT installed (bench/accuracy/tissue_calculix.sh installs it)");
    return;
  }
  report.note("calculix: block of 90 mm, held below; on its top a square of 30 mm (punch) or a round cos^2 of 60 mm "
              "(dimple) goes down by 6 mm without sliding; neo-Hookean, E 2100 Pa; static, large deformation");
  report.note("differences: RMS over nodes by RMS displacement; forces on what is pushed");
  // C3D10 on more than about 10,000 tetrahedra takes minutes and more memory than a laptop has.
  for (const Shape shape : {Shape::kDimple, Shape::kPunch}) {
    const auto block = [&](int cells, double poisson, bool quadratic) {
      compare(report, shape == Shape::kPunch ? "punch" : "dimple", block_indentation(shape, cells, poisson), quadratic);
    };
    block(6, 0.45, true);
    block(9, 0.45, !options.quick);
    if (!options.quick) {
      block(12, 0.45, true);
      block(15, 0.3, false);
      block(9, 0.49, true);
    }
    block(15, 0.45, false);
  }
  if (!std::filesystem::exists(std::filesystem::path(options.case_folder) / "surfaces" / "brain.ply")) {
    report.note("brain: NOT measured, no case at " + options.case_folder);
    return;
  }
  report.note(
      "brain: the surface within 12 mm of the highest point goes in by 5 mm, 12 to 30 mm is free, the rest held");
  compare(report, "brain", brain_indentation(options.case_folder, 5000), !options.quick);
  compare(report, "brain", brain_indentation(options.case_folder, 20000), false);
}

} // namespace bregma::bench
