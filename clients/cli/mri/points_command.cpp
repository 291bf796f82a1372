// `bregma mri points`: control points of a grid phantom in an image.
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/mri/grid/grid_points.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/mri/mri_commands.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

struct PointsArguments {
  std::string image, output, series;
  mri::GridOptions grid;
};

int run_points(const PointsArguments &arguments, const Context &context) {
  if (auto free = check_output("--output", arguments.output, {arguments.image}); !free) {
    return fail(free.error());
  }
  std::vector<std::string> notes;
  casefile::VolumeOptions options;
  options.series = arguments.series;
  const auto image = casefile::read_volume(arguments.image, options, &notes);
  print_notes(notes);
  if (!image) {
    return fail(image.error());
  }
  const auto found = mri::find_grid_points(*image, arguments.grid);
  if (!found) {
    fail(arguments.image + ": " + found.error());
    return kRefused;
  }
  std::vector<casefile::NamedPoint> points;
  for (Eigen::Index i = 0; i < found->points_mm.cols(); ++i) {
    points.push_back({std::to_string(i + 1), found->points_mm.col(i)});
  }
  if (auto written = casefile::write_points(arguments.output, "grid", points); !written) {
    return fail(written.error());
  }
  if (context.json) {
    print_json({{"output", arguments.output},
                {"points", points.size()},
                {"planes", found->planes},
                {"completed", found->completed},
                {"merged", found->merged},
                {"left_out", found->left_out_mm.cols()}});
    return kOk;
  }
  std::string text = std::to_string(points.size()) + " control points in " + std::to_string(found->planes) +
                     " planes; " + std::to_string(found->completed) + " of them only by the lattice, " +
                     std::to_string(found->merged) + " doubled ones merged\n";
  for (Eigen::Index i = 0; i < found->left_out_mm.cols(); ++i) {
    text += "Left out: " + vector_text(found->left_out_mm.col(i), 1) + " mm does not fit the lattice\n";
  }
  print(text + "Written: " + arguments.output + "\n");
  return kOk;
}

} // namespace

void add_mri_points(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("points", "Finds the control points of a grid phantom in an image");
  auto arguments = std::make_shared<PointsArguments>();
  command->add_option("image", arguments->image, "Folder with a DICOM series, or NIfTI, NRRD, MetaImage")->required();
  command->add_option("-o,--output", arguments->output, "Control points (.mrk.json)")->required();
  command->add_option("--series", arguments->series, "UID of the series, where a folder holds several");
  command->add_flag("--ct", arguments->grid.bright, "The bars are brighter than what surrounds them");
  command->add_option("--cell-mm", arguments->grid.cell_mm, "Distance of neighbouring bars")
      ->check(CLI::Range(2.0, 200.0))
      ->capture_default_str();
  command->add_option("--bar-mm", arguments->grid.bar_mm, "Width of a bar")
      ->check(CLI::Range(0.2, 50.0))
      ->capture_default_str();
  add_json_flag(*command, context);
  command->footer("The exit code is 1 where the image shows no such grid.\n\nExamples:\n"
                  "  bregma mri points ct/ -o ct.mrk.json --ct\n"
                  "  bregma mri points mr.nrrd -o mr.mrk.json --cell-mm 17 --bar-mm 2");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_points(*arguments, context); }; });
}

} // namespace bregma::cli
