#include "clients/cli/register_points.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/registration/paired_points.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/point_file.hpp"

namespace bregma::cli {

namespace {

using casefile::NamedPoint;
using casefile::Result;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using nlohmann::json;
using registration::PairedFit;

// Below it the turn about the line of the points is as good as free.
constexpr double kMinSpread_mm = 3.0;
// The chance that good points look as bad as these; below it the stated error or a point is wrong.
constexpr double kContradiction = 0.001;

struct Pair {
  std::string name;
  Vector3d source, target;
};

bool all_named(const std::vector<NamedPoint> &points) {
  return std::all_of(points.begin(), points.end(),
                     [](const NamedPoint &p) { return p.name.find_first_not_of("0123456789 ") != std::string::npos; });
}

// By name where both lists have names, else by order.
Result<std::vector<Pair>> make_pairs(const std::vector<NamedPoint> &source, const std::vector<NamedPoint> &target,
                                     const RegisterPointsArguments &arguments) {
  if (source.size() != target.size()) {
    return casefile::failure(arguments.source + " has " + std::to_string(source.size()) + " points, " +
                             arguments.target + " has " + std::to_string(target.size()) + ": they must be pairs");
  }
  const bool by_name = all_named(source) && all_named(target);
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < source.size(); ++i) {
    const auto other = by_name ? std::find_if(target.begin(), target.end(),
                                              [&](const NamedPoint &p) { return p.name == source[i].name; })
                               : target.begin() + static_cast<std::ptrdiff_t>(i);
    if (other == target.end()) {
      return casefile::failure(arguments.target + ": has no point \"" + source[i].name + "\"");
    }
    pairs.push_back({by_name ? source[i].name : std::to_string(i + 1), source[i].position_mm, other->position_mm});
  }
  return pairs;
}

struct Registration {
  PairedFit fit;
  double sigma_mm = 0.0;
  bool sigma_stated = false;
  [[nodiscard]] bool contradicts() const { return sigma_stated && fit.p_value < kContradiction; }
};

// A sentence when the points allow no answer.
tl::expected<Registration, std::string> solve(const std::vector<Pair> &pairs, std::optional<double> stated_sigma) {
  if (pairs.size() < 3 || pairs.size() > static_cast<std::size_t>(registration::kMaxFiducials)) {
    return tl::unexpected("refused: " + std::to_string(pairs.size()) + " points; 3 are needed, and at most " +
                          std::to_string(registration::kMaxFiducials) + " are taken");
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
    return tl::unexpected("refused: the points lie on a line (within " + fixed(spread, 1, "mm") +
                          "): the turn about it is not fixed");
  }
  double squares = 0.0;
  for (const Pair &pair : pairs) {
    squares += (*start * pair.source - pair.target).squaredNorm();
  }
  Registration out;
  out.sigma_stated = stated_sigma.has_value();
  // Unbiased: six of the 3n coordinates are spent on the pose. Not zero, so that exact copies have an answer.
  out.sigma_mm = stated_sigma.value_or(std::max(std::sqrt(squares / static_cast<double>(3 * pairs.size() - 6)), 1e-6));
  std::vector<registration::PointPair> weighted;
  const Matrix3d covariance = out.sigma_mm * out.sigma_mm * Matrix3d::Identity();
  for (const Pair &pair : pairs) {
    weighted.push_back({pair.source, pair.target, Matrix3d::Zero(), covariance});
  }
  out.fit = registration::fit_paired(weighted);
  if (!out.fit.converged) {
    return tl::unexpected(std::string("refused: the estimate did not converge"));
  }
  return out;
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

std::string matrix_text(const char *name, const Eigen::Matrix4d &m) {
  std::string out = std::string(name) + "\n";
  Table table({"", "", "", ""});
  for (Eigen::Index i = 0; i < 4; ++i) {
    table.row({fixed(m(i, 0), 6), fixed(m(i, 1), 6), fixed(m(i, 2), 6), fixed(m(i, 3), 4)});
  }
  return out + table.text().substr(1);
}

std::string to_text(const Registration &r, const std::vector<Pair> &pairs, const RegisterPointsArguments &arguments) {
  std::string out = matrix_text("T_target_source", r.fit.T_target_source.matrix()) + "\n" +
                    matrix_text("T_source_target", r.fit.T_target_source.inverse().matrix()) + "\n";
  Table table({"Point", "dx mm", "dy mm", "dz mm", "Residual mm", "Left out mm", "p"});
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const registration::FiducialFit &f = r.fit.fiducials[i];
    table.row({pairs[i].name, fixed(f.residual_mm.x(), 3), fixed(f.residual_mm.y(), 3), fixed(f.residual_mm.z(), 3),
               fixed(f.norm_mm, 3), fixed(f.leave_one_out_mm, 3), r.sigma_stated ? fixed(f.p_value, 4) : "-"});
  }
  out += table.text();
  out += "\nFRE " + fixed(r.fit.fre_mm, 3, "mm") + " over " + std::to_string(pairs.size()) +
         " points: a figure of consistency, not of accuracy\n";
  out += "Error of a point " + fixed(r.sigma_mm, 3, "mm") + " (1 sigma a coordinate, " +
         (r.sigma_stated ? "as stated)\n" : "estimated from the residuals)\n");
  out += "Predicted TRE (RMS) at the centroid " + fixed(tre_at(r, centroid(pairs)), 3, "mm") + "\n";
  if (!arguments.at_mm.empty()) {
    const Vector3d at(arguments.at_mm.data());
    out += "Predicted TRE (RMS) at " + vector_text(at, 1) + " " + fixed(tre_at(r, at), 3, "mm") + "\n";
  }
  return out;
}

json to_json(const Registration &r, const std::vector<Pair> &pairs, const RegisterPointsArguments &arguments) {
  json points = json::array();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const registration::FiducialFit &f = r.fit.fiducials[i];
    points.push_back({{"point", pairs[i].name},
                      {"residual_mm", json_vector(f.residual_mm)},
                      {"norm_mm", json_number(f.norm_mm)},
                      {"leave_one_out_mm", json_number(f.leave_one_out_mm)},
                      {"p_value", r.sigma_stated ? json_number(f.p_value) : json(nullptr)}});
  }
  json out = {{"accepted", !r.contradicts()},
              {"T_target_source", json_matrix(r.fit.T_target_source.matrix())},
              {"T_source_target", json_matrix(r.fit.T_target_source.inverse().matrix())},
              {"covariance", json_matrix(r.fit.covariance)},
              {"covariance_order", "rotation (rad), translation (mm); left perturbation in the target frame"},
              {"fre_mm", r.fit.fre_mm},
              {"sigma_mm", r.sigma_mm},
              {"sigma_estimated", !r.sigma_stated},
              {"p_value", r.sigma_stated ? json_number(r.fit.p_value) : json(nullptr)},
              {"tre_centroid_mm", tre_at(r, centroid(pairs))},
              {"points", std::move(points)}};
  if (!arguments.at_mm.empty()) {
    out["tre_at_mm"] = tre_at(r, Vector3d(arguments.at_mm.data()));
  }
  return out;
}

} // namespace

int register_points(const RegisterPointsArguments &arguments, const Context &context) {
  const auto source = read_point_file(arguments.source);
  if (!source) {
    return fail(source.error());
  }
  const auto target = read_point_file(arguments.target);
  if (!target) {
    return fail(target.error());
  }
  const auto pairs = make_pairs(*source, *target, arguments);
  if (!pairs) {
    return fail(pairs.error());
  }
  const auto solved = solve(*pairs, arguments.sigma_mm);
  if (!solved) {
    if (context.json) {
      print_json({{"accepted", false}, {"text", solved.error()}});
    } else {
      static_cast<void>(fail(solved.error()));
    }
    return kRefused;
  }
  if (context.json) {
    print_json(to_json(*solved, *pairs, arguments));
  } else {
    print(to_text(*solved, *pairs, arguments));
  }
  if (!solved->contradicts()) {
    return kOk;
  }
  if (!context.json) {
    static_cast<void>(fail("refused: the residuals are too large for the stated error (chance " +
                           fixed(solved->fit.p_value, 6) + "): a point is wrong, or the error is larger"));
  }
  return kRefused;
}

} // namespace bregma::cli
