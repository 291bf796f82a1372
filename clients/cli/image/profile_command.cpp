// `bregma image profile`: a similarity measure over one parameter of the pose.
#include <cmath>
#include <fstream>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <Eigen/Geometry>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/intensity/similarity_measure.hpp"
#include "base/plots.hpp"
#include "clients/cli/case/progress_line.hpp"
#include "clients/cli/image/image_commands.hpp"
#include "clients/cli/image/image_input.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

using intensity::Volume;
using nlohmann::json;

constexpr int kMaxSteps = 2000;

struct ProfileArguments {
  ImageFile source, target;
  std::vector<std::string> measures = {"nmi"};
  std::string parameter = "rotation-z";
  double from = -20.0, to = 20.0, step = 1.0;
  int bins = 64;
  bool dark = false;
  std::string csv, plot;
};

struct Profile {
  std::vector<double> at;
  std::vector<std::vector<double>> value; // of each measure
};

// Motion of the target about its centre; degrees or mm.
Eigen::Matrix4d motion(const std::string &parameter, double by, const Eigen::Vector3d &centre) {
  const Eigen::Vector3d axis = Eigen::Vector3d::Unit(parameter.back() - 'x');
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  if (parameter.starts_with("rotation")) {
    out.translate(centre);
    out.rotate(Eigen::AngleAxisd(by * geometry::kRadiansPerDegree, axis));
    out.translate(-centre);
  } else {
    out.translate(by * axis);
  }
  return out.matrix();
}

base::Result<Profile> profile_of(const ProfileArguments &arguments, const Volume &source, const Volume &target) {
  const int steps = static_cast<int>(std::floor((arguments.to - arguments.from) / arguments.step + 1e-9)) + 1;
  if (!(arguments.to >= arguments.from) || steps > kMaxSteps) {
    return base::failure("--from, --to, --step: " + std::to_string(steps) + " steps; 1 to " +
                         std::to_string(kMaxSteps) + " are possible");
  }
  const Eigen::Vector3d last(target.size[0] - 1, target.size[1] - 1, target.size[2] - 1);
  const Eigen::Vector3d centre = target.point_mm(0.5 * last);
  parallel::Team team(registration_threads());
  intensity::MeasureOptions options;
  options.bins = arguments.bins;
  options.tail = kGreyTail;
  options.outside = arguments.dark ? intensity::Outside::kDark : intensity::Outside::kLeftOut;
  Profile out;
  ProgressLine progress;
  for (const std::string &name : arguments.measures) {
    const auto measure = intensity::make_measure(measure_named(name), target, source, options, team);
    std::vector<double> values;
    for (int i = 0; i < steps; ++i) {
      const double done = (static_cast<double>(out.value.size()) + static_cast<double>(i) / steps) /
                          static_cast<double>(arguments.measures.size());
      if (!progress.show(done, name)) {
        return base::failure("stopped");
      }
      const double at = arguments.from + i * arguments.step;
      values.push_back(measure->value(motion(arguments.parameter, at, centre)));
      if (out.value.empty()) {
        out.at.push_back(at);
      }
    }
    out.value.push_back(std::move(values));
  }
  return out;
}

// Where a measure is largest; NaN without any value.
double peak(const Profile &profile, std::size_t measure) {
  double best = std::nan("");
  double at = std::nan("");
  for (std::size_t i = 0; i < profile.at.size(); ++i) {
    const double value = profile.value[measure][i];
    if (std::isfinite(value) && !(value <= best)) {
      best = value;
      at = profile.at[i];
    }
  }
  return at;
}

// A curve that is largest where the range ends may be larger beyond it.
void note_open_ends(const Profile &profile, const ProfileArguments &arguments, std::vector<std::string> &notes) {
  for (std::size_t m = 0; m < profile.value.size(); ++m) {
    const double at = peak(profile, m);
    if (at == profile.at.front() || at == profile.at.back()) {
      notes.push_back(arguments.measures[m] +
                      ": largest at the end of the range; a wider one (--from, --to) may show a larger value");
    }
  }
}

base::Result<void> write_text(const std::string &path, const std::string &text) {
  std::ofstream file(path);
  file << text;
  file.close();
  return file ? base::Result<void>() : base::failure(path + ": cannot be written");
}

std::string csv_of(const Profile &profile, const ProfileArguments &arguments) {
  std::string out = arguments.parameter + (arguments.parameter.starts_with("rotation") ? "_deg" : "_mm");
  for (const std::string &name : arguments.measures) {
    out += "," + name;
  }
  out += "\n";
  for (std::size_t i = 0; i < profile.at.size(); ++i) {
    out += fixed(profile.at[i], 4);
    for (const auto &values : profile.value) {
      out += "," + (std::isfinite(values[i]) ? fixed(values[i], 8) : std::string());
    }
    out += "\n";
  }
  return out;
}

// Each curve from its smallest to its largest value, as measures have different units.
std::string plot_of(const Profile &profile, const ProfileArguments &arguments) {
  constexpr std::array kColours{base::colour::kBlue,   base::colour::kOrange, base::colour::kGreen,
                                base::colour::kPurple, base::colour::kYellow, base::colour::kSky};
  base::Plot plot;
  plot.title = "Similarity over " + arguments.parameter;
  plot.x.label = arguments.parameter + (arguments.parameter.starts_with("rotation") ? " (deg)" : " (mm)");
  plot.y.label = "similarity, scaled to 0..1";
  for (std::size_t m = 0; m < profile.value.size(); ++m) {
    double low = std::nan("");
    double high = std::nan("");
    for (const double v : profile.value[m]) {
      low = std::fmin(low, v);
      high = std::fmax(high, v);
    }
    base::Series series;
    series.name = arguments.measures[m];
    series.colour = kColours[m % kColours.size()];
    for (std::size_t i = 0; i < profile.at.size(); ++i) {
      series.points.push_back({profile.at[i], (profile.value[m][i] - low) / (high - low)});
    }
    plot.series.push_back(std::move(series));
  }
  return base::plot_svg(plot, {});
}

int profile_images(const ProfileArguments &arguments, const Context &context) {
  for (const auto &[option, path] : {std::pair("--csv", arguments.csv), std::pair("--plot", arguments.plot)}) {
    if (auto kept = check_output(option, path, {arguments.source.path, arguments.target.path}); !kept) {
      return fail(kept.error());
    }
  }
  std::vector<std::string> notes;
  auto source = read_image(arguments.source, notes);
  if (!source) {
    return fail(source.error());
  }
  auto target = read_image(arguments.target, notes);
  if (!target) {
    return fail(target.error());
  }
  leave_out_padding(*source, arguments.source.path, notes);
  leave_out_padding(*target, arguments.target.path, notes);
  for (const auto &[image, path] :
       {std::pair(&*source, &arguments.source.path), std::pair(&*target, &arguments.target.path)}) {
    if (auto sound = check_contrast(*image, *path); !sound) {
      return fail(sound.error());
    }
  }
  const auto profile = profile_of(arguments, *source, *target);
  if (!profile) {
    return fail(profile.error());
  }
  note_open_ends(*profile, arguments, notes);
  if (context.json) {
    json curves = json::object();
    json peaks = json::object();
    for (std::size_t m = 0; m < arguments.measures.size(); ++m) {
      json values = json::array();
      for (const double v : profile->value[m]) {
        values.push_back(json_number(v));
      }
      curves[arguments.measures[m]] = std::move(values);
      peaks[arguments.measures[m]] = json_number(peak(*profile, m));
    }
    print_json({{"parameter", arguments.parameter},
                {"at", profile->at},
                {"similarity", std::move(curves)},
                {"largest_at", std::move(peaks)},
                {"notes", notes}});
  } else {
    print_notes(notes);
    Table table({"Measure", arguments.parameter.starts_with("rotation") ? "Largest at deg" : "Largest at mm"});
    for (std::size_t m = 0; m < arguments.measures.size(); ++m) {
      table.row({arguments.measures[m], fixed(peak(*profile, m), 2)});
    }
    print(table.text());
  }
  if (!arguments.csv.empty()) {
    if (auto written = write_text(arguments.csv, csv_of(*profile, arguments)); !written) {
      return fail(written.error());
    }
  }
  if (!arguments.plot.empty()) {
    if (auto written = write_text(arguments.plot, plot_of(*profile, arguments)); !written) {
      return fail(written.error());
    }
  }
  return kOk;
}

} // namespace

void add_image_profile(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("profile", "Shows similarity measures over one parameter of the pose");
  auto arguments = std::make_shared<ProfileArguments>();
  add_image_file(*command, arguments->source, "source", "The floating image");
  add_image_file(*command, arguments->target, "target", "The reference image");
  command->add_option("--measure", arguments->measures, "Measures; several are separated by commas")
      ->delimiter(',')
      ->check(CLI::IsMember(measure_names()))
      ->capture_default_str();
  command->add_option("--parameter", arguments->parameter, "About the centre of the target, from the headers' pose")
      ->check(CLI::IsMember({"rotation-x", "rotation-y", "rotation-z", "x", "y", "z"}))
      ->capture_default_str();
  command->add_option("--from", arguments->from, "First value, degrees or mm")->capture_default_str();
  command->add_option("--to", arguments->to, "Last value, degrees or mm")->capture_default_str();
  command->add_option("--step", arguments->step, "Distance of two values")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  add_bins_option(*command, arguments->bins);
  command->add_flag("--dark-outside", arguments->dark,
                    "Compare the darkest value outside the source, instead of leaving it out");
  command->add_option("--csv", arguments->csv, "Write the curves as CSV");
  command->add_option("--plot", arguments->plot, "Write the curves as a picture (SVG)");
  add_json_flag(*command, context);
  command->footer(
      "Examples:\n  bregma image profile mr.nii.gz ct.nii.gz --measure nmi,gmi,ami --from -60 --to 60 --plot "
      "curves.svg\n  bregma image profile mr.nii.gz ct.nii.gz --parameter x --csv shift.csv");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return profile_images(*arguments, context); }; });
}

} // namespace bregma::cli
