#include "case_model/brain.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>
#include <vector>

#include "algorithms/planning/surface_entry.hpp"
#include "algorithms/tissue/mesh/mesh_quality.hpp"
#include "algorithms/tissue/mesh/mesh_refinement.hpp"
#include "casefile/tissue_material.hpp"

namespace bregma::case_model {
namespace {

constexpr double kFine_mm = 6.0; // radius of the refinement around an entry
constexpr double kFinest =
    0.5; // minimum fraction of the lattice's edge; with shorter edges, fast indentations diverged
// Fraction of the stable step of the lattice. With the full step, the small tetrahedra became unstable between two
// checks of the critical step, because their step decreases fastest under compression.
constexpr double kMinStepFraction = 0.5;

Eigen::Vector3d way_into(const surface::SurfaceModel &brain, const casefile::Trajectory &trajectory) {
  // For a path that does not reach the brain, the craniotomy is at its start.
  return planning::surface_entry(brain, trajectory.entry_mm, trajectory.target_mm).value_or(trajectory.entry_mm);
}

std::optional<Eigen::Vector3d> centre_of(const casefile::Case &c, const surface::SurfaceModel &brain) {
  if (c.craniotomy && c.craniotomy->trajectory.empty()) {
    return c.craniotomy->centre_mm;
  }
  const casefile::Trajectory *trajectory = c.craniotomy             ? c.trajectory(c.craniotomy->trajectory)
                                           : c.trajectories.empty() ? nullptr
                                                                    : &c.trajectories.front();
  return trajectory == nullptr ? std::nullopt : std::optional(way_into(brain, *trajectory));
}

// Below this step the model adds mass to tetrahedra. The refinement then needs no more steps than the lattice, at the
// cost of a few grams of mass at the entry.
double min_step_s(const Brain &brain) {
  return kMinStepFraction * tissue::stable_step_s(brain.filled.lattice_stable_length_mm, brain.material);
}

} // namespace

tissue::Material material_of(const casefile::Case &c, const tissue::Material &otherwise) {
  return c.tissue ? casefile::material_of(*c.tissue) : otherwise;
}

tissue::Craniotomy craniotomy_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                 double otherwise_radius_mm) {
  const double radius_mm = c.craniotomy && c.craniotomy->radius_mm ? *c.craniotomy->radius_mm : otherwise_radius_mm;
  const auto centre = centre_of(c, brain);
  if (!centre || radius_mm <= 0.0) {
    return {};
  }
  return {brain.closest(*centre).point_mm, radius_mm};
}

tissue::LatticeMesh brain_mesh_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                  const tissue::Craniotomy &craniotomy, const BrainMeshOptions &options) {
  tissue::LatticeMesh out = tissue::fill_surface(c.brain.mesh, options.lattice);
  std::vector<tissue::RefinementRegion> places;
  const double edge_mm = std::max(options.entry_edge_mm, kFinest * out.edge_mm);
  for (const casefile::Trajectory &trajectory : c.trajectories) {
    const auto entry = planning::surface_entry(brain, trajectory.entry_mm, trajectory.target_mm);
    if (entry && (*entry - craniotomy.centre_mm).norm() <= craniotomy.radius_mm && options.entry_edge_mm > 0.0) {
      places.push_back({*entry, kFine_mm, edge_mm});
    }
  }
  out.mesh = tissue::refined(out.mesh, places);
  return out;
}

base::Result<Brain> brain_of(const casefile::Case &c, const BrainSettings &settings) {
  if (c.brain.mesh.triangles.empty()) {
    return base::failure(c.folder.string() + ": the case has no brain (surfaces.brain in case.toml)");
  }
  try {
    const surface::SurfaceModel surface(c.brain.mesh);
    const tissue::Craniotomy craniotomy = craniotomy_of(c, surface, settings.craniotomy_radius_mm);
    return Brain{brain_mesh_of(c, surface, craniotomy, settings.mesh), craniotomy, material_of(c, settings.material)};
  } catch (const std::invalid_argument &error) {
    return base::failure(c.folder.string() + ": the brain's surface: " + error.what());
  }
}

base::Result<std::unique_ptr<tissue::BrainModel>> brain_model_of(const casefile::Case &c, const Brain &brain,
                                                                 std::span<const Eigen::Vector3d> points_mm,
                                                                 tissue::BrainModelOptions options) {
  options.material = brain.material;
  options.skull.craniotomy = brain.craniotomy;
  options.solver.minimum_step_s = min_step_s(brain);
  try {
    return std::make_unique<tissue::BrainModel>(brain.filled.mesh, points_mm, options);
  } catch (const std::invalid_argument &error) {
    return base::failure(c.folder.string() + ": no tissue model of the brain: " + error.what());
  }
}

} // namespace bregma::case_model
