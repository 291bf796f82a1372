#include <cmath>
#include <initializer_list>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/calibration/beam.hpp"
#include "algorithms/calibration/hand_eye.hpp"
#include "algorithms/geometry/angles.hpp"
#include "algorithms/range/power_law.hpp"
#include "base/csv_table.hpp"
#include "base/text.hpp"
#include "casefile/poses.hpp"
#include "clients/cli/calibrate_commands.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/registration/registration_output.hpp"

namespace bregma::cli {

namespace {

using geometry::kRadiansPerDegree;
using nlohmann::json;

// The numbers of named columns, one row per row of the file. The file must have a header.
base::Result<std::vector<std::vector<double>>> read_columns(const std::string &file,
                                                            const std::vector<std::string> &names) {
  const auto table = base::read_csv(file);
  if (!table) {
    return tl::unexpected(table.error());
  }
  std::map<std::string, std::size_t> at;
  if (!table->rows.empty()) {
    for (std::size_t i = 0; i < table->rows.front().cells.size(); ++i) {
      at.emplace(base::lower(table->rows.front().cells[i]), i);
    }
  }
  for (const std::string &name : names) {
    if (!at.contains(name)) {
      return base::failure(file + ": no column \"" + name + "\" in its header");
    }
  }
  std::vector<std::vector<double>> out;
  for (std::size_t r = 1; r < table->rows.size(); ++r) {
    const base::CsvRow &row = table->rows[r];
    std::vector<double> values;
    for (const std::string &name : names) {
      const std::size_t column = at[name];
      const auto value = column < row.cells.size() ? table->number(row.cells[column]) : std::nullopt;
      if (!value) {
        return base::failure(table->place(row) + name + ": no number");
      }
      values.push_back(*value);
    }
    out.push_back(std::move(values));
  }
  return out;
}

// values: the keys of the document that a refused calibration withholds. details: what is printed of an accepted one.
int show(json document, std::initializer_list<const char *> values, const std::string &verdict_text,
         const std::string &details, bool accepted, const Context &context) {
  document["accepted"] = accepted;
  document["text"] = verdict_text;
  if (!accepted) {
    withhold(document, values);
  }
  if (context.json) {
    print_json(document);
  } else {
    print(verdict_text + "\n" + (accepted ? details : std::string()));
  }
  return accepted ? kOk : kRefused;
}

// --- hand-eye

struct HandEyeArguments {
  std::string robot, tracker;
  std::string robot_transform, tracker_transform;
  bool motions = false;
  calibration::HandEyeOptions options;
  double robot_deg = 0.01, tracker_deg = 0.1;
};

const char *name_of(calibration::HandEyeVerdict verdict) {
  switch (verdict) {
  case calibration::HandEyeVerdict::kAccepted:
    return "accepted";
  case calibration::HandEyeVerdict::kTooFewPoses:
    return "too_few_poses";
  case calibration::HandEyeVerdict::kInvalidPose:
    return "invalid_pose";
  case calibration::HandEyeVerdict::kNoRotation:
    return "no_rotation";
  case calibration::HandEyeVerdict::kOneAxis:
    return "one_axis";
  case calibration::HandEyeVerdict::kPoorlyObserved:
    return "poorly_observed";
  case calibration::HandEyeVerdict::kNotConverged:
    return "not_converged";
  case calibration::HandEyeVerdict::kFitsBadly:
    break;
  }
  return "fits_badly";
}

// Poses of the same times; poses of one list alone are counted.
base::Result<std::vector<calibration::HandEyePair>> read_pairs(const HandEyeArguments &arguments, std::size_t &alone) {
  const auto robot = casefile::read_poses(arguments.robot, arguments.robot_transform);
  if (!robot) {
    return tl::unexpected(robot.error());
  }
  const auto tracker = casefile::read_poses(arguments.tracker, arguments.tracker_transform);
  if (!tracker) {
    return tl::unexpected(tracker.error());
  }
  std::map<std::int64_t, casefile::NamedRigid> by_time;
  for (const casefile::TimedPose &pose : tracker->poses) {
    by_time.emplace(pose.time_ns, pose.pose);
  }
  std::vector<calibration::HandEyePair> out;
  for (const casefile::TimedPose &pose : robot->poses) {
    if (const auto other = by_time.find(pose.time_ns); other != by_time.end()) {
      out.push_back({pose.pose, other->second});
    }
  }
  if (out.empty()) {
    return base::failure(arguments.robot + " and " + arguments.tracker +
                         ": no pose of one has the time of a pose of the other");
  }
  alone = robot->poses.size() + tracker->poses.size() - 2 * out.size();
  return out;
}

int calibrate_hand_eye_files(HandEyeArguments arguments, const Context &context) {
  std::size_t alone = 0;
  const auto pairs = read_pairs(arguments, alone);
  if (!pairs) {
    return fail(pairs.error());
  }
  arguments.options.robot.rotation_rad = arguments.robot_deg * kRadiansPerDegree;
  arguments.options.tracker.rotation_rad = arguments.tracker_deg * kRadiansPerDegree;
  const auto result = arguments.motions ? calibration::calibrate_hand_eye_motions(*pairs, arguments.options)
                                        : calibration::calibrate_hand_eye(*pairs, arguments.options);
  json document = {
      {"verdict", name_of(result.verdict)},
      {"equation", arguments.motions ? "AX=XB" : "AX=YB"},
      {"pairs", result.pairs},
      {"poses_without_partner", alone},
      {"rotation_deg", {result.rotation_rad[0] / kRadiansPerDegree, result.rotation_rad[1] / kRadiansPerDegree}}};
  if (alone > 0 && !context.json) {
    print_notes({std::to_string(alone) + " poses have no partner of the same time: left out"});
  }
  std::string details;
  if (result.estimated) {
    document.update({{"X", json_matrix(result.X.matrix())},
                     {"covariance_X", json_matrix(result.covariance_X)},
                     {"rms_position_mm", json_number(result.rms_position_mm)},
                     {"rms_rotation_deg", json_number(result.rms_rotation_rad / kRadiansPerDegree)},
                     {"p_value", json_number(result.p_value)}});
    details += "\n" + matrix_text("X: the tracked body in the flange, mm", result.X.matrix());
    if (!arguments.motions) {
      document.update({{"Y", json_matrix(result.Y.matrix())},
                       {"covariance_Y", json_matrix(result.covariance_Y)},
                       {"covariance_joint", json_matrix(result.joint)}});
      details += "\n" + matrix_text("Y: the tracker in the robot's base, mm", result.Y.matrix());
    }
  }
  if (arguments.motions) {
    return show(std::move(document), {"X", "covariance_X"}, result.text, details, result.accepted(), context);
  }
  return show(std::move(document), {"X", "covariance_X", "Y", "covariance_Y", "covariance_joint"}, result.text, details,
              result.accepted(), context);
}

// --- beam

struct BeamArguments {
  std::string file;
  std::string body = "plane";
  double radius_mm = 0.0; // 0: not known
  calibration::BeamOptions options;
};

const char *name_of(calibration::BeamVerdict verdict) {
  switch (verdict) {
  case calibration::BeamVerdict::kAccepted:
    return "accepted";
  case calibration::BeamVerdict::kTooFewReadings:
    return "too_few_readings";
  case calibration::BeamVerdict::kInvalidReading:
    return "invalid_reading";
  case calibration::BeamVerdict::kFixedOrientation:
    return "fixed_orientation";
  case calibration::BeamVerdict::kOneAxis:
    return "one_axis";
  case calibration::BeamVerdict::kConstantRange:
    return "constant_range";
  case calibration::BeamVerdict::kPoorlyObserved:
    return "poorly_observed";
  case calibration::BeamVerdict::kNotConverged:
    return "not_converged";
  case calibration::BeamVerdict::kFitsBadly:
    break;
  }
  return "fits_badly";
}

int calibrate_beam_file(BeamArguments arguments, const Context &context) {
  const auto rows = read_columns(arguments.file, {"x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "range_mm"});
  if (!rows) {
    return fail(rows.error());
  }
  std::vector<calibration::BeamReading> readings;
  for (const std::vector<double> &row : *rows) {
    const Eigen::Quaterniond q(row[3], row[4], row[5], row[6]);
    if (!(std::abs(q.norm() - 1.0) < 1e-3)) {
      return fail(arguments.file + ": the quaternion of reading " + std::to_string(readings.size() + 1) +
                  " is not of unit length");
    }
    readings.push_back({calibration::BeamFlange(q, {row[0], row[1], row[2]}), row[7]});
  }
  arguments.options.body = arguments.body == "plane" ? calibration::BeamBody::kPlane : calibration::BeamBody::kSphere;
  if (arguments.radius_mm > 0.0) {
    arguments.options.radius_mm = arguments.radius_mm;
  }
  const auto result = calibration::calibrate_beam(readings, arguments.options);
  json document = {
      {"verdict", name_of(result.verdict)},
      {"body", arguments.body},
      {"readings", readings.size()},
      {"range_change_mm", json_number(result.range_change_mm)},
      {"rotation_deg", {result.rotation_rad[0] / kRadiansPerDegree, result.rotation_rad[1] / kRadiansPerDegree}}};
  std::string details;
  if (result.estimated) {
    document.update({{"origin_mm", json_vector(result.beam.origin_mm)},
                     {"direction", json_vector(result.beam.direction)},
                     {"covariance", json_matrix(result.covariance)},
                     {"rms_mm", json_number(result.rms_mm)},
                     {"p_value", json_number(result.p_value)}});
    details = "\nOrigin " + vector_text(result.beam.origin_mm, 3) + " mm, direction " +
              vector_text(result.beam.direction, 5) + " in the flange; RMS " + fixed(result.rms_mm, 3, "mm") + "\n";
  }
  return show(std::move(document), {"origin_mm", "direction", "covariance"}, result.text, details, result.accepted(),
              context);
}

// --- range

const char *name_of(range::PowerLawVerdict verdict) {
  switch (verdict) {
  case range::PowerLawVerdict::kAccepted:
    return "accepted";
  case range::PowerLawVerdict::kTooFewPoints:
    return "too_few_points";
  case range::PowerLawVerdict::kInvalidPoint:
    return "invalid_point";
  case range::PowerLawVerdict::kTooNarrow:
    return "too_narrow";
  case range::PowerLawVerdict::kNotMonotone:
    return "not_monotone";
  case range::PowerLawVerdict::kDoesNotFit:
    break;
  }
  return "does_not_fit";
}

struct RangeArguments {
  std::string file;
  range::PowerLawOptions options;
};

int calibrate_range_file(const RangeArguments &arguments, const Context &context) {
  const auto rows = read_columns(arguments.file, {"reading", "distance_mm"});
  if (!rows) {
    return fail(rows.error());
  }
  std::vector<range::CalibrationPoint> points;
  for (const std::vector<double> &row : *rows) {
    points.push_back({row[0], row[1]});
  }
  const range::PowerLawFit fit = range::fit_power_law(points, arguments.options);
  json document = {{"verdict", name_of(fit.verdict)}, {"points", points.size()}};
  std::string details;
  if (fit.estimated) {
    json misfits = json::array();
    for (const range::Misfit &m : fit.misfits) {
      misfits.push_back({{"from_mm", m.from_mm}, {"to_mm", m.to_mm}, {"bias_mm", m.bias_mm}});
    }
    json corrections = json::array();
    for (const range::CurveCorrection &c : fit.corrections) {
      corrections.push_back({{"reading", c.reading}, {"add_mm", c.add_mm}});
    }
    document.update({{"scale_mm", json_number(fit.law.scale_mm)},
                     {"exponent", json_number(fit.law.exponent)},
                     {"covariance", json_matrix(fit.covariance)},
                     {"rms_mm", json_number(fit.rms_mm)},
                     {"worst_mm", json_number(fit.worst_mm)},
                     {"corrections", std::move(corrections)},
                     {"corrected_rms_mm", json_number(fit.corrected_rms_mm)},
                     {"misfits", std::move(misfits)}});
    const Eigen::Vector2d sigma = fit.covariance.diagonal().cwiseSqrt();
    details = "\ndistance = scale * reading^exponent: scale " + fixed(fit.law.scale_mm, 3, "mm") + " (1 sigma " +
              fixed(sigma[0], 3) + "), exponent " + fixed(fit.law.exponent, 5) + " (" + fixed(sigma[1], 5) + "), RMS " +
              fixed(fit.rms_mm, 2, "mm") + ", worst " + fixed(fit.worst_mm, 2, "mm") + "; with the mean residuals of " +
              std::to_string(fit.corrections.size()) + " stretches as corrections, RMS " +
              fixed(fit.corrected_rms_mm, 2, "mm") + "\n";
  }
  return show(std::move(document), {"scale_mm", "exponent", "covariance", "corrections"}, fit.text, details,
              fit.accepted(), context);
}

} // namespace

void add_calibrate_hand_eye(CLI::App &parent, Context &context) {
  auto *command =
      parent.add_subcommand("hand-eye", "Finds a tracked body on a robot's flange, and the tracker's place");
  auto arguments = std::make_shared<HandEyeArguments>();
  command
      ->add_option(
          "robot", arguments->robot,
          "Poses of the flange in the robot's base: a folder or archive of 4x4 matrices named by their time in "
          "ns, or a PLUS sequence")
      ->required();
  command->add_option("tracker", arguments->tracker, "Poses of the body in the tracker, of the same times")->required();
  command->add_option("--robot-transform", arguments->robot_transform, "Transform of a PLUS sequence");
  command->add_option("--tracker-transform", arguments->tracker_transform, "Transform of a PLUS sequence");
  command->add_flag("--motions", arguments->motions, "The poses are motions: AX = XB instead of AX = YB");
  const auto sigma = [command](const std::string &name, double &value, const std::string &text) {
    command->add_option(name, value, text)->check(CLI::Range(1e-6, 100.0))->capture_default_str();
  };
  sigma("--robot-mm", arguments->options.robot.position_mm, "Error of the flange's position, 1 sigma per coordinate");
  sigma("--robot-deg", arguments->robot_deg, "Error of the flange's rotation");
  sigma("--tracker-mm", arguments->options.tracker.position_mm, "Error of the body's position");
  sigma("--tracker-deg", arguments->tracker_deg, "Error of the body's rotation");
  add_json_flag(*command, context);
  command->footer("The exit code is 1 when the motion is degenerate or the poses do not fit.\n\nExamples:\n"
                  "  bregma calibrate hand-eye flange.tgz body.tgz\n"
                  "  bregma calibrate hand-eye flange.tgz body.tgz --json > hand_eye.json   "
                  "(for bregmad: [hand_eye] of the file robot.tools)\n"
                  "  bregma calibrate hand-eye flange.tgz body.tgz --tracker-mm 0.25 --json");
  command->callback([arguments, &context] {
    context.run = [arguments, &context] { return calibrate_hand_eye_files(*arguments, context); };
  });
}

void add_calibrate_beam(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("beam", "Finds origin and direction of a range sensor's beam in the flange");
  auto arguments = std::make_shared<BeamArguments>();
  command
      ->add_option("file", arguments->file,
                   "Scan of a plane or sphere: .csv with x_mm, y_mm, z_mm, qw, qx, qy, qz of the flange and range_mm")
      ->required();
  command->add_option("--body", arguments->body, "What was scanned")
      ->check(CLI::IsMember({"plane", "sphere"}))
      ->capture_default_str();
  command->add_option("--radius-mm", arguments->radius_mm, "Radius of the sphere; without it, it is estimated")
      ->check(CLI::Range(1.0, 1000.0));
  command->add_option("--range-mm", arguments->options.range_sigma_mm, "Error of a reading, 1 sigma")
      ->check(CLI::Range(1e-6, 100.0))
      ->capture_default_str();
  command->add_option("--robot-mm", arguments->options.robot_sigma_mm, "Error of the flange's position, 1 sigma")
      ->check(CLI::Range(1e-6, 100.0))
      ->capture_default_str();
  add_json_flag(*command, context);
  command->footer("Scan from several orientations and distances. The exit code is 1 when the scan does not determine\n"
                  "the beam.\n\nExamples:\n  bregma calibrate beam plane.csv\n"
                  "  bregma calibrate beam ball.csv --body sphere --radius-mm 30 --json");
  command->callback([arguments, &context] {
    context.run = [arguments, &context] { return calibrate_beam_file(*arguments, context); };
  });
}

void add_calibrate_range(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("range", "Fits a power law to a range sensor's readings");
  auto arguments = std::make_shared<RangeArguments>();
  command->add_option("file", arguments->file, "Readings at known distances: .csv with reading and distance_mm")
      ->required();
  command
      ->add_option("--max-bias-mm", arguments->options.max_bias_mm,
                   "Mean error of an eighth of the points above which the law does not fit there")
      ->check(CLI::Range(0.001, 100.0))
      ->capture_default_str();
  add_json_flag(*command, context);
  command->footer("The exit code is 1 when a power law does not fit; the output says where.\n\nExample:\n"
                  "  bregma calibrate range readings.csv --json");
  command->callback([arguments, &context] {
    context.run = [arguments, &context] { return calibrate_range_file(*arguments, context); };
  });
}

} // namespace bregma::cli
