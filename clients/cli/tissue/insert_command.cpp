#include "clients/cli/tissue/insert_command.hpp"
#include "clients/cli/case/case_output.hpp"

#include <memory>
#include <optional>
#include <string>
#include <utility>

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>

#include "base/write_file.hpp"
#include "case_model/brain.hpp"
#include "clients/cli/case/progress_line.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/tissue/brain_mesh.hpp"
#include "clients/cli/tissue/insertion.hpp"
#include "clients/cli/tissue/tissue_state.hpp"

namespace bregma::cli {
namespace {

using base::failure;
using base::Result;

struct InsertOptions {
  std::string folder;
  std::string trajectory; // empty: the first one
  double speed_mm_s = 5.0;
  std::optional<double> depth_mm; // default: to the target
  MeshRequest mesh;
  std::string csv, vtu; // empty: not written
};

struct InsertionRun {
  std::string trajectory;
  double entry_to_target_mm = 0.0;
  int elements = 0;
  std::string material;
  std::vector<InsertionUpdate> updates;
  std::unique_ptr<tissue::BrainModel> model; // in the final state
};

Result<const casefile::Trajectory *> trajectory_of(const casefile::Case &c, const std::string &name) {
  if (c.trajectories.empty()) {
    return failure(c.folder.string() + ": the case has no trajectory to insert along");
  }
  if (name.empty()) {
    return &c.trajectories.front();
  }
  if (const casefile::Trajectory *found = c.trajectory(name)) {
    return found;
  }
  std::string names;
  for (const casefile::Trajectory &trajectory : c.trajectories) {
    names += (names.empty() ? "\"" : ", \"") + trajectory.name + "\"";
  }
  return failure("--trajectory \"" + name + "\": " + c.folder.string() + " has no such trajectory; there are " + names);
}

Result<InsertionRun> run_insertion(const InsertOptions &options) {
  ProgressLine progress;
  if (!progress.show(0.0, "case")) {
    return failure("stopped");
  }
  const auto loaded = casefile::load_case(options.folder);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  const auto trajectory = trajectory_of(*loaded, options.trajectory);
  if (!trajectory) {
    return tl::unexpected(trajectory.error());
  }
  const auto path = InsertionPath::along(*loaded, **trajectory, tissue::ProbeShape{}.radius_mm);
  if (!path) {
    return tl::unexpected(path.error());
  }
  if (!progress.show(0.02, "tetrahedra")) {
    return failure("stopped");
  }
  const auto brain = fill_brain(*loaded, options.mesh);
  if (!brain) {
    return tl::unexpected(brain.error());
  }
  auto model = case_model::brain_model_of(*loaded, *brain, {&(*trajectory)->target_mm, 1});
  if (!model) {
    return tl::unexpected(model.error());
  }
  InsertionRun out{.trajectory = (*trajectory)->name,
                   .entry_to_target_mm = path->target_depth_mm(),
                   .elements = (*model)->solver().elements(),
                   .material = (*model)->solver().material().name,
                   .updates = {},
                   .model = std::move(*model)};
  const InsertionPlan plan{.speed_mm_s = options.speed_mm_s,
                           .depth_mm = options.depth_mm.value_or(path->target_depth_mm())};
  bool stopped = false;
  out.updates = insert(*out.model, *path, plan, [&](const InsertionUpdate &update) {
    const double gone = (update.depth_mm - path->start_depth_mm()) / (plan.depth_mm - path->start_depth_mm());
    stopped = !progress.show(0.1 + 0.9 * gone, "insertion: " + fixed(update.depth_mm, 1, "mm"));
    return !stopped;
  });
  return stopped ? failure("stopped") : Result<InsertionRun>(std::move(out));
}

nlohmann::json updates_json(const InsertionRun &insertion) {
  nlohmann::json updates = nlohmann::json::array();
  for (const InsertionUpdate &update : insertion.updates) {
    const bool valid = update.state.status != tissue::ModelStatus::kInvalid; // else nothing may be used: null
    const auto number = [valid](double value) { return valid ? json_number(value) : nlohmann::json(); };
    updates.push_back({{"time_s", update.time_s},
                       {"depth_mm", update.depth_mm},
                       {"phase", tissue::name_of(update.state.phase)},
                       {"status", tissue::name_of(update.state.status)},
                       {"reason", tissue::sentence_of(update.state.reason)},
                       {"tip_force_N", number(update.state.tip_force_N)},
                       {"shaft_force_N", number(update.state.shaft_force_N)},
                       {"largest_von_mises_Pa", number(update.largest_von_mises_Pa)},
                       {"target_von_mises_Pa", number(update.target_von_mises_Pa)},
                       {"target_motion_mm", number(update.target_motion_mm)},
                       {"target_error_bound_mm", number(update.target_error_bound_mm)}});
  }
  return updates;
}

void show(const InsertionRun &insertion, const InsertOptions &options, const Context &context) {
  const int invalid = invalid_updates(insertion.updates);
  const tissue::BrainState &last = insertion.updates.back().state;
  if (context.json) {
    print_json({{"trajectory", insertion.trajectory},
                {"entry_to_target_mm", json_number(insertion.entry_to_target_mm)},
                {"elements", insertion.elements},
                {"material", insertion.material},
                {"ruptures", last.ruptures},
                {"rupture_force_N", last.ruptures > 0 ? json_number(last.rupture_force_N) : nlohmann::json(nullptr)},
                {"invalid_updates", invalid},
                {"updates", updates_json(insertion)}});
    return;
  }
  std::string text = "Trajectory " + insertion.trajectory + ", " + fixed(insertion.entry_to_target_mm, 1, "mm") +
                     " in the brain; " + std::to_string(insertion.elements) + " tetrahedra of " + insertion.material +
                     "\n\n" + insertion_table(insertion.updates) + "\n";
  text += last.ruptures > 0 ? "The surface ruptured at " + fixed(last.rupture_force_N, 3, "N") + ".\n"
                            : "The surface did not rupture.\n";
  text += std::to_string(insertion.updates.size()) + " updates, " + std::to_string(invalid) + " of them invalid.\n";
  for (const std::string &file : {options.csv, options.vtu}) {
    text += file.empty() ? "" : "Written: " + file + "\n";
  }
  print(text);
}

int run_insert(const InsertOptions &options, const Context &context) {
  for (const auto &[option, file] : {std::pair{"--csv", options.csv}, {"--vtu", options.vtu}}) {
    if (auto kept = check_output_of_case(option, file, options.folder); !kept) {
      return fail(kept.error());
    }
  }
  const auto insertion = run_insertion(options);
  if (!insertion) {
    return fail(insertion.error());
  }
  if (!options.csv.empty()) {
    if (auto written = base::write_file(options.csv, insertion_csv(insertion->updates)); !written) {
      return fail(written.error());
    }
  }
  if (!options.vtu.empty()) {
    if (auto written = write_state(options.vtu, insertion->model->solver()); !written) {
      return fail(written.error());
    }
  }
  show(*insertion, options, context);
  return lost(insertion->updates) ? kRefused : kOk;
}

} // namespace

void add_insert_command(CLI::App &group, Context &context) {
  auto options = std::make_shared<InsertOptions>();
  auto *command = group.add_subcommand("insert", "Drives a probe along a trajectory into a model of the case's brain");
  command->add_option("folder", options->folder, "Case folder")->required();
  command->add_option("--trajectory", options->trajectory, "Name of the trajectory (default: the first)");
  command->add_option("--speed", options->speed_mm_s, "Speed of the probe, mm/s")
      ->check(CLI::Range(0.1, 100.0))
      ->capture_default_str();
  command
      ->add_option("--depth", options->depth_mm,
                   "Depth of the tip beyond the brain's surface, mm (default: the target's)")
      ->check(CLI::Range(0.1, 200.0));
  add_mesh_options(*command, options->mesh);
  add_entry_option(*command, options->mesh);
  command->add_option("--csv", options->csv, "Write all updates to this file");
  command->add_option("--vtu", options->vtu, "Write displacement and stress at the end to this file");
  add_json_flag(*command, context);
  command->footer(
      "The exit code is 1 when the model lost the probe's path, or its last answer is invalid; at a rupture a few "
      "are.\n\n"
      "Examples:\n  bregma tissue insert colin27\n"
      "  bregma tissue insert colin27 --trajectory Biopsy --speed 2 --depth 30 --csv run.csv --vtu end.vtu");
  command->callback(
      [options, &context] { context.run = [options, &context] { return run_insert(*options, context); }; });
}

} // namespace bregma::cli
