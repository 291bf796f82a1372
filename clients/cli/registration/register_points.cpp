// `bregma register points`: rigid registration of two lists of points in files.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "algorithms/registration/points/explanations.hpp"
#include "algorithms/registration/points/robust_points.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "casefile/length_unit.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/registration/point_pairs.hpp"
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
// Root mean square distance with which people place anatomical landmarks in images. Two raters of AFIDs-HCP are within
// it (RegisterPoints.TwoRatersOfTheSameHeadAgree).
constexpr double kPlacement_mm = 3.0;
// A relation that leaves this fraction of the FRE explains the pairs, whatever their stated error.
constexpr double kExplains = 0.2;
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
  bool by_order = false;
  double max_fre_mm = kPlacement_mm; // for points without a stated error
};

struct Pair {
  std::string name;
  Vector3d source, target;
  Matrix3d source_covariance = Matrix3d::Zero();
  Matrix3d target_covariance = Matrix3d::Zero();
};

std::vector<Pair> pairs_of(const Pairing &pairing, const PointFile &source, const PointFile &target) {
  std::vector<Pair> out;
  for (const Pairing::Pair &pair : pairing.pairs) {
    Pair &added = out.emplace_back(
        Pair{pair.name, source.points[pair.source].position_mm, target.points[pair.target].position_mm});
    if (!source.covariances.empty()) {
      added.source_covariance = source.covariances[pair.source];
    }
    if (!target.covariances.empty()) {
      added.target_covariance = target.covariances[pair.target];
    }
  }
  return out;
}

// What is registered: the files as read.
struct Input {
  std::vector<Pair> pairs;
  std::size_t source_count = 0, target_count = 0;
  std::vector<NamedPoint> targets;
  std::vector<std::string> notes;

  [[nodiscard]] std::vector<Vector3d> points(Vector3d Pair::*side) const {
    std::vector<Vector3d> out;
    std::transform(pairs.begin(), pairs.end(), std::back_inserter(out), [side](const Pair &p) { return p.*side; });
    return out;
  }
};

struct Registration {
  PairedFit fit;
  // Marks the points that disagree with the prediction of the consistent ones. Suspects are reported only if enough
  // points are consistent and the error is stated: an error estimated from the residuals cannot contradict them.
  RobustFit robust;
  double sigma_mm = 0.0;     // standard deviation per coordinate; root mean square if the points differ
  bool sigma_stated = false; // by the option or by the files
  bool left_out = false;     // the fit excludes the suspects
  double time_ms = 0.0;      // computing time of the estimate
  std::string refusal;       // empty: found

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

tl::expected<Registration, std::string> solve(Input &input, const PointsArguments &arguments) {
  std::vector<Pair> &pairs = input.pairs;
  if (pairs.size() < 3 || pairs.size() > static_cast<std::size_t>(registration::kMaxPairs)) {
    return tl::unexpected("3 pairs of points are needed and at most " + std::to_string(registration::kMaxPairs) +
                          " are taken, there are " + std::to_string(pairs.size()));
  }
  const std::vector<Vector3d> sources = input.points(&Pair::source);
  const std::vector<Vector3d> targets = input.points(&Pair::target);
  const Vector3d source_spread_mm = registration::spread_mm(sources);
  const Vector3d target_spread_mm = registration::spread_mm(targets);
  const double spread = std::min(source_spread_mm[1], target_spread_mm[1]);
  // Lists of different size are not narrow but in different units, which the explanation of their residuals says.
  const double ratio = target_spread_mm.norm() / source_spread_mm.norm();
  const bool same_size = ratio > 0.5 && ratio < 2.0;
  const auto start = registration::fit_rigid(sources, targets);
  if (!start || (spread < kMinSpread_mm && same_size)) {
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
  return r.suspects() > 0 ? chance + ", and these points contradict the others: " + suspects_text(r, pairs) : chance;
}

// "the source is in cm and the target in mm", for the ratio of their lengths.
std::string scale_text(double scale, const InputFile &source, const InputFile &target) {
  struct Factor {
    double value;
    const char *unit; // of the side with the smaller numbers; empty: no unit explains it
  };
  constexpr std::array<Factor, 4> kFactors{{{10.0, "cm"}, {25.4, ""}, {100.0, ""}, {1000.0, "m"}}};
  const bool source_smaller = scale > 1.0;
  const double factor = source_smaller ? scale : 1.0 / scale;
  const InputFile &smaller = source_smaller ? source : target;
  const std::string lengths = "the lengths in " + (source_smaller ? target : source).path + " are " + fixed(factor, 3) +
                              " times those in " + smaller.path;
  for (const Factor &known : kFactors) {
    if (std::abs(factor / known.value - 1.0) < 0.05) {
      return "scale " + fixed(known.value, known.value == 25.4 ? 1 : 0) + ": " + lengths +
             (known.unit[0] != '\0'
                  ? "; if it is in " + std::string(known.unit) + ", say --" + smaller.side + "-units " + known.unit
              : known.value == 25.4 ? "; inches are not read"
                                    : "");
    }
  }
  return "scale " + fixed(scale, 3) + ": " + lengths;
}

std::string names_of(const std::vector<Pair> &pairs, const std::vector<std::size_t> &indices) {
  std::string out;
  for (const std::size_t i : indices) {
    out += (out.empty() ? "\"" : ", \"") + printable(pairs[i].name) + "\"";
  }
  return out;
}

std::string order_text(const std::vector<Pair> &pairs, const std::vector<std::size_t> &order) {
  std::string out;
  std::size_t moved = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (order[i] != i && ++moved <= 8) {
      out += (out.empty() ? "\"" : ", \"") + printable(pairs[i].name) + "\" to \"" + printable(pairs[order[i]].name) +
             "\"";
    }
  }
  return out + (moved > 8 ? " and " + std::to_string(moved - 8) + " more" : "");
}

// What would explain the pairs instead; empty: nothing that was tried.
std::string explanations_text(const Input &input, const PointsArguments &arguments, double limit_mm) {
  const std::vector<Vector3d> sources = input.points(&Pair::source);
  const std::vector<Vector3d> targets = input.points(&Pair::target);
  std::string out;
  for (const registration::Explanation &one : registration::explain(sources, targets, limit_mm)) {
    using Kind = registration::Explanation::Kind;
    const std::string what =
        one.kind == Kind::kMirrored
            ? "one list is the mirror image of the other: are both in the space that is assumed?"
        : one.kind == Kind::kScaled    ? scale_text(one.scale, arguments.files.source, arguments.files.target)
        : one.kind == Kind::kReordered ? "another order: " + order_text(input.pairs, one.indices)
                                       : "wrong: " + names_of(input.pairs, one.indices) +
                                             (one.indices.size() == 1 ? " does" : " do") + " not belong to the others";
    out += "; explained by " + what + " (then FRE " + fixed(one.rms_mm, 3, "mm") + ")";
  }
  return out;
}

// The reason for which the registration must not be used; empty: none.
std::string refusal_of(const Registration &r, const Input &input, const PointsArguments &arguments) {
  const double limit_mm =
      r.sigma_stated ? std::max(kPlacement_mm, 2.0 * std::sqrt(3.0) * r.sigma_mm) : arguments.max_fre_mm;
  if (r.contradicts()) {
    const std::string other = explanations_text(input, arguments, limit_mm);
    return contradiction(r, input.pairs) +
           (r.suspects() == 0 && other.empty()
                ? ": several points are wrong, or the error is larger; the residuals do not show which"
                : other);
  }
  if (r.sigma_stated) {
    // An error that is stated as large explains whatever the pairs are.
    const double other_mm = kExplains * r.fit.fre_mm;
    const std::string other =
        r.fit.fre_mm > kPlacement_mm ? explanations_text(input, arguments, other_mm) : std::string();
    return other.empty() ? other
                         : "FRE " + fixed(r.fit.fre_mm, 3, "mm") +
                               " is within the stated error, but is not an error of placing points" + other;
  }
  if (!(r.fit.fre_mm <= arguments.max_fre_mm)) {
    const std::string other = explanations_text(input, arguments, limit_mm);
    return "FRE " + fixed(r.fit.fre_mm, 3, "mm") + ": people place points within " +
           fixed(arguments.max_fre_mm, 1, "mm") + " (--max-fre-mm)" +
           (other.empty() ? "; neither a mirror image, a scale, another order nor one or two wrong "
                            "pairs explain it"
                          : other);
  }
  const auto odd =
      registration::find_odd_pair(input.points(&Pair::source), input.points(&Pair::target), arguments.max_fre_mm);
  return odd ? "\"" + printable(input.pairs[odd->index].name) + "\" is " + fixed(odd->from_the_others_mm, 2, "mm") +
                   " from where the others predict it, which their residuals exclude: is it the same point in both "
                   "lists?"
             : "";
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

std::string residuals_text(const Registration &r, const std::vector<Pair> &pairs) {
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
  return table.text();
}

std::string to_text(const Registration &r, const Input &input, const PointsArguments &arguments,
                    const std::vector<PointError> &errors) {
  const std::vector<Pair> &pairs = input.pairs;
  std::string out = transforms_text(r.fit.T_target_source.matrix()) + "\n" + residuals_text(r, pairs);
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

// Of a refused registration nothing that could be used: null.
json to_json(const Registration &r, const Input &input, const PointsArguments &arguments,
             const std::vector<PointError> &errors) {
  const std::vector<Pair> &pairs = input.pairs;
  const bool found = r.refusal.empty();
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
  out.update({{"accepted", found},
              {"verdict", found ? "found" : "refused"},
              {"reason", r.refusal},
              {"notes", input.notes},
              {"points_read", {{"source", input.source_count}, {"target", input.target_count}}},
              {"fre_mm", json_number(r.fit.fre_mm)},
              {"sigma_mm", json_number(r.sigma_mm)},
              {"sigma_estimated", !r.sigma_stated},
              {"p_value", r.sigma_stated ? json_number(r.fit.p_value) : json(nullptr)},
              {"tre_centroid_mm", json_number(tre_at(r, centroid(pairs)))},
              {"time_ms", r.time_ms},
              {"points", std::move(points)},
              {"suspects", std::move(suspects)},
              {"suspects_left_out", r.left_out},
              {"targets", errors_json(errors)}});
  if (!arguments.at_mm.empty()) {
    out["tre_at_mm"] = json_number(tre_at(r, Vector3d(arguments.at_mm.data())));
  }
  if (!found) {
    withhold_pose(out);
    withhold(out, {"tre_centroid_mm"});
    if (out.contains("tre_at_mm")) {
      withhold(out, {"tre_at_mm"});
    }
  }
  return out;
}

// A target far from the points is in another unit or space. Only distances that no body has are refused.
Result<void> check_targets(const std::string &file, const std::vector<NamedPoint> &targets,
                           const std::vector<Pair> &pairs) {
  constexpr double kFarthest_mm = 1000.0;
  for (const NamedPoint &target : targets) {
    for (const Pair &pair : pairs) {
      if (const double distance = (target.position_mm - pair.target).norm(); distance > kFarthest_mm) {
        return base::failure(file + ": \"" + target.name + "\" is " + fixed(1e-3 * distance, 1, "m") + " from \"" +
                             pair.name + "\": is it in another unit or space?");
      }
    }
  }
  return {};
}

// Within 1 m a target may still be in another unit or space: most lie amid the points, or nearly.
std::vector<std::string> notes_of_far_targets(const std::string &file, const std::vector<NamedPoint> &targets,
                                              const std::vector<Pair> &pairs) {
  std::vector<std::string> out;
  std::vector<Vector3d> around;
  std::transform(pairs.begin(), pairs.end(), std::back_inserter(around), [](const Pair &pair) { return pair.target; });
  const double width = casefile::width_mm(around);
  for (const NamedPoint &target : targets) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Vector3d &point : around) {
      nearest = std::min(nearest, (target.position_mm - point).norm());
    }
    if (nearest > width) {
      out.push_back(file + ": \"" + target.name + "\" is " + fixed(nearest, 0, "mm") +
                    " from the nearest of the points, which are " + fixed(width, 0, "mm") +
                    " wide: is it in another unit or space?");
    }
  }
  return out;
}

Result<Input> read_input(const PointsArguments &arguments) {
  const RegistrationFiles &files = arguments.files;
  const auto source = read_point_file(files.source.path, files.source.point_options());
  if (!source) {
    return tl::unexpected(source.error());
  }
  const auto target = read_point_file(files.target.path, files.target.point_options());
  if (!target) {
    return tl::unexpected(target.error());
  }
  if (arguments.sigma_mm && !(source->covariances.empty() && target->covariances.empty())) {
    return base::failure("the files state the error of their points: --sigma-mm is for files that do not");
  }
  auto targets = read_targets(arguments.targets, files.target);
  if (!targets) {
    return tl::unexpected(targets.error());
  }
  const auto pairing = pair_points({files.source.path, &*source}, {files.target.path, &*target}, arguments.by_order);
  if (!pairing) {
    return tl::unexpected(pairing.error());
  }
  Input out{pairs_of(*pairing, *source, *target), source->points.size(), target->points.size(),
            std::move(targets->points), joined({source->notes, target->notes, targets->notes, pairing->notes})};
  return check_targets(arguments.targets, out.targets, out.pairs).map([&] {
    out.notes = joined({out.notes, notes_of_far_targets(arguments.targets, out.targets, out.pairs)});
    return std::move(out);
  });
}

int register_points(const PointsArguments &arguments, const Context &context) {
  if (auto kept = check_output("--tfm", arguments.files.tfm,
                               {arguments.files.source.path, arguments.files.target.path, arguments.targets});
      !kept) {
    return fail(kept.error());
  }
  auto input = read_input(arguments);
  if (!input) {
    return fail(input.error());
  }
  auto solved = solve(*input, arguments);
  if (!solved) {
    return refuse_registration("refused", solved.error(), context);
  }
  solved->refusal = refusal_of(*solved, *input, arguments);
  if (registration::are_coplanar(input->points(&Pair::source))) {
    input->notes.emplace_back("the points lie in a plane (within 3 mm): they fit their own mirror image, so a mirrored "
                              "list would not be noticed");
  }
  const auto errors = errors_at(input->targets, solved->fit.covariance);
  if (context.json) {
    print_json(to_json(*solved, *input, arguments, errors));
  } else {
    print_notes(input->notes);
    print("Read " + std::to_string(input->source_count) + " points from " + printable(arguments.files.source.path) +
          " and " + std::to_string(input->target_count) + " from " + printable(arguments.files.target.path) + "\n\n");
    print(solved->refusal.empty() ? to_text(*solved, *input, arguments, errors)
                                  : residuals_text(*solved, input->pairs));
  }
  if (solved->refusal.empty()) {
    return write_tfm(arguments.files, solved->fit.T_target_source.matrix());
  }
  if (!context.json) {
    static_cast<void>(fail("refused: " + solved->refusal));
  }
  return kRefused;
}

} // namespace

void add_register_points(CLI::App &parent, Context &context) {
  auto *command = parent.add_subcommand("points", "Registers two lists of points that are in files");
  auto arguments = std::make_shared<PointsArguments>();
  add_registration_files(*command, arguments->files, "source",
                         "Points to map: a table (.csv: name,x,y,z and perhaps their errors), .mrk.json or .fcsv",
                         "target",
                         "The same points in the target; paired by name or number, by order if they have no names");
  command
      ->add_option("--sigma-mm", arguments->sigma_mm, "Error of a point, 1 sigma per coordinate, both lists combined")
      ->check(CLI::Range(1e-4, 100.0));
  command->add_flag("--leave-out-suspects", arguments->leave_out_suspects,
                    "Register with the points that agree within their stated error; the others are named");
  command->add_flag("--by-order", arguments->by_order, "Pair the points by their order, whatever their names");
  command
      ->add_option("--max-fre-mm", arguments->max_fre_mm,
                   "Refuse a larger FRE of points whose error is not stated: people place landmarks within 3 mm (RMS)")
      ->check(CLI::Range(1e-4, 100.0))
      ->capture_default_str();
  command->add_option("--at", arguments->at_mm, "A point in source coordinates to predict the TRE at")
      ->expected(3)
      ->type_name("X Y Z");
  command->add_option("--targets", arguments->targets, "Points in target coordinates to predict the TRE at");
  add_json_flag(*command, context);
  command->footer("Slicer's files state their space. The columns of a table are read by name: name, x y z (RAS unless "
                  "said\notherwise), r a s or l p s, and perhaps sx sy sz (1 sigma) or cxx cxy cxz cyy cyz czz "
                  "(covariance).\n\nExamples:\n"
                  "  bregma register points touched.csv fiducials.mrk.json --targets lesion.mrk.json\n"
                  "  bregma register points touched.csv fiducials.mrk.json --sigma-mm 0.3 --tfm patient_to_image.tfm\n"
                  "  bregma register points a.csv b.csv --sigma-mm 0.3 --at 10 -20 35 --json");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return register_points(*arguments, context); }; });
}

} // namespace bregma::cli
