// `bregma case export`: a surface of a case as STL or PLY for other programs and printers.
#include "clients/cli/case/surface_export.hpp"
#include "clients/cli/case/case_output.hpp"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/surface/shell.hpp"
#include "base/text.hpp"
#include "casefile/case.hpp"
#include "casefile/mesh_file.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

struct SurfaceExport {
  std::string folder, file, surface = "scalp";
  bool face = false;
  double thickness_mm = 3.0;
  bool force = false;
};

const surface::TriangleMesh *find_surface(const casefile::Case &c, const std::string &name) {
  if (name == "scalp" || name == "brain") {
    const surface::TriangleMesh &mesh = name == "scalp" ? c.scalp.mesh : c.brain.mesh;
    return mesh.triangles.empty() ? nullptr : &mesh;
  }
  const auto found = std::find_if(c.structures.begin(), c.structures.end(),
                                  [&name](const casefile::Surface &surface) { return surface.name == name; });
  return found != c.structures.end() ? &found->mesh : nullptr;
}

int export_surface(const SurfaceExport &options, const Context &context) {
  const auto loaded = casefile::load_case(options.folder);
  if (!loaded) {
    return fail(loaded.error());
  }
  const surface::TriangleMesh *found = find_surface(*loaded, options.surface);
  if (found == nullptr) {
    std::string names = !loaded->brain.mesh.triangles.empty() ? "\"scalp\", \"brain\"" : "\"scalp\"";
    for (const casefile::Surface &structure : loaded->structures) {
      names += ", \"" + structure.name + "\"";
    }
    return fail("the case has no surface \"" + options.surface + "\"; it has " + names);
  }
  if (auto kept = check_output_of_case("file", options.file, options.folder); !kept) {
    return fail(kept.error());
  }
  if (options.face && options.surface != "scalp") {
    return fail("--face is a part of the scalp, not of \"" + options.surface + "\"");
  }
  std::error_code ignored;
  if (!options.force && std::filesystem::exists(options.file, ignored)) {
    return fail(options.file + ": exists already; --force replaces it");
  }
  const surface::TriangleMesh mesh = options.face ? surface::face_shell(*found, options.thickness_mm) : *found;
  if (const auto closed = casefile::check_closed(mesh); !closed) {
    return fail(options.surface + ": " + closed.error().message);
  }
  const std::string extension = base::lower(std::filesystem::path(options.file).extension().string());
  const auto written = extension == ".stl"   ? casefile::write_stl(options.file, mesh)
                       : extension == ".ply" ? casefile::write_mesh(options.file, mesh)
                                             : base::failure(options.file + ": must be .stl or .ply");
  if (!written) {
    return fail(written.error());
  }
  if (context.json) {
    print_json({{"file", options.file},
                {"surface", options.surface},
                {"face", options.face},
                {"vertices", mesh.vertices_mm.size()},
                {"triangles", mesh.triangles.size()},
                {"space", "RAS"},
                {"unit", "mm"}});
  } else {
    print(options.file + ": " + std::to_string(mesh.vertices_mm.size()) + " vertices, " +
          std::to_string(mesh.triangles.size()) + " triangles, closed; RAS, mm\n");
  }
  return kOk;
}

} // namespace

void add_surface_export(CLI::App &group, Context &context) {
  auto options = std::make_shared<SurfaceExport>();
  auto *command = group.add_subcommand("export", "Writes a surface for other programs and for printing");
  command->add_option("folder", options->folder, "Case folder")->required();
  command->add_option("file", options->file, "File to write: .stl or .ply")->required();
  command->add_option("--surface", options->surface, "scalp, brain, or the name of a structure")->capture_default_str();
  command->add_flag("--face", options->face, "The face alone, as a watertight shell");
  command->add_option("--thickness", options->thickness_mm, "Thickness of the shell, mm")
      ->check(CLI::Range(0.5, 20.0))
      ->capture_default_str();
  command->add_flag("--force", options->force, "Replace the file");
  add_json_flag(*command, context);
  command->footer("Examples:\n  bregma case export colin27 scalp.stl\n"
                  "  bregma case export colin27 face.stl --face --thickness 3\n"
                  "  bregma case export colin27 brain.ply --surface brain");
  command->callback(
      [options, &context] { context.run = [options, &context] { return export_surface(*options, context); }; });
}

} // namespace bregma::cli
