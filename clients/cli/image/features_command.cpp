// `bregma image features`: the images that measures compare besides the grey values.
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/intensity/features.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/image/comparison_picture.hpp"
#include "clients/cli/image/image_commands.hpp"
#include "clients/cli/image/image_input.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

using intensity::AigReading;
using intensity::Feature;

struct FeatureArguments {
  ImageFile image;
  std::string feature = "aig", reading = "distance-grey";
  std::string out, picture;
};

Feature feature_named(const std::string &name) {
  return name == "gradient"             ? Feature::kGradient
         : name == "significance"       ? Feature::kSignificance
         : name == "standard-deviation" ? Feature::kStandardDeviation
         : name == "corners"            ? Feature::kCorners
                                        : Feature::kAig;
}

AigReading reading_named(const std::string &name) {
  return name == "printed"          ? AigReading::kPrinted
         : name == "distance"       ? AigReading::kDistance
         : name == "distance-slope" ? AigReading::kDistanceTimesSlope
                                    : AigReading::kDistanceTimesGrey;
}

int show_feature(const FeatureArguments &arguments, const Context &context) {
  for (const auto &[option, path] : {std::pair("--out", arguments.out), std::pair("--picture", arguments.picture)}) {
    if (auto kept = check_output(option, path, {arguments.image.path}); !kept) {
      return fail(kept.error());
    }
  }
  if (auto named = check_picture("--picture", arguments.picture); !named) {
    return fail(named.error());
  }
  std::vector<std::string> notes;
  const auto image = read_image(arguments.image, notes);
  if (!image) {
    return fail(image.error());
  }
  if (auto sound = check_contrast(*image, arguments.image.path); !sound) {
    return fail(sound.error());
  }
  parallel::Team team(registration_threads());
  const intensity::Volume shown{
      static_cast<const image::Grid<3> &>(*image),
      intensity::feature_of(*image, feature_named(arguments.feature), reading_named(arguments.reading), team)};
  const intensity::GreyRange range = intensity::grey_range(shown.voxels);
  double zero = 0.0;
  for (const float v : shown.voxels) {
    zero += v == 0.0F ? 1.0 : 0.0;
  }
  const double fraction = zero / static_cast<double>(shown.voxels.size());
  if (context.json) {
    print_json({{"feature", arguments.feature},
                {"reading", arguments.feature == "aig" ? nlohmann::json(arguments.reading) : nlohmann::json(nullptr)},
                {"smallest", json_number(static_cast<double>(range.low))},
                {"largest", json_number(static_cast<double>(range.high))},
                {"zero_fraction", fraction},
                {"notes", notes}});
  } else {
    print_notes(notes);
    print(arguments.feature + ": from " + fixed(static_cast<double>(range.low), 3) + " to " +
          fixed(static_cast<double>(range.high), 3) + ", zero at " + fixed(100.0 * fraction, 1) + " % of the voxels\n");
  }
  if (!arguments.picture.empty()) {
    const Eigen::Vector3d last(image->size[0] - 1, image->size[1] - 1, image->size[2] - 1);
    if (auto written = write_slices_picture(arguments.picture, shown, nullptr, shown.point_mm(0.5 * last)); !written) {
      return fail(written.error());
    }
  }
  if (!arguments.out.empty()) {
    if (auto written = casefile::write_volume(arguments.out, shown); !written) {
      return fail(written.error());
    }
  }
  return kOk;
}

} // namespace

void add_image_features(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("features", "Shows a feature of an image, such as the adaptive image gradient");
  auto arguments = std::make_shared<FeatureArguments>();
  add_image_file(*command, arguments->image, "image", "The image");
  command->add_option("--feature", arguments->feature, "aig, significance, gradient, standard-deviation or corners")
      ->check(CLI::IsMember({"aig", "significance", "gradient", "standard-deviation", "corners"}))
      ->capture_default_str();
  command
      ->add_option("--reading", arguments->reading,
                   "Of the adaptive image gradient: printed, distance, distance-slope or distance-grey")
      ->check(CLI::IsMember({"printed", "distance", "distance-slope", "distance-grey"}))
      ->capture_default_str();
  command->add_option("--out", arguments->out, "Write the feature as an image: .nii, .nii.gz, .nrrd, .mha");
  command->add_option("--picture", arguments->picture, "Write three slices of it (PNG)");
  add_json_flag(*command, context);
  command->footer("Examples:\n  bregma image features mr.nii.gz --picture aig.png\n"
                  "  bregma image features mr.nii.gz --feature significance --out significance.nii.gz");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return show_feature(*arguments, context); }; });
}

} // namespace bregma::cli
