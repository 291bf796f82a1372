#include "clients/cli/case/mesh_command.hpp"
#include "clients/cli/case/case_output.hpp"

#include <filesystem>
#include <memory>
#include <string>

#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "casefile/tissue_files/tet_file.hpp"
#include "clients/cli/case/progress_line.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/tissue/brain_mesh.hpp"

namespace bregma::cli {
namespace {

struct MeshOptions {
  std::string folder;
  MeshRequest request;
  std::string out; // empty: next to case.toml
};

std::vector<casefile::TetField> quality_fields(const tissue::TetMesh &mesh) {
  casefile::TetField length{"stable_length_mm", 1, {}};
  for (const Eigen::Vector4i &t : mesh.tetrahedra) {
    const auto node = [&](int i) -> const Eigen::Vector3d & { return mesh.nodes_mm[static_cast<std::size_t>(t[i])]; };
    length.values.push_back(tissue::stable_length_mm(node(0), node(1), node(2), node(3)));
  }
  return {{"radius_ratio", 1, tissue::radius_ratios(mesh)}, std::move(length)};
}

base::Result<MeshReport> make_mesh(const MeshOptions &options, const std::filesystem::path &file) {
  ProgressLine progress;
  const auto goes_on = [&](double done, const char *stage) -> base::Result<void> {
    return progress.show(done, stage) ? base::Result<void>() : base::failure("stopped");
  };
  if (auto on = goes_on(0.0, "case"); !on) {
    return tl::unexpected(on.error());
  }
  const auto loaded = casefile::load_case(options.folder);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  if (auto on = goes_on(0.1, "tetrahedra"); !on) {
    return tl::unexpected(on.error());
  }
  const auto brain = fill_brain(*loaded, options.request);
  if (!brain) {
    return tl::unexpected(brain.error());
  }
  if (auto on = goes_on(0.9, "file"); !on) {
    return tl::unexpected(on.error());
  }
  if (auto written = casefile::write_tet_mesh(file, brain->filled.mesh, {}, quality_fields(brain->filled.mesh));
      !written) {
    return tl::unexpected(written.error());
  }
  return report_of(*brain);
}

int run_mesh(const MeshOptions &options, const Context &context) {
  if (auto kept = check_output_of_case("--out", options.out, options.folder); !kept) {
    return fail(kept.error());
  }
  const std::filesystem::path file =
      options.out.empty() ? std::filesystem::path(options.folder) / "tissue.vtu" : std::filesystem::path(options.out);
  const auto report = make_mesh(options, file);
  if (!report) {
    return fail(report.error());
  }
  if (context.json) {
    nlohmann::json out = report_json(*report);
    out["file"] = file.string();
    print_json(out);
  } else {
    print(report_text(*report) + "\nWritten: " + file.string() + "\n");
  }
  return kOk;
}

} // namespace

void add_mesh_command(CLI::App &group, Context &context) {
  auto options = std::make_shared<MeshOptions>();
  auto *command = group.add_subcommand("mesh", "Meshes a case's brain with tetrahedra and reports their quality");
  command->add_option("folder", options->folder, "Case folder")->required();
  add_mesh_options(*command, options->request);
  add_entry_option(*command, options->request);
  command->add_option("--out", options->out, "VTU to write (default: tissue.vtu in the case folder)");
  add_json_flag(*command, context);
  command->footer("Examples:\n  bregma case mesh colin27\n"
                  "  bregma case mesh colin27 --elements 60000 --out fine.vtu\n"
                  "  bregma case mesh colin27 --edge 6");
  command->callback([options, &context] { context.run = [options, &context] { return run_mesh(*options, context); }; });
}

} // namespace bregma::cli
