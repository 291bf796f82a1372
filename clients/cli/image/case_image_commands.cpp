// `bregma image add | list | remove`: registered images of a case.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <system_error>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>

#include "casefile/itk_transform.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/image/image_commands.hpp"
#include "clients/cli/image/image_input.hpp"
#include "clients/cli/image/second_image.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"

namespace bregma::cli {

namespace {

using casefile::Case;
using casefile::RegisteredImage;
using nlohmann::json;

constexpr const char *kLoadAgain = "A daemon that has the case loaded uses the change after `bregma case load`.\n";

struct AddArguments {
  std::string folder, result, transform;
  ImageFile image;
  SecondImage second;
  std::vector<std::string> structures;
  double error_mm = 0.0;
  bool replace = false;
};

// The result of a registration, or a transform with an error that a person states.
base::Result<casefile::ImageRegistration> stated_registration(const AddArguments &arguments,
                                                              const intensity::Volume &volume) {
  if (!arguments.result.empty()) {
    return casefile::read_image_registration(arguments.result);
  }
  const auto T = casefile::read_itk_rigid(arguments.transform);
  if (!T) {
    return tl::unexpected(T.error());
  }
  const auto loaded = load_case(arguments.folder, casefile::Checksums::kIgnore);
  if (!loaded) {
    return tl::unexpected(loaded.error());
  }
  const auto planning = casefile::read_volume(loaded->image);
  if (!planning) {
    return tl::unexpected(planning.error());
  }
  casefile::ImageRegistration out;
  out.T_image_source.pose = T->as<geometry::frame::Image, geometry::frame::Source>();
  // The same at every point of the head.
  out.T_image_source.covariance.bottomRightCorner<3, 3>() =
      Eigen::Matrix3d::Identity() * arguments.error_mm * arguments.error_mm / 3.0;
  out.verdict = "unknown";
  out.source = casefile::identity_of(volume);
  out.target = casefile::identity_of(*planning);
  return out;
}

int add(AddArguments arguments, const Context &context) {
  if (arguments.result.empty() == arguments.transform.empty()) {
    return fail("give either --result, of bregma image register, or --transform, of another program");
  }
  if (!arguments.transform.empty() && (arguments.second.accepted.empty() || !(arguments.error_mm > 0.0))) {
    return fail("--transform states neither error nor verdict: --error-mm states the error (RMS), and --accept why the "
                "transform is used, in words");
  }
  std::vector<std::string> notes;
  const auto volume = read_image(arguments.image, notes);
  if (!volume) {
    return fail(volume.error());
  }
  const auto registration = stated_registration(arguments, *volume);
  if (!registration) {
    return fail(registration.error());
  }
  arguments.second.source = arguments.image.path;
  arguments.second.space = space_of(arguments.image);
  for (const std::string &text : arguments.structures) {
    auto request = casefile::parse_structure(text);
    if (!request) {
      return fail(request.error());
    }
    arguments.second.segmentation.structures.push_back(std::move(*request));
  }
  const auto done = add_to_case(arguments.folder, arguments.second, *volume, *registration, arguments.replace, notes);
  if (!done) {
    return fail(done.error());
  }
  const RegisteredImage &image = *done->registered_image(arguments.second.name);
  if (context.json) {
    json document = image_json(*done, image);
    document["notes"] = notes;
    print_json(document);
  } else {
    print_notes(notes);
    print(image_text(*done, image) + kLoadAgain);
  }
  return kOk;
}

int list(const std::string &folder, const Context &context) {
  const auto loaded = load_case(folder, casefile::Checksums::kIgnore);
  if (!loaded) {
    return fail(loaded.error());
  }
  if (context.json) {
    json out = json::array();
    for (const RegisteredImage &image : loaded->images) {
      out.push_back(image_json(*loaded, image));
    }
    print_json(out);
    return kOk;
  }
  print("Planning image: " + loaded->image.string() + "\n");
  for (const RegisteredImage &image : loaded->images) {
    print(image_text(*loaded, image));
  }
  if (loaded->images.empty()) {
    print("no other image is registered to it\n");
  }
  return kOk;
}

struct RemoveArguments {
  std::string folder, name;
  bool with_plans = false;
};

// What goes with an image: what was placed or made in it, and what cannot be without that.
std::vector<std::string> depending_on(const Case &c, const std::string &image) {
  std::vector<std::string> out = placed_in(c, image);
  const bool without_brain = c.brain.segmented_in == image;
  for (const casefile::NamedPoint &point : c.brain_landmarks) {
    if (without_brain && point.placed_in != image) {
      out.push_back("brain landmark " + point.name);
    }
  }
  if (c.craniotomy) {
    const casefile::Trajectory *path = c.trajectory(c.craniotomy->trajectory);
    if (without_brain || (path != nullptr && (path->entry_in == image || path->target_in == image))) {
      out.emplace_back("the planned craniotomy");
    }
  }
  return out;
}

void erase_image(Case &c, const std::string &name) {
  const auto placed = [&name](const casefile::NamedPoint &point) { return point.placed_in == name; };
  for (auto *points : {&c.landmarks, &c.brain_landmarks, &c.targets}) {
    std::erase_if(*points, placed);
  }
  std::erase_if(c.trajectories,
                [&name](const casefile::Trajectory &line) { return line.entry_in == name || line.target_in == name; });
  std::erase_if(c.structures, [&name](const casefile::Surface &structure) { return structure.segmented_in == name; });
  if (c.brain.segmented_in == name) { // without a brain there is no tissue model
    c.brain = {};
    c.brain_landmarks.clear();
    c.craniotomy.reset();
  }
  if (c.craniotomy && !c.craniotomy->trajectory.empty() && c.trajectory(c.craniotomy->trajectory) == nullptr) {
    c.craniotomy.reset();
  }
  std::erase_if(c.images, [&name](const RegisteredImage &image) { return image.name == name; });
}

int remove(const RemoveArguments &arguments, const Context &context) {
  auto loaded = load_case(arguments.folder, casefile::Checksums::kIgnore);
  if (!loaded) {
    return fail(loaded.error());
  }
  const RegisteredImage *image = loaded->registered_image(arguments.name);
  if (image == nullptr) {
    return fail(arguments.folder + ": the case has no image \"" + arguments.name + "\"; bregma image list names them");
  }
  const std::vector<std::string> removed = depending_on(*loaded, arguments.name);
  if (!arguments.with_plans && !removed.empty()) {
    std::string names;
    for (const std::string &item : removed) {
      names += (names.empty() ? "" : ", ") + item;
    }
    return fail(arguments.folder + ": placed or made in image \"" + arguments.name + "\": " + names +
                "; --with-plans removes them too");
  }
  const std::filesystem::path file = image->file;
  erase_image(*loaded, arguments.name);
  if (auto sound = check_case(*loaded); !sound) {
    return fail(sound.error());
  }
  if (auto saved = save_case(*loaded); !saved) {
    return fail(saved.error());
  }
  std::error_code ignored;
  std::filesystem::remove(file, ignored);
  if (context.json) {
    print_json({{"removed", arguments.name}, {"removed_with_it", removed}});
  } else {
    std::string text = printable(arguments.name) + " is no longer part of the case\n";
    for (const std::string &item : removed) {
      text += "  removed with it: " + printable(item) + "\n";
    }
    print(text + kLoadAgain);
  }
  return kOk;
}

} // namespace

void add_second_image_options(CLI::App &command, SecondImage &image) {
  command.add_option("--targets", image.plans.targets, "Slicer markups: targets placed in this image");
  command.add_option("--trajectories", image.plans.trajectories, "Slicer markups: lines placed in this image");
  command.add_option("--landmarks", image.plans.landmarks, "Slicer markups: landmarks placed in this image");
  command.add_option("--brain-landmarks", image.plans.brain_landmarks, "Slicer markups: points in the brain");
}

void add_image_add(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("add", "Puts a registered image into a case");
  auto arguments = std::make_shared<AddArguments>();
  command->add_option("case", arguments->folder, "Case folder")->required();
  add_image_file(*command, arguments->image, "image", "The image that was registered to the case's image");
  command->add_option("--name", arguments->second.name, "Name of the image in the case")->required();
  command->add_option("--result", arguments->result, "Result of bregma image register: transform and covariance");
  command->add_option("--transform", arguments->transform, "A rigid .tfm of another program instead");
  command->add_option("--error-mm", arguments->error_mm, "With --transform: its error, RMS, at every point")
      ->check(CLI::Range(0.01, 10.0));
  command->add_option("--accept", arguments->second.accepted,
                      "Why a registration is used that is not \"found\", in words");
  add_second_image_options(*command, arguments->second);
  casefile::Segmentation &segmentation = arguments->second.segmentation;
  command->add_option("--labels", segmentation.labels, "Regions: a label image drawn on this image");
  command->add_option("--label-names", segmentation.label_names,
                      "Names of the regions, as of bregma case create (default: next to the labels, .txt)");
  command->add_option("--structure", arguments->structures,
                      "With --labels: critical structure, \"Region\" or \"Name=Region,Region\"; any number of them");
  command->add_flag("--replace", arguments->replace, "Replace the image of this name; its points move with it");
  add_json_flag(*command, context);
  command->footer("Examples:\n  bregma image register t2.nii.gz colin27/image.nii.gz --result t2.json\n"
                  "  bregma image add colin27 t2.nii.gz --result t2.json --name T2 --targets on_t2.mrk.json\n"
                  "  bregma image add colin27 t2.nii.gz --result t2.json --name T2 --labels vessels.nii.gz --structure "
                  "\"Vessel=1\"");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return add(*arguments, context); }; });
}

void add_image_list(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("list", "The images of a case, with the errors of their registrations");
  auto folder = std::make_shared<std::string>();
  command->add_option("case", *folder, "Case folder")->required();
  add_json_flag(*command, context);
  command->callback([folder, &context] { context.run = [folder, &context] { return list(*folder, context); }; });
}

void add_image_remove(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("remove", "Removes a registered image from a case");
  auto arguments = std::make_shared<RemoveArguments>();
  command->add_option("case", arguments->folder, "Case folder")->required();
  command->add_option("name", arguments->name, "Name of the image")->required();
  command->add_flag("--with-plans", arguments->with_plans, "Also remove the points and surfaces that were made in it");
  add_json_flag(*command, context);
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return remove(*arguments, context); }; });
}

} // namespace bregma::cli
