// `bregma mri points`: control points of a phantom, a grid or separate markers, in an image.
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <nlohmann/json.hpp>
#include <tl/expected.hpp>

#include "algorithms/mri/grid/grid_points.hpp"
#include "algorithms/mri/grid/marker_points.hpp"
#include "base/text.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/scan_header.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/mri/field_use.hpp"
#include "clients/cli/mri/mri_commands.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

using nlohmann::json;

namespace {

struct PointsArguments {
  std::string image, output, series;
  bool separate_markers = false;
  mri::GridOptions grid;
  mri::MarkerOptions markers;
};

struct FoundPoints {
  geometry::Points3 points_mm;
  json figures; // counts, for JSON
  std::string text;
};

std::string left_out_lines(const geometry::Points3 &points_mm, const char *why) {
  std::string out;
  for (Eigen::Index i = 0; i < points_mm.cols(); ++i) {
    out += "Left out: " + vector_text(points_mm.col(i), 1) + " mm " + why + "\n";
  }
  return out;
}

tl::expected<FoundPoints, std::string> grid_crossings(const casefile::Volume &image, const mri::GridOptions &options) {
  const auto found = mri::find_grid_points(image, options);
  if (!found) {
    return tl::unexpected(found.error());
  }
  return FoundPoints{found->points_mm,
                     {{"planes", found->planes},
                      {"cell_mm", json_number(found->cell_mm)},
                      {"completed", found->completed},
                      {"merged", found->merged},
                      {"left_out", found->left_out_mm.cols()}},
                     std::to_string(found->points_mm.cols()) + " control points, " + fixed(found->cell_mm, 2, "mm") +
                         " apart; " + std::to_string(found->completed) + " of them only by the lattice, " +
                         std::to_string(found->merged) + " doubled ones merged\n" +
                         left_out_lines(found->left_out_mm, "does not fit the lattice")};
}

tl::expected<FoundPoints, std::string> separate_markers(const casefile::Volume &image,
                                                        const mri::MarkerOptions &options) {
  const auto found = mri::find_marker_points(image, options);
  if (!found) {
    return tl::unexpected(found.error());
  }
  return FoundPoints{found->points_mm,
                     {{"not_separate", found->not_separate_mm.cols()},
                      {"cut_off", found->cut_off_mm.cols()},
                      {"crowded", found->crowded_mm.cols()}},
                     std::to_string(found->points_mm.cols()) + " separate markers\n" +
                         left_out_lines(found->not_separate_mm, "is larger than a marker") +
                         left_out_lines(found->crowded_mm, "is nearer to a marker than its width (--marker-mm)") +
                         left_out_lines(found->cut_off_mm, "is cut by the border of the image")};
}

// What `bregma mri field` is told about a scan.
std::string origin_text(const casefile::ScanHeader &header) {
  return header.modality != "MR" ? ""
                                 : "Scanner \"" + header.scanner() + "\", patient position " +
                                       (header.patient_position.empty() ? "not stated" : header.patient_position) +
                                       ": --scanner and --patient-position of `bregma mri field`\n";
}

int refuse_points(const std::string &reason, const Context &context) {
  json nothing;
  withhold(nothing, {"output", "points"});
  return refuse("refused", reason, context, std::move(nothing));
}

int run_points(const PointsArguments &arguments, const Context &context) {
  if (auto free = check_output("--output", arguments.output, {arguments.image}); !free) {
    return fail(free.error());
  }
  if (!base::lower(arguments.output).ends_with(".json")) {
    return fail("--output " + arguments.output + ": control points are written as .mrk.json");
  }
  std::vector<std::string> notes;
  casefile::VolumeOptions options;
  options.series = arguments.series;
  const auto image = casefile::read_volume(arguments.image, options, &notes);
  if (!image) {
    print_notes(notes);
    return fail(image.error());
  }
  const auto header = check_phantom_image(arguments.image, arguments.series, notes);
  print_notes(notes);
  if (!header) {
    return refuse_points(header.error().message, context);
  }
  const auto found =
      arguments.separate_markers ? separate_markers(*image, arguments.markers) : grid_crossings(*image, arguments.grid);
  if (!found) {
    return refuse_points(arguments.image + ": " + found.error(), context);
  }
  std::vector<casefile::NamedPoint> points;
  for (Eigen::Index i = 0; i < found->points_mm.cols(); ++i) {
    points.push_back({std::to_string(i + 1), found->points_mm.col(i)});
  }
  if (auto written = casefile::write_points(arguments.output, arguments.separate_markers ? "markers" : "grid", points);
      !written) {
    return fail(written.error());
  }
  if (context.json) {
    json out = found->figures;
    out["accepted"] = true;
    out["output"] = arguments.output;
    out["points"] = points.size();
    out["scanner"] = *header ? json((*header)->scanner()) : json();
    out["patient_position"] = *header ? json((*header)->patient_position) : json();
    print_json(out);
    return kOk;
  }
  print(found->text + (*header ? origin_text(**header) : std::string()) + "Written: " + arguments.output + "\n");
  return kOk;
}

} // namespace

void add_mri_points(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("points", "Finds the control points of a phantom in an image");
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
  auto *markers = command->add_flag("--markers", arguments->separate_markers,
                                    "The phantom has separate bright markers instead of bars");
  command->add_option("--marker-mm", arguments->markers.marker_mm, "Diameter of a marker, with --markers")
      ->check(CLI::Range(1.0, 100.0))
      ->capture_default_str()
      ->needs(markers);
  add_json_flag(*command, context);
  command->footer("The exit code is 1 where the image shows no such phantom.\n\nExamples:\n"
                  "  bregma mri points ct/ -o ct.mrk.json --ct\n"
                  "  bregma mri points mr.nrrd -o mr.mrk.json --cell-mm 17 --bar-mm 2\n"
                  "  bregma mri points mr/ -o mr.mrk.json --markers --marker-mm 10");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_points(*arguments, context); }; });
}

} // namespace bregma::cli
