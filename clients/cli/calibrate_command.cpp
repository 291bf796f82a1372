// `bregma calibrate pivot`: finds the position of a tool's tip, from a recording or live through the daemon.
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/calibration/pivot.hpp"
#include "algorithms/geometry/angles.hpp"
#include "algorithms/geometry/unknown.hpp"
#include "casefile/poses.hpp"
#include "clients/cli/calibrate_commands.hpp"
#include "clients/cli/command_reply.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

using calibration::PivotResult;
using nlohmann::json;

constexpr const char *kDefaultTransform = "StylusToReference";

struct PivotArguments {
  std::string source; // a recording; with --live: start or finish
  std::string transform = kDefaultTransform;
  double noise_mm = calibration::PivotOptions().tracker_noise_mm;
  std::string live_tool;
};

const char *verdict_name(calibration::PivotVerdict verdict) {
  switch (verdict) {
  case calibration::PivotVerdict::kAccepted:
    return "accepted";
  case calibration::PivotVerdict::kTooFewPoses:
    return "too_few_poses";
  case calibration::PivotVerdict::kStatic:
    return "static";
  case calibration::PivotVerdict::kTooLittleRotation:
    return "too_little_rotation";
  case calibration::PivotVerdict::kTooManyOutliers:
    return "too_many_outliers";
  case calibration::PivotVerdict::kResidualTooSmall:
    return "residual_too_small";
  case calibration::PivotVerdict::kTipImplausible:
    return "tip_implausible";
  case calibration::PivotVerdict::kResidualTooLarge:
    break;
  }
  return "residual_too_large";
}

// Of a refused calibration nothing that could be used: null.
json to_json(const PivotResult &r, const casefile::PoseSeries &series) {
  json out = {{"verdict", verdict_name(r.verdict)},
              {"accepted", r.accepted()},
              {"text", r.text},
              {"poses", r.poses},
              {"repeated_poses", r.repeated},
              {"invalid_frames", series.invalid},
              {"rotation_deg",
               {r.rotation_rad[0] / geometry::kRadiansPerDegree, r.rotation_rad[1] / geometry::kRadiansPerDegree}}};
  if (!r.estimated) {
    withhold(out, {"tip_mm", "covariance_mm2", "pivot_mm"});
    return out;
  }
  const calibration::PivotFit &plain = r.least_squares;
  out.update({{"tip_mm", json_vector(r.tip_mm)},
              {"covariance_mm2", json_matrix(r.covariance_mm2)},
              {"pivot_mm", json_vector(r.pivot_mm)},
              {"rms_mm", json_number(r.rms_mm)},
              {"worst_mm", json_number(r.worst_mm)},
              {"outliers", r.outliers},
              {"least_squares",
               {{"tip_mm", json_vector(plain.tip_mm)},
                {"pivot_mm", json_vector(plain.pivot_mm)},
                {"rms_mm", plain.rms_mm},
                {"rms_component_mm", plain.rms_component_mm},
                {"worst_mm", plain.worst_mm}}},
              {"halves",
               {{"tips_mm", {json_vector(r.half_tips_mm[0]), json_vector(r.half_tips_mm[1])}},
                {"apart_mm", r.halves_apart_mm}}}});
  if (!r.accepted()) {
    withhold(out, {"tip_mm", "covariance_mm2", "pivot_mm"});
    withhold(out["least_squares"], {"tip_mm", "pivot_mm"});
    withhold(out["halves"], {"tips_mm"});
  }
  return out;
}

// Of a refused calibration the residuals only: no tip that could be copied.
std::string to_text(const PivotResult &r, const casefile::PoseSeries &series) {
  std::string out = r.text + "\n\n";
  out += "Poses " + std::to_string(r.poses) +
         (series.invalid > 0 ? " (" + std::to_string(series.invalid) + " invalid frames left out)" : "") +
         (r.repeated > 0 ? " (" + std::to_string(r.repeated) + " repeat an earlier one: left out)" : "") +
         ", turned by " + fixed(r.rotation_rad[0] / geometry::kRadiansPerDegree, 0) + " and " +
         fixed(r.rotation_rad[1] / geometry::kRadiansPerDegree, 0) + " degrees about the two widest axes\n";
  if (!r.estimated) {
    return out;
  }
  const std::string halves =
      "\nOutliers " + std::to_string(r.outliers) + ", halves " + fixed(r.halves_apart_mm, 2, "mm") + " apart";
  if (!r.accepted()) {
    Table table({"Estimate", "Poses", "RMS mm", "Worst mm"});
    table.row({"robust", std::to_string(r.poses - r.outliers), fixed(r.rms_mm, 3), fixed(r.worst_mm, 3)});
    table.row({"least squares", std::to_string(r.poses), fixed(r.least_squares.rms_mm, 3),
               fixed(r.least_squares.worst_mm, 3)});
    return out + "\n" + table.text() + halves + "\n";
  }
  const Eigen::Vector3d sigma = r.covariance_mm2.diagonal().cwiseSqrt();
  Table table({"Estimate", "Poses", "Tip x mm", "y mm", "z mm", "RMS mm", "Worst mm"});
  const auto row = [&table](const char *name, std::size_t poses, const Eigen::Vector3d &tip, double rms, double worst) {
    table.row({name, std::to_string(poses), fixed(tip.x(), 3), fixed(tip.y(), 3), fixed(tip.z(), 3), fixed(rms, 3),
               fixed(worst, 3)});
  };
  row("robust", r.poses - r.outliers, r.tip_mm, r.rms_mm, r.worst_mm);
  table.row({"  1 sigma", "", fixed(sigma.x(), 3), fixed(sigma.y(), 3), fixed(sigma.z(), 3), "", ""});
  row("least squares", r.poses, r.least_squares.tip_mm, r.least_squares.rms_mm, r.least_squares.worst_mm);
  row("first half", r.poses / 2, r.half_tips_mm[0], geometry::kUnknown, geometry::kUnknown);
  row("second half", r.poses - r.poses / 2, r.half_tips_mm[1], geometry::kUnknown, geometry::kUnknown);
  return out + "\n" + table.text() + halves + ", pivot at " + vector_text(r.pivot_mm, 3) + " mm\n";
}

int calibrate_file(const PivotArguments &arguments, const Context &context) {
  const auto series = casefile::read_poses(arguments.source, arguments.transform);
  if (!series) {
    return fail(series.error());
  }
  if (series->poses.empty()) {
    return fail(arguments.source + ": none of its " + std::to_string(series->invalid) + " frames has a valid " +
                series->transform + " (every link of status OK)");
  }
  std::vector<calibration::PivotPose> poses;
  poses.reserve(series->poses.size());
  for (const casefile::TimedPose &pose : series->poses) {
    poses.push_back({pose.time_ns, pose.pose.as<geometry::frame::Target, geometry::frame::Tool>()});
  }
  calibration::PivotOptions options;
  options.tracker_noise_mm = arguments.noise_mm;
  const PivotResult result = calibration::calibrate_pivot(poses, options);
  if (context.json) {
    print_json(to_json(result, *series));
  } else {
    print(to_text(result, *series));
  }
  return result.accepted() ? kOk : kRefused;
}

int calibrate_live(const PivotArguments &arguments, const Context &context) {
  if (arguments.source != "start" && arguments.source != "finish") {
    return fail("\"" + arguments.source + "\": with --live it must be start or finish");
  }
  const auto kind = arguments.source == "start" ? bregma_wire_COMMAND_START_PIVOT : bregma_wire_COMMAND_FINISH_PIVOT;
  return send_and_show(live::make_command(kind, {arguments.live_tool}), context);
}

} // namespace

void add_calibrate_command(CLI::App &app, Context &context) {
  auto *calibrate = app.add_subcommand("calibrate", "Calibrates tools, and what a robot carries");
  calibrate->require_subcommand(1);
  auto *pivot = calibrate->add_subcommand("pivot", "Finds a tool's tip from poses that pivot about it");
  auto arguments = std::make_shared<PivotArguments>();
  pivot
      ->add_option("source", arguments->source,
                   "A folder or archive (.tgz, .zip) of 4x4 matrices named by their time in ns, or a PLUS sequence "
                   "(.igs.mha, .igs.mhd, .igs.nrrd); with --live: start or finish")
      ->required();
  pivot
      ->add_option("--transform", arguments->transform,
                   "Transform of a PLUS sequence; inverses and chains of recorded transforms are allowed")
      ->capture_default_str();
  pivot->add_option("--noise-mm", arguments->noise_mm, "The tracker's noise, 1 sigma of a coordinate of a marker")
      ->check(CLI::Range(0.001, 10.0))
      ->capture_default_str();
  pivot->add_option("--live", arguments->live_tool, "Let the daemon collect the poses of this tool")->type_name("TOOL");
  add_json_flag(*pivot, context);
  add_daemon_options(*pivot, context);
  pivot->footer("The exit code is 1 when the calibration is not fit for navigation.\n\nExamples:\n"
                "  bregma calibrate pivot poses.tgz\n"
                "  bregma calibrate pivot recording.igs.mha --transform StylusToReference --json\n"
                "  bregma calibrate pivot --live Stylus start    (pivot the tool, then)\n"
                "  bregma calibrate pivot --live Stylus finish");
  pivot->callback([arguments, &context] {
    context.run = [arguments, &context] {
      return arguments->live_tool.empty() ? calibrate_file(*arguments, context) : calibrate_live(*arguments, context);
    };
  });
  add_calibrate_hand_eye(*calibrate, context);
  add_calibrate_beam(*calibrate, context);
  add_calibrate_range(*calibrate, context);
}

} // namespace bregma::cli
