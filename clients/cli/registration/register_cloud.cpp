// `bregma register cloud`: two clouds without known correspondences, by coherent point drift.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <thread>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <Eigen/LU>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/geometry/rigid3.hpp"
#include "algorithms/registration/clouds/cloud_covariance.hpp"
#include "algorithms/registration/clouds/cloud_pose.hpp"
#include "base/write_file.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/registration/cloud_file.hpp"
#include "clients/cli/registration/register_commands.hpp"
#include "clients/cli/registration/registration_output.hpp"

namespace bregma::cli {

namespace {

using geometry::Points3;
using nlohmann::json;
using registration::CpdModel;
using registration::CpdResult;

// Maximal number of points of similarity and affine fits, and of the pose search before them.
constexpr std::size_t kMaxPoints = 4000;
// Natural logarithm of the odds against the second-best pose, 1,000 to 1. Below it that pose is reported as nearly as
// likely.
constexpr double kMinLogOdds = 7.0;

struct CloudArguments {
  RegistrationFiles files;
  bool affine = false;
  bool scale = false;
  bool any_size = false;
  double outliers = 0.1;
  std::string correspondences; // a .csv to write
  std::string targets;         // a file of points in target coordinates
};

Points3 columns(const std::vector<Eigen::Vector3d> &points) {
  Points3 out(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.col(static_cast<Eigen::Index>(i)) = points[i];
  }
  return out;
}

// Takes points at even steps of the index, because the order of a scan carries no information about its shape.
Points3 thinned(const Points3 &points) {
  const auto max_count = static_cast<Eigen::Index>(kMaxPoints);
  if (points.cols() <= max_count) {
    return points;
  }
  Points3 out(3, max_count);
  for (Eigen::Index i = 0; i < max_count; ++i) {
    out.col(i) = points.col(i * points.cols() / max_count);
  }
  return out;
}

struct Drift {
  CpdResult<3> result;
  double log_odds = 0.0; // the rigid pose against the second-best distinct one; infinite if there is only one
  double runner_up_turn_rad = 0.0;
  double time_ms = 0.0;
};

Drift register_clouds(const Points3 &source, const Points3 &target, const CloudArguments &arguments) {
  const auto before = std::chrono::steady_clock::now();
  registration::CloudPoseOptions options;
  options.outlier_weight = arguments.outliers;
  options.threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1U, 2U));
  registration::CloudPose pose = registration::find_cloud_pose(source, target, options);
  Drift out;
  out.log_odds = std::numeric_limits<double>::infinity();
  if (pose.best.has_estimate() && pose.runner_up.has_estimate()) {
    const auto compared = static_cast<double>(std::min<Eigen::Index>(options.middle_points, target.cols()));
    out.log_odds = compared * (pose.middle_log_likelihood - pose.runner_up.log_likelihood);
    const Eigen::Matrix3d turn = pose.best.rotation.transpose() * pose.runner_up.rotation;
    out.runner_up_turn_rad = geometry::rotation_log(Eigen::Quaterniond(turn)).norm();
  }
  out.result = std::move(pose.best);
  if (out.result.has_estimate() && (arguments.affine || arguments.scale)) {
    registration::CpdOptions drift;
    drift.model = arguments.affine ? CpdModel::kAffine : CpdModel::kSimilarity;
    drift.outlier_weight = arguments.outliers;
    drift.threads = options.threads;
    const registration::CpdTransform<3> start = out.result.transform;
    out.result = registration::register_cpd<3>(thinned(source), thinned(target), drift, &start);
  }
  out.time_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - before).count();
  return out;
}

Eigen::Matrix4d matrix_of(const registration::CpdTransform<3> &transform) {
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = transform.linear;
  out.topRightCorner<3, 1>() = transform.translation;
  return out;
}

int write_correspondences(const CloudArguments &arguments, const Points3 &source, const Points3 &target,
                          const CpdResult<3> &found) {
  const double constant = registration::outlier_constant<3>(target, found.sigma_mm, arguments.outliers, source.cols());
  const auto pairs =
      registration::correspondences<3>(found.transform * source, target, found.sigma_mm, constant).of_source;
  std::string out = "source,target,probability\n";
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    out +=
        std::to_string(i + 1) + "," + std::to_string(pairs[i].index + 1) + "," + fixed(pairs[i].probability, 6) + "\n";
  }
  const auto written = base::write_file(arguments.correspondences, out);
  return written ? static_cast<int>(kOk) : fail(written.error());
}

// Covariance of the rigid pose, if the points determine it.
std::optional<geometry::Matrix6d> covariance_of(const Points3 &source, const Points3 &target, double outliers,
                                                const CpdResult<3> &found) {
  const Points3 sources = thinned(source);
  const Points3 targets = thinned(target);
  const double constant = registration::outlier_constant<3>(targets, found.sigma_mm, outliers, sources.cols());
  auto covariance = registration::cloud_pose_covariance(found.transform * sources, targets, found.sigma_mm, constant);
  if (covariance) {
    // The pose was estimated from more target points, each of which carries the same information.
    const auto used = std::min<Eigen::Index>(registration::CloudPoseOptions{}.fine_points, target.cols());
    *covariance *= static_cast<double>(targets.cols()) / static_cast<double>(used);
  }
  return covariance;
}

json details_json(const Drift &drift) {
  const CpdResult<3> &r = drift.result;
  return {{"method", "coherent point drift"},
          {"iterations", r.iterations},
          {"scale", r.scale},
          {"sigma_mm", json_number(r.sigma_mm)},
          {"outlier_share", json_number(r.outlier_share)},
          {"log_odds", json_number(drift.log_odds)},
          {"runner_up_turn_rad", drift.runner_up_turn_rad},
          {"time_ms", drift.time_ms}};
}

int register_cloud(const CloudArguments &arguments, const Context &context) {
  for (const auto &[option, output] :
       {std::pair("--tfm", arguments.files.tfm), {"--correspondences", arguments.correspondences}}) {
    if (auto kept =
            check_output(option, output, {arguments.files.source.path, arguments.files.target.path, arguments.targets});
        !kept) {
      return fail(kept.error());
    }
  }
  const casefile::SizeLimits size = arguments.any_size ? casefile::kAnySize : casefile::kPointsSize;
  const auto source = read_cloud(arguments.files.source, size);
  if (!source) {
    return fail(source.error());
  }
  const auto target = read_cloud(arguments.files.target, size);
  if (!target) {
    return fail(target.error());
  }
  const auto points = read_targets(arguments.targets, arguments.files.target);
  if (!points) {
    return fail(points.error());
  }
  const Points3 sources = columns(source->points_mm);
  const Points3 targets = columns(target->points_mm);
  const Drift drift = register_clouds(sources, targets, arguments);
  const CpdResult<3> &r = drift.result;
  const std::vector<std::string> notes = joined({source->notes, target->notes, points->notes});
  if (!r.has_estimate()) {
    return refuse_registration("refused",
                               std::string(registration::name(r.outcome)) + " (" + std::to_string(sources.cols()) +
                                   " and " + std::to_string(targets.cols()) + " points)",
                               context, details_json(drift));
  }
  if (r.outcome == registration::CpdOutcome::kNotConverged) {
    return refuse_registration("refused",
                               "the estimate did not converge in " + std::to_string(r.iterations) + " iterations",
                               context, details_json(drift));
  }
  if (drift.log_odds < kMinLogOdds) {
    return refuse_registration("ambiguous",
                               "a pose that is turned by " +
                                   fixed(drift.runner_up_turn_rad / geometry::kRadiansPerDegree, 0) +
                                   " degrees explains the points nearly as well",
                               context, details_json(drift));
  }
  const Eigen::Matrix4d T = matrix_of(r.transform);
  const bool rigid = !arguments.affine && !arguments.scale;
  const auto covariance = rigid ? covariance_of(sources, targets, arguments.outliers, r) : std::nullopt;
  if (rigid && !covariance) {
    return refuse_registration("ambiguous", "the points do not determine the pose: they can slide on each other",
                               context, details_json(drift));
  }
  const auto errors = covariance ? errors_at(points->points, *covariance) : std::vector<PointError>();
  if (context.json) {
    json out = transforms_json(T, arguments.files);
    if (covariance) {
      add_covariance(out, *covariance);
      out["targets"] = errors_json(errors);
    }
    out.update(details_json(drift));
    out.update({{"accepted", true}, {"verdict", "found"}, {"reason", ""}, {"notes", notes}});
    print_json(out);
  } else {
    print_notes(notes);
    print(transforms_text(T) + "\n" + std::to_string(sources.cols()) + " points onto " +
          std::to_string(targets.cols()) + ", " + fixed(100.0 * r.outlier_share, 1) +
          " % of these treated as outliers; the rest is " + fixed(r.sigma_mm, 3, "mm") + " per coordinate, scale " +
          fixed(r.scale, 6) + "\n" + errors_text(errors) + "Registered in " + fixed(drift.time_ms, 0, "ms") + "\n");
  }
  if (!arguments.correspondences.empty()) {
    if (const int code = write_correspondences(arguments, sources, targets, r); code != kOk) {
      return code;
    }
  }
  return write_tfm(arguments.files, T);
}

} // namespace

void add_register_cloud(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("cloud", "Registers two clouds whose points are not paired");
  auto arguments = std::make_shared<CloudArguments>();
  add_registration_files(*command, arguments->files, "source",
                         "Points to map: .csv (x,y,z), .mrk.json, .fcsv, or a mesh, whose vertices are taken", "target",
                         "Points of the same object, complete or nearly");
  auto *affine = command->add_flag("--affine", arguments->affine, "Estimate shear and scale as well");
  command->add_flag("--scale", arguments->scale, "Estimate one scale as well")->excludes(affine);
  command->add_option("--outliers", arguments->outliers, "Fraction of the target's points without a source point")
      ->check(CLI::Range(0.0, 0.95))
      ->capture_default_str();
  command
      ->add_option("--targets", arguments->targets,
                   "Points in the target's coordinates to predict the TRE at, of a rigid pose")
      ->excludes(affine)
      ->excludes("--scale");
  command->add_flag("--any-size", arguments->any_size, "Skip the check of the clouds' size");
  command->add_option("--correspondences", arguments->correspondences,
                      "Writes the most probable correspondence of each source point (.csv; counted from 1, 0: none)");
  add_json_flag(*command, context);
  command->footer(
      "Coherent point drift, started from many rotations. If a second pose explains the points as well, the answer is\n"
      "ambiguous (exit code 1). For traced skin on a head use surface, which allows for a partial trace.\n\n"
      "Examples:\n"
      "  bregma register cloud markers_ct.csv markers_mr.csv --correspondences pairs.csv\n"
      "  bregma register cloud scan.ply bone.stl --scale --json");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return register_cloud(*arguments, context); }; });
}

} // namespace bregma::cli
