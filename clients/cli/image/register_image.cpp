// `bregma image register`: registers an image to another one by their grey values.
#include <array>
#include <chrono>
#include <cmath>
#include <ctime>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <Eigen/LU>

#include "algorithms/intensity/rigid_image.hpp"
#include "algorithms/intensity/warp.hpp"
#include "base/write_file.hpp"
#include "casefile/image_registration.hpp"
#include "casefile/itk_transform.hpp"
#include "casefile/volumes/volume.hpp"
#include "clients/cli/case/progress_line.hpp"
#include "clients/cli/image/comparison_picture.hpp"
#include "clients/cli/image/image_commands.hpp"
#include "clients/cli/image/image_input.hpp"
#include "clients/cli/image/nonrigid_parts.hpp"
#include "clients/cli/image/second_image.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/registration/registration_output.hpp"

namespace bregma::cli {

namespace {

using intensity::ImageVerdict;
using intensity::NonrigidImageResult;
using intensity::RigidImageResult;
using intensity::Volume;
using nlohmann::json;

struct RegisterImageArguments {
  ImageFile source, target;
  std::string measure = "nmi", start = "search", optimiser = "gradient";
  std::string initial, targets, tfm, resampled, picture, result, into, name;
  std::string fixed_mask, moving_mask;
  int bins = 64;
  double finest_mm = 2.0;
  bool affine = false;
  NonrigidArguments nonrigid;
};

base::Result<void> check_outputs(const RegisterImageArguments &arguments) {
  const std::vector<std::string> inputs{arguments.source.path, arguments.target.path, arguments.initial,
                                        arguments.targets,     arguments.fixed_mask,  arguments.moving_mask};
  if (arguments.into.empty() != arguments.name.empty()) {
    return base::failure("--into names a case, and --name the image in it: give both or none");
  }
  if ((arguments.affine || arguments.nonrigid.wanted) && !(arguments.into.empty() && arguments.result.empty())) {
    return base::failure("--into, --result: an image of a case has the shape of the head, so that its registration is "
                         "rigid; leave out --affine and --nonrigid");
  }
  for (const auto &[option, path] :
       {std::pair("--tfm", arguments.tfm), std::pair("--resampled", arguments.resampled),
        std::pair("--picture", arguments.picture), std::pair("--field", arguments.nonrigid.field),
        std::pair("--result", arguments.result)}) {
    if (auto kept = check_output(option, path, inputs); !kept) {
      return kept;
    }
  }
  return check_picture("--picture", arguments.picture);
}

// Where errors are predicted without --targets: at the centre of the target image and 60 mm from it along the axes.
std::vector<casefile::NamedPoint> default_points(const Volume &target) {
  const Eigen::Vector3d last(target.size[0] - 1, target.size[1] - 1, target.size[2] - 1);
  const Eigen::Vector3d centre = target.point_mm(0.5 * last);
  constexpr double kAway_mm = 60.0;
  std::vector<casefile::NamedPoint> out{{"centre", centre}};
  const std::array<std::string, 3> names{"60 mm right", "60 mm anterior", "60 mm superior"};
  for (std::size_t d = 0; d < 3; ++d) {
    out.push_back({names[d], centre + kAway_mm * Eigen::Vector3d::Unit(static_cast<Eigen::Index>(d))});
  }
  return out;
}

json common_json(const RigidImageResult &result, const RegisterImageArguments &arguments, double time_ms) {
  json candidates = json::array();
  for (const intensity::ImageCandidate &candidate : result.candidates) {
    candidates.push_back({{"T_target_source", json_matrix(candidate.T_reference_floating.matrix())},
                          {"similarity_at_4_mm", json_number(candidate.similarity)}});
  }
  return {{"accepted", result.verdict == ImageVerdict::kFound},
          {"verdict", std::string(intensity::name_of(result.verdict))},
          {"reason", result.reason},
          {"measure", arguments.measure},
          {"bins", arguments.bins},
          {"start", arguments.start},
          {"similarity", json_number(result.similarity)},
          {"mutual_information_nats", json_number(result.mutual_information)},
          {"overlap", json_number(result.overlap)},
          {"lead", json_number(result.lead)},
          {"mirror_lead", json_number(result.mirror_lead)},
          {"stretch", json_number(result.stretch)},
          {"stretch_gain", json_number(result.stretch_gain)},
          {"restarts", result.restarts},
          {"restarts_returned", result.returned},
          {"evaluations", result.evaluations},
          {"candidates", std::move(candidates)},
          {"time_ms", time_ms}};
}

std::string summary_text(const RigidImageResult &result, const RegisterImageArguments &arguments, double time_ms) {
  return "\n" + arguments.measure + " " + fixed(result.similarity, 4) + ", overlap " +
         fixed(100.0 * result.overlap, 0) + " % of the smaller image, " + std::to_string(result.returned) + " of " +
         std::to_string(result.restarts) + " perturbed restarts came back, lead over the next pose " +
         fixed(result.lead, 2) + ", over the mirror image " + fixed(result.mirror_lead, 2) +
         (arguments.affine ? std::string() : ", size of the head " + fixed(100.0 * (1.0 + result.stretch), 1) + " %") +
         "\n" + std::to_string(result.evaluations) + " comparisons in " + fixed(time_ms, 0, "ms") + "\n";
}

// From a point of the target to the source, mm.
using ToSource = std::function<Eigen::Vector3d(const Eigen::Vector3d &)>;
ToSource to_source(const Eigen::Matrix4d &T_target_source, const std::optional<NonrigidImageResult> &nonrigid) {
  const Eigen::Matrix4d back = T_target_source.inverse();
  if (nonrigid) {
    return [back, &field = nonrigid->field](const Eigen::Vector3d &p) -> Eigen::Vector3d {
      return (back * (p + field.displacement_mm(p)).homogeneous()).head<3>();
    };
  }
  return [back](const Eigen::Vector3d &p) -> Eigen::Vector3d { return (back * p.homogeneous()).head<3>(); };
}

// The source on the target's grid; outside of it, its darkest value.
std::vector<float> resampled(const Volume &target, const Volume &source, const ToSource &map, parallel::Team &team) {
  std::vector<float> out = intensity::warp<3>(target, source, source.voxels, map, team);
  const float dark = intensity::grey_range(source.voxels).low;
  for (float &v : out) {
    v = std::isfinite(v) ? v : dark;
  }
  return out;
}

base::Result<void> write_images(const RegisterImageArguments &arguments, const Volume &target, const Volume &source,
                                const ToSource &map, parallel::Team &team) {
  if (arguments.resampled.empty() && arguments.picture.empty()) {
    return {};
  }
  Volume moved{target, resampled(target, source, map, team)};
  if (!arguments.picture.empty()) {
    const Eigen::Vector3d last(target.size[0] - 1, target.size[1] - 1, target.size[2] - 1);
    if (auto written = write_slices_picture(arguments.picture, target, &moved.voxels, target.point_mm(0.5 * last));
        !written) {
      return written;
    }
  }
  return arguments.resampled.empty() ? base::Result<void>() : casefile::write_volume(arguments.resampled, moved);
}

base::Result<intensity::RigidImageOptions> options_of(const RegisterImageArguments &arguments) {
  intensity::RigidImageOptions options;
  options.measure = measure_named(arguments.measure);
  options.measure_options.bins = arguments.bins;
  options.measure_options.tail = kGreyTail;
  options.start = arguments.start == "header"    ? intensity::Start::kPose
                  : arguments.start == "centres" ? intensity::Start::kCentres
                                                 : intensity::Start::kSearch;
  options.optimiser = arguments.optimiser == "lines" ? intensity::Optimiser::kLines : intensity::Optimiser::kGradient;
  options.affine = arguments.affine;
  options.finest_mm = arguments.finest_mm;
  if (!arguments.initial.empty()) {
    const auto pose = casefile::read_itk_rigid(arguments.initial);
    if (!pose) {
      return tl::unexpected(pose.error());
    }
    options.T_reference_floating = *pose;
  }
  return options;
}

// Now, in ISO 8601, UTC.
std::string date_text() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc)};
}

casefile::ImageRegistration registration_of(const RigidImageResult &result, const RegisterImageArguments &arguments,
                                            const Volume &source, const Volume &target) {
  casefile::ImageRegistration out;
  out.T_image_source = {result.T_reference_floating.as<geometry::frame::Image, geometry::frame::Source>(),
                        result.covariance};
  out.measure = arguments.measure;
  out.verdict = intensity::name_of(result.verdict);
  out.date = date_text();
  out.source = casefile::identity_of(source);
  out.target = casefile::identity_of(target);
  return out;
}

// Writes the result, and puts the image into the case.
base::Result<std::string> keep(const casefile::ImageRegistration &registration, const json &document,
                               const RegisterImageArguments &arguments, const Volume &source,
                               std::vector<std::string> &notes) {
  if (!arguments.result.empty()) {
    if (auto written = base::write_file(arguments.result, json_text(document, 2) + "\n"); !written) {
      return tl::unexpected(written.error());
    }
  }
  if (arguments.into.empty()) {
    return std::string();
  }
  SecondImage image;
  image.source = arguments.source.path;
  image.name = arguments.name;
  return add_to_case(arguments.into, image, source, registration, false, notes).map([&](const casefile::Case &c) {
    return image_text(c, *c.registered_image(arguments.name));
  });
}

// The voxels that are compared.
base::Result<Volume> masked(const Volume &image, const std::string &mask, const std::string &path,
                            std::vector<std::string> &notes) {
  Volume out = image;
  leave_out_padding(out, path, notes);
  if (!mask.empty()) {
    if (auto applied = apply_mask(out, mask, path, notes); !applied) {
      return tl::unexpected(applied.error());
    }
  }
  return out;
}

int register_image(const RegisterImageArguments &arguments, const Context &context) {
  if (auto kept = check_outputs(arguments); !kept) {
    return fail(kept.error());
  }
  auto options = options_of(arguments);
  if (!options) {
    return fail(options.error());
  }
  RegistrationFiles files; // for the common output
  files.source.path = arguments.source.path;
  files.target.path = arguments.target.path;
  files.target.space = arguments.target.space;
  files.tfm = arguments.tfm;
  const auto targets = read_targets(arguments.targets, files.target);
  if (!targets) {
    return fail(targets.error());
  }
  std::vector<std::string> notes = targets->notes;
  const auto source = read_image(arguments.source, notes);
  if (!source) {
    return fail(source.error());
  }
  const auto target = read_image(arguments.target, notes);
  if (!target) {
    return fail(target.error());
  }
  compare_patients(arguments.source, arguments.target, notes);
  const auto masked_source = masked(*source, arguments.moving_mask, arguments.source.path, notes);
  if (!masked_source) {
    return fail(masked_source.error());
  }
  const auto masked_target = masked(*target, arguments.fixed_mask, arguments.target.path, notes);
  if (!masked_target) {
    return fail(masked_target.error());
  }
  parallel::Team team(registration_threads());
  const auto began = std::chrono::steady_clock::now();
  RigidImageResult result;
  std::optional<NonrigidImageResult> nonrigid;
  {
    ProgressLine progress;
    options->progress = [&](double done, std::string_view stage) { return progress.show(done, stage); };
    result = intensity::register_rigid(*masked_target, *masked_source, *options, team);
    if (arguments.nonrigid.wanted && result.verdict == ImageVerdict::kFound) {
      nonrigid = deform(*masked_target, *masked_source, *options, arguments.nonrigid, result, team);
    }
  }
  const double time_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - began).count();
  if (result.verdict == ImageVerdict::kFound && result.mirror_lead < intensity::kSidesKnown) {
    notes.emplace_back("the mirror image fits as well: these images do not show whether left and right are exchanged");
  }
  json document = common_json(result, arguments, time_ms);
  document["notes"] = notes;
  if (!context.json) {
    print_notes(notes);
  }
  if (result.verdict != ImageVerdict::kFound) {
    return refuse_registration(std::string(intensity::name_of(result.verdict)), result.reason, context,
                               std::move(document));
  }
  if (nonrigid) {
    document["nonrigid"] = nonrigid_json(*nonrigid);
    if (!nonrigid->found) {
      return refuse_registration("refused", nonrigid->reason, context, std::move(document));
    }
  }
  const auto errors = errors_at(targets->points.empty() ? default_points(*target) : targets->points, result.covariance);
  document.update(transforms_json(result.affine, files));
  std::string added;
  if (!arguments.affine && !nonrigid) { // the covariance is that of the rigid pose only
    const auto registration = registration_of(result, arguments, *source, *target);
    add_covariance(document, result.covariance);
    document["targets"] = errors_json(errors);
    document["date"] = registration.date;
    document["source"] = identity_json(registration.source);
    document["target"] = identity_json(registration.target);
    const auto kept = keep(registration, document, arguments, *source, notes);
    if (!kept) {
      return fail(kept.error());
    }
    added = kept->empty() ? "" : "\n" + *kept;
  }
  if (context.json) {
    print_json(document);
  } else {
    print(transforms_text(result.affine) + summary_text(result, arguments, time_ms) +
          (nonrigid           ? nonrigid_text(*nonrigid)
           : arguments.affine ? std::string()
                              : errors_text(errors)) +
          added);
  }
  const ToSource map = to_source(result.affine, nonrigid);
  if (auto written = write_images(arguments, *target, *source, map, team); !written) {
    return fail(written.error());
  }
  if (!arguments.nonrigid.field.empty()) {
    if (auto written = write_field(arguments.nonrigid.field, *target, map); !written) {
      return fail(written.error());
    }
  }
  return write_tfm(files, result.affine);
}

} // namespace

void add_image_register(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("register", "Registers an image to another one of the same head");
  auto arguments = std::make_shared<RegisterImageArguments>();
  add_image_file(*command, arguments->source, "source", "The floating image");
  add_image_file(*command, arguments->target, "target", "The reference image");
  command->add_option("--measure", arguments->measure, "Similarity of the images")
      ->check(CLI::IsMember(measure_names()))
      ->capture_default_str();
  add_bins_option(*command, arguments->bins);
  command->add_option("--start", arguments->start, "Poses to start from: header, centres (of mass) or search (all)")
      ->check(CLI::IsMember({"header", "centres", "search"}))
      ->capture_default_str();
  command->add_option("--initial", arguments->initial, "A .tfm that replaces the pose of the headers");
  command->add_option("--optimiser", arguments->optimiser, "gradient (BFGS) or lines (Powell)")
      ->check(CLI::IsMember({"gradient", "lines"}))
      ->capture_default_str();
  command->add_option("--finest-mm", arguments->finest_mm, "Spacing of the finest level")
      ->check(CLI::Range(0.5, 4.0))
      ->capture_default_str();
  auto *affine = command->add_flag("--affine", arguments->affine, "Also scales and shears, from the rigid pose");
  add_nonrigid_options(*command, arguments->nonrigid, *affine);
  command->add_option("--fixed-mask", arguments->fixed_mask,
                      "Labels on the target's grid: voxels that are 0 there are not compared");
  command->add_option("--moving-mask", arguments->moving_mask,
                      "Labels on the source's grid: voxels that are 0 there are not compared");
  command->add_option("--targets", arguments->targets, "Points in the target's coordinates to predict the TRE at");
  command->add_option("--tfm", arguments->tfm, "Write the transform for ITK and Slicer");
  command->add_option("--result", arguments->result,
                      "Write the transform with its covariance and the identity of both images (JSON), for bregma "
                      "image add");
  command->add_option("--into", arguments->into,
                      "Case folder, whose image is the target: the source becomes part of it");
  command->add_option("--name", arguments->name, "With --into: name of the image in the case");
  command->add_option("--resampled", arguments->resampled,
                      "Write the source on the target's grid: .nii, .nii.gz, .nrrd, .mha");
  command->add_option("--picture", arguments->picture, "Write a checkerboard of both images (PNG)");
  add_json_flag(*command, context);
  command->footer(
      "The verdict is found, ambiguous or refused (exit code 1), with the reason. Only a pose that is found "
      "is\nprinted as a transform and written.\n\nExamples:\n"
      "  bregma image register mr.nii.gz ct.nii.gz --tfm mr_to_ct.tfm --picture check.png\n"
      "  bregma image register dicom_folder/ ct.nrrd --start header --targets lesion.mrk.json --json\n"
      "  bregma image register later_mr.nii.gz mr.nii.gz --nonrigid --field bent.nrrd --resampled later_on_mr.nii.gz\n"
      "  bregma image register t2.nii.gz colin27/image.nii.gz --into colin27 --name T2");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return register_image(*arguments, context); }; });
}

} // namespace bregma::cli
