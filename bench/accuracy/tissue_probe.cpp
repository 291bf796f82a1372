// The probe's contact compared with Hertz, and the brain model's answers to arbitrary inputs of operator and tracker:
// docs/tissue_probe.md.
#include <chrono>
#include <cstdio>

#include "algorithms/tissue/mesh/mesh_quality.hpp"
#include "algorithms/tissue/mesh/mesh_refinement.hpp"
#include "bench/accuracy/tissue_parts.hpp"
#include "tests/support/tissue_hertz.hpp"
#include "tests/support/tissue_insertions.hpp"

namespace bregma::bench {
namespace {

constexpr double kMaxHertzError_percent = 5.0;
constexpr double kSphere_mm = 20.0;
constexpr double kPressed_mm = 0.5;

constexpr std::uint32_t kFirstSeed = 1000;
constexpr int kInsertions = 200;
constexpr int kQuickInsertions = 10;

} // namespace

void hertz_figures(Report &report, const TissueBenchOptions &options) {
  report.note("hertz: a sphere of 20 mm radius pressed 0.5 mm into a half space, neo-Hookean; without friction");
  struct Case {
    const char *name;
    test::HertzMesh mesh;
    int steps;
  };
  const std::vector<Case> all = {
      {"coarse", {.cell_mm = 0.8, .even_cells = 8, .growing_cells = 7, .growth = 1.6}, 2000},
      {"medium", {.cell_mm = 0.5, .even_cells = 14, .growing_cells = 9, .growth = 1.6}, 3000},
      {"fine", {.cell_mm = 0.35, .even_cells = 20, .growing_cells = 11, .growth = 1.6}, 5000},
  };
  tissue::SolverOptions solver;
  solver.threads = 2;
  for (const double poisson : {0.3, 0.45}) {
    for (const Case &one : all) {
      const bool finest = &one == &all.back();
      if (finest && options.quick) {
        continue;
      }
      const test::HertzAnswer answer = test::hertz(kSphere_mm, kPressed_mm, poisson, one.mesh, one.steps, solver);
      char text[200];
      std::snprintf(
          text, sizeof text,
          "nu %.2f, %s: %d tetrahedra, cells of %.2f mm under a contact of %.1f mm, %.0f mm deep; contact %.5f "
          "N, foot %.5f N, Hertz %.5f N, last third of the steps %.1e",
          poisson, one.name, answer.elements, one.mesh.cell_mm, answer.contact_radius_mm, answer.size_mm,
          answer.contact_N.value, answer.support_N.value, answer.contact_N.reference, answer.unsettled);
      report.note(text);
      const std::string name = "hertz.nu" + std::to_string(static_cast<int>(100.0 * poisson)) + "." + one.name;
      const double error = kPercent * answer.contact_N.error();
      report.add(finest ? at_most(name, error, "%", kMaxHertzError_percent) : figure(name, error, "%"));
    }
  }
}

void robustness_figures(Report &report, const TissueBenchOptions &options) {
  const int insertions = options.quick ? kQuickInsertions : kInsertions;
  // A block of 90 x 90 x 55 mm, fixed except for an opening at the top, and refined at the entries like a case's brain.
  const Eigen::Vector3d top_mm(45.3, 44.6, 55.0);
  const tissue::RefinementRegion entry{top_mm, 15.0, 5.0};
  const tissue::TetMesh lattice = tissue::block_mesh({18, 18, 11}, {90.0, 90.0, 55.0});
  const tissue::TetMesh mesh = tissue::refined(lattice, {&entry, 1});
  tissue::BrainModelOptions model_options;
  model_options.solver.threads = 2;
  model_options.solver.minimum_step_s =
      0.5 * tissue::stable_step_s(tissue::stable_length_mm(lattice), model_options.material);
  model_options.skull = {.sliding = false, .gap_mm = 0.0, .craniotomy = {top_mm, 40.0}};
  tissue::BrainModel model(mesh, std::vector<Eigen::Vector3d>{top_mm - Eigen::Vector3d(0.0, 0.0, 25.0)}, model_options);
  const test::InsertionSite site{
      .entry_mm = top_mm, .outward = Eigen::Vector3d::UnitZ(), .aside_mm = 15.0, .deepest_mm = 45.0};
  const test::PhysicalBounds bounds = test::physical_bounds(model_options);

  char text[240];
  std::snprintf(text, sizeof text,
                "robustness: %d insertions, seeds %u to %u, into %zu tetrahedra; up to 50 mm/s, with retreats, pauses, "
                "lost sight, jumps and invalid poses; a valid answer displaces no node by more than %.1f mm",
                insertions, kFirstSeed, kFirstSeed + static_cast<unsigned>(insertions) - 1, mesh.tetrahedra.size(),
                bounds.displacement_mm);
  report.note(text);
  test::InsertionFindings all;
  Progress progress("robustness", insertions);
  for (int i = 0; i < insertions; ++i) {
    all.add(test::insert_at_random(model, site, bounds, kFirstSeed + static_cast<std::uint32_t>(i)));
    progress.step();
  }
  for (const std::string &example : all.examples) {
    report.note(example);
  }
  report.add(figure("robustness.updates", all.updates, ""));
  report.add(at_least("robustness.valid", kPercent * all.valid / all.updates, "%", 50.0));
  report.add(figure("robustness.invalid", kPercent * all.invalid / all.updates, "%"));
  report.add(figure("robustness.largest_displacement", all.largest_mm, "mm"));
  report.add(figure("robustness.largest_energy", 1e3 * all.largest_J, "mJ"));
  report.add(at_most("robustness.not_finite", all.not_finite, "answers", 0.0));
  report.add(at_most("robustness.inverted_but_valid", all.inverted, "answers", 0.0));
  report.add(at_most("robustness.beyond_bounds_but_valid", all.beyond_bounds, "answers", 0.0));
  report.add(at_most("robustness.contradictions", all.contradictions, "answers", 0.0));
  report.add(at_most("robustness.not_back_at_rest", all.not_at_rest, "insertions", 0.0));
}

} // namespace bregma::bench
