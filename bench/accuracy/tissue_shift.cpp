// Brain shift on the case's brain: time, plausibility, picture. The skull is open by 30 mm around the entry of the
// case's first trajectory, and the fluid has drained to the opening's lowest edge.
//
// The limits are the upper ends of the ranges that [thesis, chapter 1] reports from operations: 10 to 25 mm at the
// surface, 6 to 7 mm in depth. They are figures of patients, not of this head. A result below them is plausible, not
// verified. The lower ends are not tested.
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/brain_shift.hpp"
#include "algorithms/tissue/mesh/lattice_mesh.hpp"
#include "bench/accuracy/tissue_parts.hpp"
#include "bench/accuracy/tissue_shift_picture.hpp"
#include "casefile/case.hpp"

namespace bregma::bench {
namespace {

using Eigen::Vector3d;
using tissue::BrainShift;
using tissue::BrainShiftOptions;

constexpr double kOpening_mm = 30.0;
constexpr int kTetrahedra = 20'000;
constexpr double kMaxWall_s = 10.0;
constexpr double kMaxSurface_mm = 25.0;
constexpr double kMaxDeep_mm = 7.0;
constexpr double kMinCosine = 0.8; // cosine between gravity and the largest displacement

struct Timed {
  BrainShift shift;
  double wall_s = 0.0;
};

Timed timed(const tissue::TetMesh &mesh, const BrainShiftOptions &options) {
  const auto begin = std::chrono::steady_clock::now();
  Timed out{tissue::predict_shift(mesh, options), 0.0};
  out.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return out;
}

double along(const tissue::ShiftedPoint &point, const Vector3d &gravity) {
  return point.displacement_mm.normalized().dot(gravity.normalized());
}

void judge(Report &report, const std::string &name, const Timed &run, const BrainShiftOptions &options) {
  const BrainShift &shift = run.shift;
  char text[240];
  std::snprintf(text, sizeof text,
                "%s: fluid %.1f mm down, load %.2f N, %d steps to a residual of %.1e; surface moves by (%.1f, %.1f, "
                "%.1f) mm, deep tissue by (%.1f, %.1f, %.1f) mm RAS",
                name.c_str(), shift.fluid_drop_mm, shift.load_N.norm(), shift.relaxation.steps,
                shift.relaxation.residual, shift.surface.displacement_mm.x(), shift.surface.displacement_mm.y(),
                shift.surface.displacement_mm.z(), shift.deep.displacement_mm.x(), shift.deep.displacement_mm.y(),
                shift.deep.displacement_mm.z());
  report.note(text);
  report.add(at_least(name + ".converged", shift.relaxation.converged ? 1.0 : 0.0, "", 1.0));
  report.add(at_most(name + ".inverted", shift.inverted_elements, "tetrahedra", 0.0));
  report.add(at_most(name + ".wall", run.wall_s, "s", kMaxWall_s));
  report.add(at_most(name + ".surface", shift.surface.displacement_mm.norm(), "mm", kMaxSurface_mm));
  report.add(at_most(name + ".deep", shift.deep.displacement_mm.norm(), "mm", kMaxDeep_mm));
  report.add(at_least(name + ".surface.along_gravity", along(shift.surface, options.gravity), "cos", kMinCosine));
  report.add(at_least(name + ".deep.along_gravity", along(shift.deep, options.gravity), "cos", kMinCosine));
}

void draw_shift(const tissue::TetMesh &mesh, const BrainShiftOptions &options, const BrainShift &shift,
                const std::string &file) {
  const Vector3d down = options.gravity.normalized();
  double highest = -INFINITY;
  for (const Vector3d &node : mesh.nodes_mm) {
    highest = std::max(highest, -down.dot(node));
  }
  const Vector3d &opening = options.skull.craniotomy.centre_mm;
  char sagittal[80];
  char axial[80];
  std::snprintf(sagittal, sizeof sagittal, "sagittal, x = %.0f mm: through the craniotomy", opening.x());
  std::snprintf(axial, sizeof axial, "axial, z = %.0f mm: through the craniotomy", opening.z());
  draw({.mesh = &mesh,
        .displacement_mm = &shift.displacement_mm,
        .gravity = down,
        .craniotomy_mm = opening,
        .craniotomy_radius_mm = options.skull.craniotomy.radius_mm,
        .fluid_height_mm = highest - shift.fluid_drop_mm,
        .sections = {{sagittal, 0, opening.x()}, {axial, 2, opening.z()}}},
       file);
}

} // namespace

void shift_figures(Report &report, const TissueBenchOptions &options, const std::string &picture) {
  const auto loaded = casefile::load_case(options.case_folder);
  if (!loaded) {
    throw std::runtime_error(loaded.error().message);
  }
  if (loaded->trajectories.empty()) {
    throw std::runtime_error(options.case_folder + ": no trajectory, so no craniotomy");
  }
  tissue::LatticeMeshOptions meshing;
  meshing.tetrahedra = kTetrahedra;
  const tissue::TetMesh mesh = tissue::fill_surface(loaded->brain.mesh, meshing).mesh;
  const surface::SurfaceModel surface(loaded->brain.mesh);

  BrainShiftOptions supine;
  supine.material = tissue::named_material("thesis");
  supine.solver.threads = 2;
  supine.skull.craniotomy = {surface.closest(loaded->trajectories.front().entry_mm).point_mm, kOpening_mm};
  report.note("shift: the case's brain in " + std::to_string(mesh.tetrahedra.size()) +
              " tetrahedra, the thesis' material; craniotomy of 30 mm radius where '" +
              loaded->trajectories.front().name + "' enters; limits: the thesis' chapter 1");
  BrainShiftOptions opening_up = supine; // the opening is the head's highest point
  opening_up.gravity = -surface.closest(supine.skull.craniotomy.centre_mm).normal;
  BrainShiftOptions lateral = supine; // on the left side
  lateral.gravity = -Vector3d::UnitX();
  const std::pair<std::string, BrainShiftOptions> postures[] = {
      {"shift.supine", supine}, {"shift.opening_up", opening_up}, {"shift.lateral", lateral}};
  for (const auto &[name, posture] : postures) {
    judge(report, name, timed(mesh, posture), posture);
  }
  if (!picture.empty()) {
    draw_shift(mesh, supine, tissue::predict_shift(mesh, supine), picture);
  }
  if (options.quick) {
    return;
  }
  const auto add_figures = [&](const std::string &name, const BrainShiftOptions &how) {
    const BrainShift shift = tissue::predict_shift(mesh, how);
    report.add(figure(name + ".surface", shift.surface.displacement_mm.norm(), "mm"));
    report.add(figure(name + ".deep", shift.deep.displacement_mm.norm(), "mm"));
  };
  for (const auto &[name, posture] : postures) {
    BrainShiftOptions without = posture;
    without.falx = false;
    add_figures(name + ".no_falx", without);
  }
  for (const double drop_mm : {20.0, 40.0, 60.0, 80.0, 120.0}) {
    BrainShiftOptions lower = supine;
    lower.fluid_drop_mm = drop_mm;
    add_figures("shift.supine.drop" + std::to_string(static_cast<int>(drop_mm)), lower);
  }
  for (const double gap_mm : {1.0, 3.0}) {
    BrainShiftOptions looser = supine;
    looser.skull.gap_mm = gap_mm;
    add_figures("shift.supine.gap" + std::to_string(static_cast<int>(gap_mm)), looser);
  }
}

} // namespace bregma::bench
