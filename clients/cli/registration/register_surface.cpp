// `bregma register surface`: registers samples of the skin to the surface of a head, from any pose or a given start.
#include <memory>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/output.hpp"
#include "clients/cli/registration/register_commands.hpp"
#include "clients/cli/registration/surface_registration.hpp"

namespace bregma::cli {

namespace {

int register_surface(const SurfaceArguments &arguments, const Context &context) {
  if (auto kept =
          check_output("--tfm", arguments.files.tfm,
                       {arguments.files.source.path, arguments.files.target.path, arguments.targets, arguments.start});
      !kept) {
    return fail(kept.error());
  }
  const auto samples = read_cloud(arguments.files.source, casefile::kPointsSize);
  if (!samples) {
    return fail(samples.error());
  }
  const auto input = read_surface_input(arguments);
  if (!input) {
    return fail(input.error());
  }
  return register_samples(arguments, *samples, *input, {}, nlohmann::json::object(), context);
}

} // namespace

void add_register_surface(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("surface", "Registers samples of the skin onto the surface of a head");
  auto arguments = std::make_shared<SurfaceArguments>();
  add_registration_files(*command, arguments->files, "samples",
                         "Traced or touched skin: .csv (x,y,z), .mrk.json, .fcsv, or a mesh, whose vertices are taken",
                         "surface",
                         "PLY, STL, VTK, GIFTI or FreeSurfer; or an image of the head, whose scalp is extracted");
  add_surface_options(*command, *arguments);
  add_json_flag(*command, context);
  command->footer("Searches all poses. The verdict is found, ambiguous or refused (exit code 1), with advice where to\n"
                  "touch next. Only a pose that is found is printed as a transform and written by --tfm.\n\nExamples:\n"
                  "  bregma register surface trace.csv scalp.ply --targets lesion.mrk.json --tfm patient_to_image.tfm\n"
                  "  bregma register surface trace.csv head.nii.gz --sigma-mm 0.7 --json\n"
                  "  bregma register surface trace.csv skin.stl --target-space ras --start last.tfm");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return register_surface(*arguments, context); }; });
}

} // namespace bregma::cli
