// `bregma register points`: rigid registration of two lists of points in files.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <set>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/registration/points/robust_points.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/registration/register_commands.hpp"
#include "clients/cli/registration/registration_output.hpp"

namespace bregma::cli {

namespace {

using base::Result;
using casefile::NamedPoint;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using nlohmann::json;
using registration::PairedFit;
using registration::RobustFit;

// Below this spread the rotation about the line through the points is nearly undetermined.
constexpr double kMinSpread_mm = 3.0;
// Significance level: below this p-value the stated error or a point is wrong.
constexpr double kContradiction = 0.001;

struct PointsArguments {
  RegistrationFiles files;
  // Standard deviation of a coordinate, both lists combined. If neither this option nor a file states it, it is
  // estimated from the residuals.
  std::optional<double> sigma_mm;
  std::vector<double> at_mm; // a point in source coordinates to predict the TRE at; empty or three numbers
  std::string targets;       // a file of points in target coordinates
  bool leave_out_suspects = false;
};

struct Pair {
  std::string name;
  Vector3d source, target;
  Matrix3d source_covariance = Matrix3d::Zero();
  Matrix3d target_covariance = Matrix3d::Zero();
};

bool all_named(const std::vector<NamedPoint> &points) {
  return std::all_of(points.begin(), points.end(),
                     [](const NamedPoint &p) { return p.name.find_first_not_of("0123456789 ") != std::string::npos; });
}

Result<void> check_names(const std::string &file, const std::vector<NamedPoint> &points) {
  std::set<std::string> seen;
  for (const NamedPoint &point : points) {
    if (!seen.insert(point.name).second) {
      return base::failure(file + ": two points are called \"" + point.name + "\"");
    }
  }
  return {};
}

// Numbers count as names if both lists contain the same numbers: Slicer numbers anatomical points, and users save them
// in different orders.
bool same_names(const std::vector<NamedPoint> &a, const std::vector<NamedPoint> &b) {
  std::multiset<std::string> names_a;
  std::multiset<std::string> names_b;
  for (const NamedPoint &point : a) {
    names_a.insert(point.name);
  }
  for (const NamedPoint &point : b) {
    names_b.insert(point.name);
  }
  return names_a == names_b && std::set<std::string>(names_a.begin(), names_a.end()).size() == a.size();
}

// Pairs points by name if both lists have names, otherwise by order.
Result<std::vector<Pair>> make_pairs(const PointFile &source, const PointFile &target, const RegistrationFiles &files) {
  if (source.points.size() != target.points.size()) {
    return base::failure(files.source.path + " has " + std::to_string(source.points.size()) + " points, " +
                         files.target.path + " has " + std::to_string(target.points.size()) + ": they must be pairs");
  }
  const bool by_name =
      same_names(source.points, target.points) || (all_named(source.points) && all_named(target.points));
  if (by_name) {
    for (const auto &[file, points] : {std::pair(&files.source, &source), {&files.target, &target}}) {
      if (auto unique = check_names(file->path, points->points); !unique) {
        return tl::unexpected(unique.error());
      }
    }
  }
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < source.points.size(); ++i) {
    const NamedPoint &point = source.points[i];
    const auto other = by_name ? std::find_if(target.points.begin(), target.points.end(),
                                              [&](const NamedPoint &p) { return p.name == point.name; })
                               : target.points.begin() + static_cast<std::ptrdiff_t>(i);
    if (other == target.points.end()) {
      return base::failure(files.target.path + ": has no point \"" + point.name + "\"");
    }
    Pair pair{by_name ? point.name : std::to_string(i + 1), point.position_mm, other->position_mm};
    if (!source.covariances.empty()) {
      pair.source_covariance = source.covariances[i];
    }
    if (!target.covariances.empty()) {
      pair.target_covariance = target.covariances[static_cast<std::size_t>(other - target.points.begin())];
    }
    pairs.push_back(std::move(pair));
  }
  return pairs;
}

struct Registration {
  PairedFit fit;
  // Marks the points that disagree with the prediction of the consistent ones. Suspects are reported only if enough
  // points are consistent and the error is stated: an error estimated from the residuals cannot contradict them.
  RobustFit robust;
  double sigma_mm = 0.0;     // standard deviation per coordinate; root mean square if the points differ
  bool sigma_stated = false; // by the option or by the files
  bool left_out = false;     // the fit excludes the suspects
  double time_ms = 0.0;      // computing time of the estimate

  [[nodiscard]] bool contradicts() const { return sigma_stated && fit.p_value < kContradiction; }
  [[nodiscard]] bool suspect(std::size_t i) const { return sigma_stated && robust.found && !robust.inlier[i]; }
  [[nodiscard]] std::size_t suspects() const {
    return sigma_stated && robust.found ? static_cast<std::size_t>(robust.outliers) : 0;
  }
};

// Sets the covariances of each pair; returns the standard deviation per coordinate.
Registration weigh(std::vector<Pair> &pairs, const registration::PairedPose &start,
                   std::optional<double> stated_sigma) {
  Registration out;
  double squares = 0.0;
  double variances = 0.0;
  for (const Pair &pair : pairs) {
    squares += (start * pair.source - pair.target).squaredNorm();
    variances += pair.source_covariance.trace() + pair.target_covariance.trace();
  }
  const auto coordinates = static_cast<double>(3 * pairs.size());
  if (variances > 0.0) {
    out.sigma_stated = true;
    out.sigma_mm = std::sqrt(variances / coordinates);
    return out;
  }
  out.sigma_stated = stated_sigma.has_value();
  // Unbiased: the pose uses six of the 3n degrees of freedom. The lower bound gives exact copies a result.
  out.sigma_mm = stated_sigma.value_or(std::max(std::sqrt(squares / (coordinates - 6.0)), 1e-6));
  for (Pair &pair : pairs) {
    pair.target_covariance = out.sigma_mm * out.sigma_mm * Matrix3d::Identity();
  }
  return out;
}

tl::expected<Registration, std::string> solve(std::vector<Pair> pairs, const PointsArguments &arguments) {
  if (pairs.size() < 3 || pairs.size() > static_cast<std::size_t>(registration::kMaxFiducials)) {
    return tl::unexpected(arguments.files.source.path + " has " + std::to_string(pairs.size()) +
                          " points; 3 are needed, and at most " + std::to_string(registration::kMaxFiducials) +
                          " are taken");
  }
  std::vector<Vector3d> sources;
  std::vector<Vector3d> targets;
  for (const Pair &pair : pairs) {
    sources.push_back(pair.source);
    targets.push_back(pair.target);
  }
  const double spread = std::min(registration::spread_mm(sources)[1], registration::spread_mm(targets)[1]);
  const auto start = registration::fit_rigid(sources, targets);
  if (!start || spread < kMinSpread_mm) {
    return tl::unexpected("the points lie on a line (within " + fixed(spread, 1, "mm") +
                          "): the turn about it is not fixed");
  }
  Registration out = weigh(pairs, *start, arguments.sigma_mm);
  std::vector<registration::PointPair> weighted;
  for (const Pair &pair : pairs) {
    weighted.push_back({pair.source, pair.target, pair.source_covariance, pair.target_covariance});
  }
  const auto before = std::chrono::steady_clock::now();
  out.fit = registration::fit_paired(weighted);
  out.time_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - before).count();
  if (!out.fit.converged) {
    return tl::unexpected(std::string("the estimate did not converge"));
  }
  out.robust = registration::fit_paired_robust(weighted);
  if (arguments.leave_out_suspects && out.suspects() > 0) {
    out.fit = out.robust.fit;
    out.left_out = true;
  }
  return out;
}

// Formats a probability, which may be very small.
std::string scientific(double p) {
  std::array<char, 32> out{};
  std::snprintf(out.data(), out.size(), "%.1e", p);
  return p < 1e-300 ? "below 1e-300" : out.data();
}

std::string suspects_text(const Registration &r, const std::vector<Pair> &pairs) {
  std::string out;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (r.suspect(i)) {
      out += (out.empty() ? "\"" : ", \"") + printable(pairs[i].name) + "\" (" +
             fixed(r.robust.fit.fiducials[i].leave_one_out_mm, 2, "mm") +
             " from where the others predict it, probability " + scientific(r.robust.p_value[i]) + ")";
    }
  }
  return out;
}

std::string contradiction(const Registration &r, const std::vector<Pair> &pairs) {
  const std::string chance =
      "the residuals are too large for the stated error (probability " + scientific(r.fit.p_value) + ")";
  return r.suspects() > 0
             ? chance + ", and these points contradict the others: " + suspects_text(r, pairs)
             : chance + ": several points are wrong, or the error is larger; the residuals do not show which";
}

double tre_at(const Registration &r, const Vector3d &source_point) {
  const Vector3d point = r.fit.T_target_source * source_point;
  return uncertainty::rms_mm(uncertainty::tre_covariance(r.fit.covariance, point));
}

Vector3d centroid(const std::vector<Pair> &pairs) {
  Vector3d sum = Vector3d::Zero();
  for (const Pair &pair : pairs) {
    sum += pair.source;
  }
  return sum / static_cast<double>(pairs.size());
}

std::string to_text(const Registration &r, const std::vector<Pair> &pairs, const PointsArguments &arguments,
                    const std::vector<PointError> &errors) {
  std::string out = transforms_text(r.fit.T_target_source.matrix()) + "\n";
  Table table({"Point", "dx mm", "dy mm", "dz mm", "Residual mm", "Left out mm", "p", ""});
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const registration::FiducialFit &f = r.fit.fiducials[i];
    table.row({printable(pairs[i].name), fixed(f.residual_mm.x(), 3), fixed(f.residual_mm.y(), 3),
               fixed(f.residual_mm.z(), 3), fixed(f.norm_mm, 3), fixed(f.leave_one_out_mm, 3),
               r.sigma_stated ? fixed(f.p_value, 4) : "-",
               !r.suspect(i) ? ""
               : r.left_out  ? "left out"
                             : "suspect"});
  }
  out += table.text();
  if (r.suspects() > 0) {
    out += "\nSuspect: " + suspects_text(r, pairs) + (r.left_out ? "; left out\n" : "\n");
  }
  out += "\nFRE " + fixed(r.fit.fre_mm, 3, "mm") + " over " + std::to_string(r.fit.count) +
         " points: a figure of consistency, not of accuracy\n";
  out += "Error of a point " + fixed(r.sigma_mm, 3, "mm") + " (1 sigma per coordinate, " +
         (r.sigma_stated ? "as stated)\n" : "estimated from the residuals)\n");
  out += "Predicted TRE (RMS) at the centroid " + fixed(tre_at(r, centroid(pairs)), 3, "mm") + "\n";
  if (!arguments.at_mm.empty()) {
    const Vector3d at(arguments.at_mm.data());
    out += "Predicted TRE (RMS) at " + vector_text(at, 1) + " " + fixed(tre_at(r, at), 3, "mm") + "\n";
  }
  return out + errors_text(errors);
}

json to_json(const Registration &r, const std::vector<Pair> &pairs, const PointsArguments &arguments,
             const std::vector<PointError> &errors) {
  json points = json::array();
  json suspects = json::array();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const registration::FiducialFit &f = r.fit.fiducials[i];
    points.push_back({{"point", pairs[i].name},
                      {"residual_mm", json_vector(f.residual_mm)},
                      {"norm_mm", json_number(f.norm_mm)},
                      {"leave_one_out_mm", json_number(f.leave_one_out_mm)},
                      {"p_value", r.sigma_stated ? json_number(f.p_value) : json(nullptr)},
                      {"suspect", r.suspect(i)}});
    if (r.suspect(i)) {
      suspects.push_back({{"point", pairs[i].name},
                          {"p_value", json_number(r.robust.p_value[i])},
                          {"from_the_others_mm", json_number(r.robust.fit.fiducials[i].leave_one_out_mm)}});
    }
  }
  json out = transforms_json(r.fit.T_target_source.matrix(), arguments.files);
  add_covariance(out, r.fit.covariance);
  out.update({{"accepted", !r.contradicts()},
              {"verdict", r.contradicts() ? "refused" : "found"},
              {"reason", r.contradicts() ? contradiction(r, pairs) : ""},
              {"fre_mm", r.fit.fre_mm},
              {"sigma_mm", r.sigma_mm},
              {"sigma_estimated", !r.sigma_stated},
              {"p_value", r.sigma_stated ? json_number(r.fit.p_value) : json(nullptr)},
              {"tre_centroid_mm", tre_at(r, centroid(pairs))},
              {"time_ms", r.time_ms},
              {"points", std::move(points)},
              {"suspects", std::move(suspects)},
              {"suspects_left_out", r.left_out},
              {"targets", errors_json(errors)}});
  if (!arguments.at_mm.empty()) {
    out["tre_at_mm"] = tre_at(r, Vector3d(arguments.at_mm.data()));
  }
  return out;
}

int register_points(const PointsArguments &arguments, const Context &context) {
  const auto source = read_point_file(arguments.files.source.path, arguments.files.source.point_options());
  if (!source) {
    return fail(source.error());
  }
  const auto target = read_point_file(arguments.files.target.path, arguments.files.target.point_options());
  if (!target) {
    return fail(target.error());
  }
  const auto targets = read_targets(arguments.targets, arguments.files.target);
  if (!targets) {
    return fail(targets.error());
  }
  if (arguments.sigma_mm && !(source->covariances.empty() && target->covariances.empty())) {
    return fail("the files state the error of their points: --sigma-mm is for files that do not");
  }
  const auto pairs = make_pairs(*source, *target, arguments.files);
  if (!pairs) {
    return fail(pairs.error());
  }
  const auto solved = solve(*pairs, arguments);
  if (!solved) {
    return refuse("refused", solved.error(), context);
  }
  const auto errors = errors_at(*targets, solved->fit.covariance);
  if (context.json) {
    print_json(to_json(*solved, *pairs, arguments, errors));
  } else {
    print(to_text(*solved, *pairs, arguments, errors));
  }
  if (!solved->contradicts()) {
    return write_tfm(arguments.files, solved->fit.T_target_source.matrix());
  }
  if (!context.json) {
    static_cast<void>(fail("refused: " + contradiction(*solved, *pairs)));
  }
  return kRefused;
}

} // namespace

void add_register_points(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("points", "Registers two lists of points that are in files");
  auto arguments = std::make_shared<PointsArguments>();
  add_registration_files(*command, arguments->files, "source",
                         "Points to map: .csv (name,x,y,z and perhaps their errors), .mrk.json or .fcsv", "target",
                         "The same points in the target; paired by name, otherwise by order");
  command
      ->add_option("--sigma-mm", arguments->sigma_mm, "Error of a point, 1 sigma per coordinate, both lists combined")
      ->check(CLI::Range(1e-4, 100.0));
  command->add_flag("--leave-out-suspects", arguments->leave_out_suspects,
                    "Register with the points that agree within their stated error; the others are named");
  command->add_option("--at", arguments->at_mm, "A point in source coordinates to predict the TRE at")
      ->expected(3)
      ->type_name("X Y Z");
  command->add_option("--targets", arguments->targets, "Points in target coordinates to predict the TRE at");
  add_json_flag(*command, context);
  command->footer("Slicer's files are converted to RAS, .csv is taken as RAS. Errors in a .csv file: "
                  "name,x,y,z,sx,sy,sz (1 sigma) or\n"
                  "name,x,y,z,cxx,cxy,cxz,cyy,cyz,czz (covariance), mm.\n\nExamples:\n"
                  "  bregma register points touched.csv fiducials.mrk.json --targets lesion.mrk.json\n"
                  "  bregma register points touched.csv fiducials.mrk.json --sigma-mm 0.3 --tfm patient_to_image.tfm\n"
                  "  bregma register points a.csv b.csv --sigma-mm 0.3 --at 10 -20 35 --json");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return register_points(*arguments, context); }; });
}

} // namespace bregma::cli
