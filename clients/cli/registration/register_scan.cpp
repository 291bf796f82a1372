// `bregma register scan`: registers the records of a face scan with a range sensor to the surface of a head, with the
// chain of [NeuroGuide] or a better one.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/geometry/angles.hpp"
#include "casefile/range_curve.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/registration/register_commands.hpp"
#include "clients/cli/registration/registration_output.hpp"
#include "clients/cli/registration/scan_file.hpp"
#include "clients/cli/registration/surface_registration.hpp"

namespace bregma::cli {

namespace {

using nlohmann::json;

constexpr std::size_t kMaxSlopePoints = 20000; // every point is compared with every other
constexpr std::size_t kMinPoints = 20;         // of a registration without a start

struct ScanArguments {
  SurfaceArguments surface;
  std::string curve;
  std::optional<double> scale_mm, exponent;
  std::string chain = "robust";
  std::optional<std::size_t> window, smoothing, every;
  double modulo = 0.0;
  bool at_newest = false;
  double sensor_delay_ms = 38.3; // the data sheet's: the sensor measures for one period, then holds the value
  double bias_mm = 0.3, excess_mm = 5.0;
  std::optional<double> lowest_mm, max_slope_deg;
  range::ScanOptions options;
};

// The curve of the sensor, or the identity for distances.
base::Result<range::PowerLawFit> curve_of(const ScanArguments &arguments, const ScanFile &file) {
  const bool by_numbers = arguments.scale_mm || arguments.exponent;
  const bool given = !arguments.curve.empty() || by_numbers;
  if (file.distances) {
    range::PowerLawFit identity;
    identity.law = {1.0, 1.0};
    return given ? base::failure(arguments.surface.files.source.path +
                                 ": holds distances, which need no --curve, --scale-mm or --exponent")
                 : base::Result<range::PowerLawFit>(identity);
  }
  if (by_numbers && (!arguments.curve.empty() || !arguments.scale_mm || !arguments.exponent)) {
    return base::failure("--scale-mm and --exponent belong together, and replace --curve");
  }
  if (!given) {
    return base::failure(arguments.surface.files.source.path +
                         ": holds readings: say the sensor's curve by --curve, or by --scale-mm and --exponent "
                         "(a column distance_mm needs none)");
  }
  if (!arguments.curve.empty()) {
    return casefile::read_range_curve(arguments.curve);
  }
  range::PowerLawFit out;
  out.law = {*arguments.scale_mm, *arguments.exponent};
  return out;
}

// [NeuroGuide] has the law alone.
bool is_corrected(const ScanArguments &arguments) { return arguments.chain == "robust"; }

range::ScanOptions options_of(const ScanArguments &arguments, const range::PowerLawFit &fit) {
  range::ScanOptions out = arguments.options;
  out.chain = is_corrected(arguments) ? range::robust_chain() : range::ChainOptions();
  out.chain.raw.window = arguments.window.value_or(out.chain.raw.window);
  out.chain.smoothing = arguments.smoothing.value_or(out.chain.smoothing);
  out.chain.every = arguments.every.value_or(out.chain.every);
  out.chain.raw.sensor_delay_ns = std::llround(1e6 * arguments.sensor_delay_ms);
  out.curve = is_corrected(arguments) ? fit.corrected() : range::RangeCurve{fit.law, {}};
  out.at_newest = arguments.at_newest;
  out.lowest_mm = arguments.lowest_mm.value_or(out.lowest_mm);
  if (arguments.max_slope_deg) {
    out.max_slope_rad = geometry::kRadiansPerDegree * *arguments.max_slope_deg;
  }
  return out;
}

// 1 sigma of the curve's distance at the median reading, and what the calibration's points leave of a misfit: an error
// that all points have in common.
double curve_sigma_mm(const range::PowerLawFit &curve, const ScanFile &file, bool corrected) {
  std::vector<double> readings;
  for (const range::ScanRecord &record : file.records) {
    if (record.reading > 0.0) {
      readings.push_back(record.reading);
    }
  }
  if (readings.empty()) {
    return 0.0;
  }
  const auto middle = readings.begin() + static_cast<std::ptrdiff_t>(readings.size() / 2);
  std::nth_element(readings.begin(), middle, readings.end());
  return std::hypot(curve.sigma_mm(*middle), corrected ? curve.corrected_rms_mm : curve.rms_mm);
}

json scan_json(const range::SurfaceScan &scan, const ScanFile &file, const range::ScanOptions &options,
               const std::string &chain, double bias_mm) {
  json points = json::array();
  for (const Eigen::Vector3d &p : scan.points_mm) {
    points.push_back(json_vector(p));
  }
  return {{"records", file.records.size()},
          {"missing", scan.missing},
          {"damaged", file.damaged},
          {"points", scan.points_mm.size()},
          {"points_mm", std::move(points)},
          {"too_near", scan.too_near},
          {"too_far", scan.too_far},
          {"too_low", scan.too_low},
          {"too_steep", scan.too_steep},
          {"without_position", scan.without_position},
          {"chain", chain},
          {"window", options.chain.raw.window},
          {"smoothing", options.chain.smoothing},
          {"every", options.chain.every},
          {"delay_ms", json_number(scan.delay_ms)},
          {"delay_removed", !options.at_newest},
          {"height_mm", options.height_mm},
          {"scale_mm", options.curve.law.scale_mm},
          {"exponent", options.curve.law.exponent},
          {"corrections", options.curve.corrections.size()},
          {"bias_sigma_mm", json_number(bias_mm)}};
}

std::string scan_text(const range::SurfaceScan &scan, const ScanFile &file, const range::ScanOptions &options) {
  const auto counted = [](std::size_t count, const char *what) {
    return count > 0 ? ", " + std::to_string(count) + " " + what : std::string();
  };
  return std::to_string(scan.points_mm.size()) + " points from " + std::to_string(file.records.size()) + " records" +
         counted(scan.missing, "without a reading") + counted(file.damaged, "damaged") + "; left out" +
         (scan.too_near + scan.too_far + scan.too_low + scan.too_steep + scan.without_position == 0 ? " none" : "") +
         counted(scan.too_near, "too near") + counted(scan.too_far, "too far") + counted(scan.too_low, "too low") +
         counted(scan.too_steep, "too steep") + counted(scan.without_position, "without a position") + "; delay " +
         fixed(scan.delay_ms, 0, "ms") + (options.at_newest ? ", not removed" : ", removed") + "\n\n";
}

int register_scan(const ScanArguments &arguments, const Context &context) {
  const RegistrationFiles &files = arguments.surface.files;
  if (auto kept = check_output(
          "--tfm", files.tfm,
          {files.source.path, files.target.path, arguments.surface.targets, arguments.surface.start, arguments.curve});
      !kept) {
    return fail(kept.error());
  }
  const auto file = read_scan_file(files.source.path, arguments.modulo);
  if (!file) {
    return fail(file.error());
  }
  const auto curve = curve_of(arguments, *file);
  if (!curve) {
    return fail(curve.error());
  }
  if (arguments.options.near_mm >= arguments.options.far_mm) {
    return fail("--near-mm must be below --far-mm");
  }
  const range::ScanOptions options = options_of(arguments, *curve);
  if (arguments.max_slope_deg && file->records.size() / options.chain.every > kMaxSlopePoints) {
    return fail("--max-slope-deg is for at most " + std::to_string(kMaxSlopePoints) + " points: say a larger --every");
  }
  Cloud samples;
  const range::SurfaceScan scan = range::surface_points(file->records, options);
  samples.points_mm = scan.points_mm;
  samples.notes = file->notes;
  const double bias_mm = std::hypot(arguments.bias_mm, curve_sigma_mm(*curve, *file, is_corrected(arguments)));
  json document = {{"T_target_source", nullptr},
                   {"T_source_target", nullptr},
                   {"covariance", nullptr},
                   {"scan", scan_json(scan, *file, options, arguments.chain, bias_mm)}};
  if (scan.points_mm.size() < kMinPoints) {
    document["notes"] = samples.notes;
    return refuse("refused",
                  std::to_string(scan.points_mm.size()) + " points from " + std::to_string(file->records.size()) +
                      " records (every " + std::to_string(options.chain.every) + "., window " +
                      std::to_string(options.chain.raw.window) + "; " + std::to_string(scan.missing) +
                      " without a reading): at least " + std::to_string(kMinPoints) +
                      " are needed, say a smaller --every or --window",
                  context, std::move(document));
  }
  const auto problem =
      casefile::size_problem(scan.points_mm, casefile::kPointsSize, casefile::LengthUnit::kMillimetre, "the scan", "");
  if (!problem.empty()) {
    return fail(files.source.path + ": " + problem);
  }
  const auto input = read_surface_input(arguments.surface);
  if (!input) {
    return fail(input.error());
  }
  if (!context.json) {
    print(scan_text(scan, *file, options));
  }
  return register_samples(arguments.surface, samples, *input,
                          ScanningBeam{Eigen::Vector3d::UnitZ(), bias_mm, arguments.excess_mm}, std::move(document),
                          context);
}

void add_chain_options(CLI::App &command, ScanArguments &arguments) {
  command
      .add_option("--chain", arguments.chain,
                  "Filter of the readings: robust (Hampel over 200), or neuroguide (mean over 100 without what lies "
                  "more than one sigma off, curve, mean of 3)")
      ->check(CLI::IsMember({"robust", "neuroguide"}))
      ->capture_default_str();
  command.add_option("--window", arguments.window, "Readings of the first filter; 1: none")
      ->check(CLI::Range(1, 100000));
  command.add_option("--smoothing", arguments.smoothing, "Distances of the mean after the curve; 1: none")
      ->check(CLI::Range(1, 100000));
  command.add_option("--every", arguments.every, "Takes every n-th record as a point (1000)")
      ->check(CLI::Range(1, 10000000));
  command
      .add_option("--modulo", arguments.modulo,
                  "Takes readings modulo this number, for lines that joined two of them; 0: as they are")
      ->check(CLI::Range(0.0, 1e9));
  command.add_flag("--keep-delay", arguments.at_newest,
                   "Takes X and Y of the newest record, as in [NeuroGuide], instead of those of the value's time");
  command.add_option("--period-ms", arguments.options.period_ms, "Time between two records")
      ->check(CLI::Range(1e-3, 1e5))
      ->capture_default_str();
  command.add_option("--sensor-delay-ms", arguments.sensor_delay_ms, "Age of the sensor's value when it is read")
      ->check(CLI::Range(0.0, 1e5))
      ->capture_default_str();
}

} // namespace

void add_register_scan(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("scan", "Registers a face scan by a range sensor onto the surface of a head");
  auto arguments = std::make_shared<ScanArguments>();
  RegistrationFiles &files = arguments->surface.files;
  command
      ->add_option("scan", files.source.path,
                   "One row per reading: x, y (mm) and the reading, NaN where it is missing; or a column distance_mm")
      ->required();
  add_input_file(*command, files.target, "surface",
                 "PLY, STL, VTK, GIFTI or FreeSurfer; or an image of the head, whose scalp is extracted");
  add_tfm_option(*command, files);
  command->add_option("--curve", arguments->curve, "The sensor's curve: the file that calibrate range --json prints");
  command->add_option("--scale-mm", arguments->scale_mm, "The curve: distance at a reading of one")
      ->check(CLI::Range(1e-6, 1e12));
  command->add_option("--exponent", arguments->exponent, "The curve: exponent of the reading")
      ->check(CLI::Range(-10.0, 10.0));
  add_chain_options(*command, *arguments);
  command->add_option("--height-mm", arguments->options.height_mm, "Height of the sensor above the table")
      ->check(CLI::Range(0.0, 1e5))
      ->capture_default_str();
  command->add_option("--near-mm", arguments->options.near_mm, "Nearer distances are left out")
      ->check(CLI::Range(0.0, 1e5))
      ->capture_default_str();
  command->add_option("--far-mm", arguments->options.far_mm, "Farther distances are left out")
      ->check(CLI::Range(0.0, 1e9));
  command->add_option("--lowest-mm", arguments->lowest_mm,
                      "Points below this height above the table are left out: they are the table");
  command
      ->add_option("--max-slope-deg", arguments->max_slope_deg,
                   "Points on steeper slopes are left out, where the points within 12 mm determine the slope: an "
                   "infrared sensor reads too far there")
      ->check(CLI::Range(1.0, 90.0));
  command
      ->add_option("--bias-mm", arguments->bias_mm,
                   "Error of the distance that all points have in common, 1 sigma; the curve's own is added")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  command
      ->add_option("--excess-mm", arguments->excess_mm,
                   "By how much the sensor may read too far on tilted skin, 1 sigma, times 1 - cos(tilt): estimated "
                   "with the pose; 0: readings are taken as they are")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  add_surface_options(*command, arguments->surface);
  add_json_flag(*command, context);
  command->footer(
      "A point is the robot's x and y and the height --height-mm less the distance. The pose is searched\n"
      "without a start; verdicts as of `register surface`. In JSON the transform is null unless it was\n"
      "found.\n\nExamples:\n"
      "  bregma register scan scan.txt scalp.ply --curve curve.json --targets lesion.mrk.json\n"
      "  bregma register scan scan.txt scalp.ply --curve curve.json --chain neuroguide --keep-delay --excess-mm 0\n"
      "  bregma register scan scan.txt head.nii.gz --scale-mm 130 --exponent -1.1 --every 500 --json");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return register_scan(*arguments, context); }; });
}

} // namespace bregma::cli
