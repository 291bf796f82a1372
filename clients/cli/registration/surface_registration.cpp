#include "clients/cli/registration/surface_registration.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <thread>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/surface/beam_errors.hpp"
#include "algorithms/registration/surface/global_surface.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "casefile/itk_transform.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/registration/registration_output.hpp"

namespace bregma::cli {

namespace {

using Eigen::Vector3d;
using nlohmann::json;
using registration::GlobalResult;
using registration::LocalFit;
using registration::PairedPose;
using registration::Verdict;

// A fit from a given start is accepted only if most samples lie on the surface within the stated error.
constexpr double kMinInlierFraction = 0.7;
constexpr double kMaxScale = 2.5;

using Clock = std::chrono::steady_clock;
double since_ms(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

// Result of both methods.
struct Answer {
  Verdict verdict = Verdict::kRefused;
  std::string reason; // with advice; empty if a pose was found
  PairedPose T_target_source;
  geometry::Matrix6d covariance = geometry::Matrix6d::Zero();
  double rms_mm = 0.0; // distance of the inliers from the surface
  int inliers = 0, count = 0;
  double scale = 0.0; // ratio of the residuals to the stated error
  double prepare_ms = 0.0, time_ms = 0.0;
  json details; // specific to the method
  std::string details_text;
};

const char *name_of(Verdict verdict) {
  return verdict == Verdict::kFound ? "found" : verdict == Verdict::kAmbiguous ? "ambiguous" : "refused";
}

// RMS distance between the samples under two poses, mm.
double apart_mm(const PairedPose &a, const PairedPose &b, const std::vector<Vector3d> &samples) {
  double squares = 0.0;
  for (const Vector3d &p : samples) {
    squares += (a * p - b * p).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(samples.size()));
}

Answer globally(const surface::SurfaceField &field, const std::vector<Vector3d> &samples,
                const SurfaceArguments &arguments) {
  registration::GlobalOptions options;
  options.sigma_mm = arguments.sigma_mm;
  options.outliers = arguments.outliers;
  options.threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1U, 2U));
  registration::GlobalRegistration search(field, options);
  const auto start = Clock::now();
  const GlobalResult &found = search.locate(samples);
  Answer out;
  out.time_ms = since_ms(start);
  out.verdict = found.verdict;
  if (found.verdict != Verdict::kFound) {
    // The description begins with the verdict, which refuse() adds as well.
    const std::string words = registration::describe(found);
    const std::string verdict = std::string(name_of(found.verdict)) + ": ";
    out.reason = words.starts_with(verdict) ? words.substr(verdict.size()) : words;
  }
  out.T_target_source = found.T_target_source;
  out.covariance = found.covariance;
  out.count = found.count;
  out.scale = found.scale;
  json hypotheses = json::array();
  Table table({"Pose", "Probability", "RMS mm", "Inliers", "From the first deg", "mm"});
  for (std::size_t i = 0; i < found.hypothesis_count; ++i) {
    const registration::PoseHypothesis &h = found.hypotheses[i];
    const PairedPose &first = found.hypotheses[0].T_target_source;
    const double turn_rad = geometry::angle_between(first.rotation(), h.T_target_source.rotation());
    const double apart = apart_mm(first, h.T_target_source, samples);
    hypotheses.push_back({{"T_target_source", json_matrix(h.T_target_source.matrix())},
                          {"probability", json_number(h.probability)},
                          {"log_likelihood", json_number(h.log_likelihood)},
                          {"rms_mm", json_number(h.rms_mm)},
                          {"inliers", h.inliers},
                          {"from_first_rad", turn_rad},
                          {"from_first_mm", json_number(apart)}});
    table.row({std::to_string(i + 1), fixed(h.probability, 4), fixed(h.rms_mm, 2), std::to_string(h.inliers),
               fixed(turn_rad / geometry::kRadiansPerDegree, 1), fixed(apart, 1)});
  }
  if (found.hypothesis_count > 0) {
    out.rms_mm = found.hypotheses[0].rms_mm;
    out.inliers = found.hypotheses[0].inliers;
    out.details_text = "\nPoses that were compared\n" + table.text();
  }
  out.details = {{"method", "global"},
                 {"hypotheses", std::move(hypotheses)},
                 {"log_odds", json_number(found.log_odds)},
                 {"shape_log_odds", json_number(found.shape_log_odds)},
                 {"uncertainty_mm", json_number(found.uncertainty_mm)},
                 {"dilution", json_number(found.dilution)},
                 {"touch_next_mm", json_vector(found.touch_mm)}};
  return out;
}

Answer locally(const surface::SurfaceField &field, const std::vector<Vector3d> &samples, const PairedPose &from,
               const SurfaceArguments &arguments) {
  registration::LocalOptions options;
  options.sigma_mm = arguments.sigma_mm;
  registration::LocalRegistration local(field, options, samples.size());
  const auto start = Clock::now();
  const LocalFit &fit = local.fit(samples, from);
  Answer out;
  out.time_ms = since_ms(start);
  out.T_target_source = fit.T_target_source;
  out.covariance = fit.covariance;
  out.rms_mm = fit.rms_mm;
  out.inliers = fit.inliers;
  out.count = fit.count;
  out.scale = fit.scale;
  out.verdict = Verdict::kFound;
  const auto say = [&out](Verdict verdict, std::string reason) {
    out.verdict = verdict;
    out.reason = std::move(reason);
  };
  if (!fit.converged) {
    say(Verdict::kRefused, fit.count < 6 ? "6 samples are needed, " + std::to_string(fit.count) + " are there"
                                         : "the estimate did not converge from this start: leave --start out");
  } else if (fit.inliers < kMinInlierFraction * fit.count) {
    say(Verdict::kRefused, "only " + std::to_string(fit.inliers) + " of " + std::to_string(fit.count) +
                               " samples lie on the surface: the start is too far off (leave --start out), or this is "
                               "not the surface");
  } else if (fit.scale > kMaxScale) {
    say(Verdict::kRefused, "the residuals are " + fixed(fit.scale, 1) + " times as large as stated (--sigma-mm " +
                               fixed(arguments.sigma_mm, 2) + ")");
  } else {
    double squares = 0.0;
    for (const Vector3d &p : samples) {
      squares += uncertainty::tre_covariance(fit.covariance, fit.T_target_source * p).trace();
    }
    const double uncertainty_mm = std::sqrt(squares / static_cast<double>(samples.size()));
    if (!(uncertainty_mm <= registration::GlobalOptions().max_uncertainty_mm)) {
      say(Verdict::kAmbiguous, "the samples can slide or turn along the surface: touch features (nose, brows, ears)");
    }
  }
  out.details = {
      {"method", "local"}, {"iterations", fit.iterations}, {"effective_samples", json_number(fit.effective)}};
  out.details_text = "\nFrom the given start; other poses were not searched\n";
  return out;
}

void refine(Answer &answer, const surface::SurfaceField &field, const std::vector<Vector3d> &samples,
            const SurfaceArguments &arguments, const ScanningBeam &beam) {
  registration::BeamErrorOptions options;
  options.sigma_mm = arguments.sigma_mm;
  options.offset_sigma_mm = beam.offset_sigma_mm;
  options.excess_sigma_mm = beam.excess_sigma_mm;
  const auto start = Clock::now();
  const registration::BeamErrorFit fit =
      registration::fit_beam_errors(field, samples, beam.towards_sensor, answer.T_target_source, options);
  answer.time_ms += since_ms(start);
  answer.details["excess_mm"] = fit.converged ? json_number(fit.excess_mm) : json();
  answer.details["excess_sigma_mm"] = fit.converged ? json_number(fit.excess_sigma_mm) : json();
  if (!fit.converged) {
    answer.verdict = Verdict::kRefused;
    answer.reason = "the pose and the sensor's errors do not settle together: too few points on skin that faces it";
    return;
  }
  answer.T_target_source = fit.T_target_source;
  answer.covariance = fit.covariance;
  answer.inliers = fit.inliers;
  answer.rms_mm = fit.rms_mm;
  if (beam.excess_sigma_mm > 0.0) {
    answer.details_text += "\nOn tilted skin the sensor reads too far by " + fixed(fit.excess_mm, 1, "mm") +
                           " (1 sigma " + fixed(fit.excess_sigma_mm, 1) + ") times 1 - cos(tilt): removed\n";
  }
}

json to_json(const Answer &answer, const surface::SurfaceField &field, const std::vector<Vector3d> &samples,
             const SurfaceArguments &arguments, const std::vector<PointError> &errors) {
  json out = transforms_json(answer.T_target_source.matrix(), arguments.files);
  add_covariance(out, answer.covariance);
  out["residuals_mm"] = json::array(); // all samples in input order, negative inside
  for (const Vector3d &p : samples) {
    out["residuals_mm"].push_back(json_number(field.closest(answer.T_target_source * p).signed_mm));
  }
  out["targets"] = errors_json(errors);
  return out;
}

// Fields that are valid for every verdict.
json common_json(const Answer &answer, const SurfaceArguments &arguments) {
  json out = answer.details;
  out.update({{"accepted", answer.verdict == Verdict::kFound},
              {"verdict", name_of(answer.verdict)},
              {"reason", answer.reason},
              {"samples", answer.count},
              {"inliers", answer.inliers},
              {"rms_mm", json_number(answer.rms_mm)},
              {"scale", json_number(answer.scale)},
              {"sigma_mm", arguments.sigma_mm},
              {"prepare_ms", answer.prepare_ms},
              {"time_ms", answer.time_ms}});
  return out;
}

std::string to_text(const Answer &answer, const std::vector<PointError> &errors) {
  return transforms_text(answer.T_target_source.matrix()) + "\n" + std::to_string(answer.inliers) + " of " +
         std::to_string(answer.count) + " samples within three sigma of the surface, RMS " +
         fixed(answer.rms_mm, 2, "mm") + ": a figure of consistency, not of accuracy\n" + "Surface prepared in " +
         fixed(answer.prepare_ms, 0, "ms") + ", registered in " + fixed(answer.time_ms, 1, "ms") + "\n" +
         answer.details_text + errors_text(errors);
}

} // namespace

void add_surface_options(CLI::App &command, SurfaceArguments &arguments) {
  command.add_option("--start", arguments.start,
                     "A .tfm near the pose: only this pose is refined, no other is searched");
  command.add_option("--sigma-mm", arguments.sigma_mm, "Error of a sample along the surface's normal, 1 sigma")
      ->check(CLI::Range(0.01, 20.0))
      ->capture_default_str();
  command.add_option("--outliers", arguments.outliers, "Fraction of the samples that may be off the surface")
      ->check(CLI::Range(0.0, 0.5))
      ->capture_default_str();
  command.add_option("--targets", arguments.targets, "Points in the surface's coordinates to predict the TRE at");
}

base::Result<SurfaceInput> read_surface_input(const SurfaceArguments &arguments) {
  SurfaceInput out;
  if (!arguments.start.empty()) {
    const auto read = casefile::read_itk_rigid(arguments.start);
    if (!read) {
      return tl::unexpected(read.error());
    }
    out.start = *read;
  }
  auto targets = read_targets(arguments.targets, arguments.files.target);
  if (!targets) {
    return tl::unexpected(targets.error());
  }
  out.targets = std::move(targets->points);
  auto surface = read_surface_or_image(arguments.files.target);
  if (!surface) {
    return tl::unexpected(surface.error());
  }
  out.surface = std::move(surface->mesh);
  out.notes = joined({targets->notes, surface->notes});
  return out;
}

int register_samples(const SurfaceArguments &arguments, const Cloud &samples, const SurfaceInput &input,
                     const std::optional<ScanningBeam> &beam, json document, const Context &context) {
  const auto before = Clock::now();
  const surface::SurfaceModel model(input.surface);
  const surface::SurfaceField field(model);
  const double prepare_ms = since_ms(before);
  Answer answer = input.start ? locally(field, samples.points_mm, *input.start, arguments)
                              : globally(field, samples.points_mm, arguments);
  answer.prepare_ms = prepare_ms;
  if (beam && answer.verdict == Verdict::kFound) {
    refine(answer, field, samples.points_mm, arguments, *beam);
  }
  document.update(common_json(answer, arguments));
  const std::vector<std::string> notes = joined({samples.notes, input.notes});
  document["notes"] = notes;
  if (!context.json) {
    print_notes(notes);
  }
  if (answer.verdict != Verdict::kFound) {
    if (!context.json) {
      print(answer.details_text);
    }
    return refuse_registration(name_of(answer.verdict), answer.reason, context, std::move(document));
  }
  const auto errors = errors_at(input.targets, answer.covariance);
  if (context.json) {
    document.update(to_json(answer, field, samples.points_mm, arguments, errors));
    print_json(document);
  } else {
    print(to_text(answer, errors));
  }
  return write_tfm(arguments.files, answer.T_target_source.matrix());
}

} // namespace bregma::cli
