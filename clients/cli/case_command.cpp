// `bregma case`: makes a case folder from images and plans, shows it, checks it, renders it, and meshes its brain.
#include <filesystem>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>

#include "base/write_file.hpp"
#include "casefile/markups.hpp"
#include "casefile/volumes/case_builder.hpp"
#include "casefile/volumes/case_picture.hpp"
#include "clients/cli/case/case_facts.hpp"
#include "clients/cli/case/case_output.hpp"
#include "clients/cli/case/case_parts.hpp"
#include "clients/cli/case/load_command.hpp"
#include "clients/cli/case/mesh_command.hpp"
#include "clients/cli/case/progress_line.hpp"
#include "clients/cli/case/surface_export.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

namespace fs = std::filesystem;

struct CreateOptions {
  std::string folder;
  casefile::CaseSources sources;
  std::vector<std::string> structures;
  double threshold = 0.0;
  std::string space; // "", "ras" or "lps"
  bool force = false;
};

int run_create(CreateOptions options, const Context &context) {
  casefile::CaseSources &sources = options.sources;
  if (const std::vector<CasePart> parts = parts_to_give(sources); !parts.empty()) {
    std::string needed;
    for (const CasePart &part : parts) {
      needed += std::string(needed.empty() ? "" : "; ") + part.option + ", " + part.purpose;
    }
    return fail("a case also needs " + needed + " (docs/first-case.md)");
  }
  for (const std::string &text : options.structures) {
    auto request = casefile::parse_structure(text);
    if (!request) {
      return fail(request.error());
    }
    sources.structures.push_back(std::move(*request));
  }
  if (!options.space.empty()) {
    sources.space = options.space == "ras" ? casefile::Space::kRas : casefile::Space::kLps;
  }
  if (sources.id.empty()) {
    sources.id = fs::absolute(fs::path(options.folder) / "").lexically_normal().parent_path().filename().string();
  }
  const auto created = [&] {
    ProgressLine progress;
    return casefile::create_case(options.folder, sources, options.force,
                                 [&](double done, std::string_view stage) { return progress.show(done, stage); });
  }();
  if (!created) {
    return fail(created.error());
  }
  if (context.json) {
    nlohmann::json surfaces = nlohmann::json::array();
    for (const auto &[name, vertices, report] : created->surfaces) {
      surfaces.push_back({{"name", name},
                          {"vertices", vertices},
                          {"threshold", json_number(report.threshold)},
                          {"volume_ml", json_number(report.volume_ml)},
                          {"full_vertices", report.full_vertices},
                          {"mean_distance_mm", json_number(report.mean_distance_mm)},
                          {"max_distance_mm", json_number(report.max_distance_mm)}});
    }
    print_json({{"id", created->value.id},
                {"folder", created->value.folder.string()},
                {"surfaces", surfaces},
                {"missing", parts_json(missing_parts(created->value))},
                {"patient_file", created->has_patient},
                {"notes", created->notes}});
    return kOk;
  }
  print_notes(created->notes);
  if (created->has_patient) {
    print_notes({"patient.json keeps the patient's name, ID and birth date, for the display on this host (--anonymous: "
                 "nothing is kept)"});
  }
  Table table({"surface", "vertices", "of", "volume ml", "mean off mm", "worst off mm"});
  for (const auto &[name, vertices, report] : created->surfaces) {
    table.row({name, std::to_string(vertices), std::to_string(report.full_vertices), fixed(report.volume_ml, 1),
               fixed(report.mean_distance_mm, 3), fixed(report.max_distance_mm, 3)});
  }
  print("Case " + created->value.id + " made in " + created->value.folder.string() + "\n\n" + table.text() +
        "\nOff: distance of the full surface's vertices from the reduced surface.\n");
  if (const auto missing = missing_parts(created->value); !missing.empty()) {
    print("\n" + parts_text(missing));
  }
  return kOk;
}

int run_show(const std::string &folder, const Context &context) {
  const auto loaded = casefile::load_case(folder);
  if (!loaded) {
    return fail(loaded.error());
  }
  const CaseFacts facts = facts_of(*loaded);
  if (context.json) {
    print_json(facts_json(*loaded, facts));
  } else {
    print(facts_text(*loaded, facts));
  }
  return kOk;
}

int run_check(const std::string &folder, const Context &context) {
  const auto loaded = casefile::load_case(folder);
  std::vector<std::string> problems;
  std::vector<CasePart> missing;
  if (loaded) {
    missing = missing_parts(*loaded);
    problems = find_warnings(*loaded, facts_of(*loaded));
  } else {
    problems.push_back(loaded.error().message);
  }
  if (context.json) {
    print_json(
        {{"folder", folder}, {"ok", problems.empty()}, {"problems", problems}, {"missing", parts_json(missing)}});
  } else {
    for (const std::string &problem : problems) {
      print(problem + "\n");
    }
    print(parts_text(missing));
    print(folder + (problems.empty() ? ": nothing wrong was found\n" : ": not fit for use as it is\n"));
  }
  return problems.empty() ? kOk : kRefused;
}

struct SnapOptions {
  std::string folder;
  double max_mm = casefile::kMaxSnap_mm;
};

int run_snap(const SnapOptions &options, const Context &context) {
  auto loaded = casefile::load_case(options.folder);
  if (!loaded) {
    return fail(loaded.error());
  }
  Table table({"point", "moved mm"});
  nlohmann::json moved = nlohmann::json::array();
  for (auto *points : {&loaded->fiducials, &loaded->landmarks}) {
    const auto moves = casefile::snap_points(*points, loaded->scalp, options.max_mm);
    if (!moves) {
      return fail(moves.error());
    }
    for (const auto &[name, distance] : *moves) {
      table.row({name, fixed(distance, 2)});
      moved.push_back({{"name", name}, {"moved_mm", json_number(distance)}});
    }
  }
  if (auto saved = casefile::save_case(*loaded); !saved) {
    return fail(saved.error());
  }
  if (context.json) {
    print_json({{"folder", options.folder}, {"points", moved}});
  } else {
    print(table.text());
  }
  return kOk;
}

struct PictureOptions {
  std::string folder;
  std::string file;
  std::string view = "0.75,0.6,0.45";
  int size = 1000;
};

base::Result<Eigen::Vector3d> view_direction(const std::string &text) {
  const std::pair<const char *, Eigen::Vector3d> named[] = {{"front", {0.0, 1.0, 0.0}},
                                                            {"back", {0.0, -1.0, 0.0}},
                                                            {"right", {1.0, 0.0, 0.0}},
                                                            {"left", {-1.0, 0.0, 0.0}},
                                                            {"top", {0.0, 0.0, 1.0}}};
  for (const auto &[name, direction] : named) {
    if (text == name) {
      return direction;
    }
  }
  std::istringstream stream(text);
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  char comma1 = 0;
  char comma2 = 0;
  if (!(stream >> direction.x() >> comma1 >> direction.y() >> comma2 >> direction.z()) || comma1 != ',' ||
      comma2 != ',' || !stream.eof() || !(direction.norm() > 1e-6)) {
    return base::failure("--view " + text + ": must be front, back, left, right, top or a direction x,y,z in RAS");
  }
  return direction;
}

int run_picture(const PictureOptions &options, const Context &context) {
  if (auto kept = check_output_of_case("file", options.file, options.folder); !kept) {
    return fail(kept.error());
  }
  const auto direction = view_direction(options.view);
  if (!direction) {
    return fail(direction.error());
  }
  const auto loaded = casefile::load_case(options.folder);
  if (!loaded) {
    return fail(loaded.error());
  }
  const auto scene = casefile::case_scene(*loaded, *direction, options.size, options.size);
  const auto png = casefile::encode_png(casefile::render(scene));
  if (!png) {
    return fail(png.error());
  }
  const auto written =
      base::write_file(options.file, {reinterpret_cast<const char *>(png->data()), png->size()}); // NOLINT
  if (!written) {
    return fail(written.error());
  }
  if (context.json) {
    print_json({{"file", options.file}, {"bytes", png->size()}});
  } else {
    print("Written: " + options.file + "\n");
  }
  return kOk;
}

void add_create(CLI::App &group, Context &context) {
  auto options = std::make_shared<CreateOptions>();
  casefile::CaseSources &sources = options->sources;
  auto *command = group.add_subcommand("create", "Makes a case folder from images and plans");
  command->add_option("folder", options->folder, "Folder to make")->required();
  command->add_option("--image", sources.image,
                      "Head: NIfTI, NRRD, MetaImage, or a folder with a DICOM series; needed");
  command->add_option("--series", sources.series, "Series UID, where the DICOM folder holds several");
  command->add_option("--source-space", options->space, "Space of images that do not state it: ras or lps")
      ->check(CLI::IsMember({"ras", "lps"}));
  command->add_option("--brain", sources.brain,
                      "The same head without skull, or a mask: voxels above 0 are brain.\n"
                      "For the tissue model; navigation needs none");
  command->add_option("--labels", sources.labels, "Regions: a label image on the same head");
  command->add_option("--label-names", sources.label_names,
                      "Names of the regions: a table, or freesurfer, hammers, neuromorphometrics (default: next to the "
                      "labels, .txt)");
  command->add_option("--structure", options->structures,
                      "Critical structure: \"Region\" or \"Name=Region,Region\"; any number of them\n"
                      "(default: precentral gyri, occipital lobes and Heschl's gyri of the AAL atlas)");
  command->add_option("--fiducials", sources.fiducials, "Slicer markups (.mrk.json): points to register by; needed");
  command->add_option("--landmarks", sources.landmarks, "Slicer markups: landmarks for check touches");
  command->add_option("--brain-landmarks", sources.brain_landmarks,
                      "Slicer markups: points in the brain that the tissue model follows, such as AC and PC");
  command->add_option("--targets", sources.targets, "Slicer markups: targets");
  command->add_option("--trajectories", sources.trajectories, "Slicer markups: lines, entry first");
  command->add_option("--tools", sources.tools, "TOML with [[tools]]; needed");
  command->add_option("--id", sources.id, "Name of the case, nothing about the patient (default: the folder's name)");
  command
      ->add_option("--vertices", sources.vertices, "Number of vertices of scalp and of brain; half of it per structure")
      ->check(CLI::Range(500, 200'000))
      ->capture_default_str();
  auto *threshold = command->add_option("--threshold", options->threshold, "Threshold of the scalp (default: Otsu's)");
  command->add_flag("--snap", sources.snap, "Move fiducials and landmarks onto the scalp, by at most 10 mm");
  command->add_flag("--anonymous", sources.anonymous,
                    "Keep nothing about the patient; else patient.json has name, ID and birth date of a DICOM header");
  command->add_flag("--force", options->force, "Replace the case that is there; its sessions are kept");
  add_json_flag(*command, context);
  command->footer(
      "Examples:\n"
      "  bregma case create colin27 --image ch2.nii.gz --brain ch2bet.nii.gz --labels aal.nii.gz \\\n"
      "    --fiducials fiducials.mrk.json --landmarks landmarks.mrk.json --targets targets.mrk.json \\\n"
      "    --trajectories trajectories.mrk.json --tools tools.toml\n"
      "  bregma case create c1 --image dicom/ --brain brain.nrrd --labels aal.nii.gz \\\n"
      "    --structure \"Thalamus L=Thalamus_L\" --structure Insula_L --fiducials f.mrk.json --tools tools.toml");
  command->callback([options, threshold, &context] {
    if (threshold->count() > 0) {
      options->sources.scalp_threshold = options->threshold;
    }
    context.run = [options, &context] { return run_create(*options, context); };
  });
}

using FolderCommand = int (*)(const std::string &, const Context &);

void add_folder_command(CLI::App &group, Context &context, const std::string &name, const std::string &text,
                        FolderCommand run) {
  auto folder = std::make_shared<std::string>();
  auto *command = group.add_subcommand(name, text);
  command->add_option("folder", *folder, "Case folder")->required();
  add_json_flag(*command, context);
  command->footer("Example:\n  bregma case " + name + " colin27");
  command->callback(
      [folder, run, &context] { context.run = [folder, run, &context] { return run(*folder, context); }; });
}

void add_snap(CLI::App &group, Context &context) {
  auto options = std::make_shared<SnapOptions>();
  auto *command = group.add_subcommand("snap", "Moves a case's fiducials and landmarks onto its scalp");
  command->add_option("folder", options->folder, "Case folder")->required();
  command->add_option("--max", options->max_mm, "Refuse to move a point farther than this, mm")
      ->check(CLI::Range(0.1, 30.0))
      ->capture_default_str();
  add_json_flag(*command, context);
  command->footer("Example:\n  bregma case snap colin27 --max 5");
  command->callback([options, &context] { context.run = [options, &context] { return run_snap(*options, context); }; });
}

void add_picture(CLI::App &group, Context &context) {
  auto options = std::make_shared<PictureOptions>();
  auto *command = group.add_subcommand("picture", "Draws a case; needs no display");
  command->add_option("folder", options->folder, "Case folder")->required();
  command->add_option("file", options->file, "PNG to write")->required();
  command->add_option("--view", options->view, "front, back, left, right, top, or the viewer's position x,y,z, RAS")
      ->capture_default_str();
  command->add_option("--size", options->size, "Pixels per side")->check(CLI::Range(64, 8192))->capture_default_str();
  add_json_flag(*command, context);
  command->footer("Example:\n  bregma case picture colin27 colin27.png --view front");
  command->callback(
      [options, &context] { context.run = [options, &context] { return run_picture(*options, context); }; });
}

} // namespace

void add_case_command(CLI::App &app, Context &context) {
  auto *group = app.add_subcommand("case", "Makes, shows, checks, draws, meshes and loads case folders");
  group->require_subcommand(1);
  add_create(*group, context);
  add_folder_command(*group, context, "show", "Surfaces, points, trajectories and their clearances", run_show);
  add_folder_command(*group, context, "check", "Reports what is wrong with a case; exit code 1 if anything is",
                     run_check);
  add_snap(*group, context);
  add_picture(*group, context);
  add_surface_export(*group, context);
  add_mesh_command(*group, context);
  add_load_commands(*group, context);
}

} // namespace bregma::cli
