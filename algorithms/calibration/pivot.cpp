#include "algorithms/calibration/pivot.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <map>
#include <optional>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "algorithms/calibration/rotation_spread.hpp"
#include "algorithms/geometry/angles.hpp"
#include "algorithms/geometry/unknown.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::calibration {

namespace {

using geometry::Matrix3d;
using geometry::Vector3d;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// Median of |e| when each coordinate has sigma one (root of the median of chi-square with 3 degrees of freedom).
const double kMedianOfNorm = std::sqrt(uncertainty::chi_square_upper_quantile(0.5, 3));
// Zero of the biweight, in sigmas of a coordinate. It is wide on purpose. The errors of real pivots are systematic: the
// tip creeps, and the tracker's error depends on the region. An estimate that redescends at the usual 5 to 6 sigmas
// locks on to one part of the recording; the halves of the public recording then disagree far beyond their covariance.
// At 14 only gross errors lose their weight.
constexpr double kBiweightReach = 14.0;
constexpr double kOutlierReach = 4.0; // exceeded by 0.1 % of normal errors
constexpr int kMaxIterations = 50;
constexpr double kConverged_mm = 1e-7;

constexpr std::size_t kBlocks = 16;
// The 95 % bound of Hotelling's T-square of 3 variables and kBlocks - 1 degrees of freedom (11.81) over that of
// chi-square (7.81).
const double kFewBlocks =
    uncertainty::hotelling_upper_quantile(0.05, 3, kBlocks - 1) / uncertainty::chi_square_upper_quantile(0.05, 3);

constexpr unsigned kSeed = 5;
constexpr int kStarts = 150;
constexpr std::size_t kStartPoses = 8;

// Below it the tool was not moved: the rest is the tracker's noise.
constexpr double kStatic_rad = 0.05;

struct Sample {
  Matrix3d R;
  Vector3d t; // relative to the centroid, so that the tracker's distance costs no precision
};

struct Estimate {
  Vector3d tip = Vector3d::Constant(geometry::kUnknown);
  Vector3d pivot = Vector3d::Constant(geometry::kUnknown);
  [[nodiscard]] double error(const Sample &s) const { return (s.R * tip + s.t - pivot).norm(); }
  [[nodiscard]] bool valid() const { return tip.allFinite() && pivot.allFinite(); }
};

class PivotProblem {
public:
  explicit PivotProblem(std::span<const PivotPose> poses) {
    for (const PivotPose &pose : poses) {
      centre_ += pose.T_fixed_tool.translation() / static_cast<double>(poses.size());
    }
    samples_.reserve(poses.size());
    for (const PivotPose &pose : poses) {
      samples_.push_back({pose.T_fixed_tool.rotation_matrix(), pose.T_fixed_tool.translation() - centre_});
    }
    errors_.resize(poses.size());
    weights_.assign(poses.size(), 1.0);
  }

  [[nodiscard]] std::size_t size() const { return samples_.size(); }
  [[nodiscard]] Vector3d pivot_in_fixed_frame(const Estimate &e) const { return e.pivot + centre_; }

  // Rows [R, -I] of the linear system, weighted; not finite where the poses do not determine the tip.
  [[nodiscard]] Estimate least_squares(std::span<const double> weights) const {
    Matrix6d normal = Matrix6d::Zero();
    Vector6d right = Vector6d::Zero();
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      add(samples_[i], weights[i], normal, right);
    }
    return solve(normal, right);
  }

  // Least median of squares over a fixed series of small random subsets.
  [[nodiscard]] Estimate robust_start() {
    std::fill(weights_.begin(), weights_.end(), 1.0);
    Estimate best = least_squares(weights_);
    double best_sigma = sigma(best, 0, 0);
    std::mt19937 rng(kSeed);
    std::uniform_int_distribution<std::size_t> any(0, samples_.size() - 1);
    for (int start = 0; start < kStarts; ++start) {
      Matrix6d normal = Matrix6d::Zero();
      Vector6d right = Vector6d::Zero();
      for (std::size_t i = 0; i < kStartPoses; ++i) {
        add(samples_[any(rng)], 1.0, normal, right);
      }
      const Estimate candidate = solve(normal, right);
      if (!candidate.valid()) {
        continue;
      }
      if (const double candidate_sigma = sigma(candidate, 0, 0); candidate_sigma < best_sigma) {
        best_sigma = candidate_sigma;
        best = candidate;
      }
    }
    return best;
  }

  // Reweighted least squares from a start, without the samples [skip_from, skip_to).
  [[nodiscard]] Estimate robust(Estimate estimate, std::size_t skip_from, std::size_t skip_to) {
    for (int i = 0; i < kMaxIterations && estimate.valid(); ++i) {
      const double reach = kBiweightReach * sigma(estimate, skip_from, skip_to);
      if (!(reach > 0.0)) {
        break; // at least half of the poses fit without any error
      }
      for (std::size_t k = 0; k < samples_.size(); ++k) {
        const double u = estimate.error(samples_[k]) / reach;
        const double keep = std::max(0.0, 1.0 - u * u);
        weights_[k] = k >= skip_from && k < skip_to ? 0.0 : keep * keep;
      }
      const Estimate next = least_squares(weights_);
      const double step = (next.tip - estimate.tip).norm();
      estimate = next;
      if (step < kConverged_mm) {
        break;
      }
    }
    return estimate;
  }

  // Robust sigma of one coordinate of the errors.
  [[nodiscard]] double sigma(const Estimate &estimate, std::size_t skip_from, std::size_t skip_to) {
    if (!estimate.valid()) {
      return std::numeric_limits<double>::infinity();
    }
    std::size_t count = 0;
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      if (i < skip_from || i >= skip_to) {
        errors_[count++] = estimate.error(samples_[i]);
      }
    }
    const auto middle = errors_.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(errors_.begin(), middle, errors_.begin() + static_cast<std::ptrdiff_t>(count));
    return *middle / kMedianOfNorm;
  }

  // RMS and maximum of the errors up to a bound, and the number beyond it.
  struct Errors {
    double rms = 0.0, worst = 0.0;
    std::size_t beyond = 0;
  };
  [[nodiscard]] Errors errors(const Estimate &estimate, double bound) const {
    Errors out;
    double sum = 0.0;
    for (const Sample &sample : samples_) {
      const double error = estimate.error(sample);
      out.worst = std::max(out.worst, error);
      if (error > bound) {
        ++out.beyond;
      } else {
        sum += error * error;
      }
    }
    out.rms = std::sqrt(sum / static_cast<double>(samples_.size() - out.beyond));
    return out;
  }

private:
  static void add(const Sample &s, double weight, Matrix6d &normal, Vector6d &right) {
    normal.topLeftCorner<3, 3>().diagonal().array() += weight;
    normal.bottomRightCorner<3, 3>().diagonal().array() += weight;
    normal.topRightCorner<3, 3>() -= weight * s.R.transpose();
    normal.bottomLeftCorner<3, 3>() -= weight * s.R;
    right.head<3>() -= weight * (s.R.transpose() * s.t);
    right.tail<3>() += weight * s.t;
  }

  static Estimate solve(const Matrix6d &normal, const Vector6d &right) {
    const Eigen::LDLT<Matrix6d> factors(normal);
    const auto pivots = factors.vectorD().cwiseAbs();
    if (!(pivots.minCoeff() > 1e-9 * pivots.maxCoeff())) {
      return {};
    }
    const Vector6d x = factors.solve(right);
    return {x.head<3>(), x.tail<3>()};
  }

  Vector3d centre_ = Vector3d::Zero();
  std::vector<Sample> samples_;
  std::vector<double> errors_;
  std::vector<double> weights_;
};

// Ranges about the two widest axes.
std::array<double, 2> widest_rotations(std::span<const PivotPose> poses) {
  std::vector<Eigen::Quaterniond> rotations;
  rotations.reserve(poses.size());
  for (const PivotPose &pose : poses) {
    rotations.push_back(pose.T_fixed_tool.rotation());
  }
  const auto ranges = rotation_ranges(rotations);
  return {ranges[0], ranges[1]};
}

Matrix3d jackknife_covariance(PivotProblem &problem, const Estimate &estimate) {
  std::array<Vector3d, kBlocks> tips;
  Vector3d mean = Vector3d::Zero();
  for (std::size_t b = 0; b < kBlocks; ++b) {
    const std::size_t from = b * problem.size() / kBlocks;
    const std::size_t to = (b + 1) * problem.size() / kBlocks;
    tips[b] = problem.robust(estimate, from, to).tip;
    mean += tips[b] / static_cast<double>(kBlocks);
  }
  Matrix3d covariance = Matrix3d::Zero();
  for (const Vector3d &tip : tips) {
    covariance += (tip - mean) * (tip - mean).transpose();
  }
  constexpr double kJackknife = static_cast<double>(kBlocks - 1) / static_cast<double>(kBlocks);
  return kFewBlocks * kJackknife * covariance;
}

// In the order of time, without those that are closer to an earlier one than both bounds. A grid of the positions keeps
// the comparisons few.
std::vector<PivotPose> apart(std::span<const PivotPose> poses, double turn_rad, double distance_mm) {
  using Cell = std::array<std::int64_t, 3>;
  const auto cell_of = [distance_mm](const Vector3d &t) {
    Cell out{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      out[axis] = std::llround(std::floor(std::clamp(t[static_cast<Eigen::Index>(axis)] / distance_mm, -9e15, 9e15)));
    }
    return out;
  };
  std::vector<PivotPose> out;
  std::map<Cell, std::vector<std::size_t>> kept; // indices of out
  const auto has_neighbour = [&](const PivotPose &pose, const Cell &at) {
    for (int near = 0; near < 27; ++near) {
      const auto found = kept.find({at[0] + near % 3 - 1, at[1] + near / 3 % 3 - 1, at[2] + near / 9 - 1});
      if (found == kept.end()) {
        continue;
      }
      for (const std::size_t i : found->second) {
        const ToolPose &other = out[i].T_fixed_tool;
        if ((other.translation() - pose.T_fixed_tool.translation()).norm() <= distance_mm &&
            other.rotation().angularDistance(pose.T_fixed_tool.rotation()) <= turn_rad) {
          return true;
        }
      }
    }
    return false;
  };
  for (const PivotPose &pose : poses) {
    const Cell at = cell_of(pose.T_fixed_tool.translation());
    if (!has_neighbour(pose, at)) {
      kept[at].push_back(out.size());
      out.push_back(pose);
    }
  }
  return out;
}

// A pose that is sent again is no other pose, also where it was rounded on its way. None of the 1,151 poses of a real
// recording is as near to another one.
std::vector<PivotPose> without_repeats(std::span<const PivotPose> poses, const PivotOptions &options) {
  constexpr double kRounding_rad = 0.01 * geometry::kRadiansPerDegree;
  constexpr double kRounding = 0.08; // of the tracker's noise
  return apart(poses, kRounding_rad, kRounding * options.tracker_noise_mm);
}

// Places in which a tool rested, be it for many frames. A real recording of 1,151 poses has 1,117.
std::size_t places_of(std::span<const PivotPose> poses, const PivotOptions &options) {
  constexpr double kTurn_rad = 0.25 * geometry::kRadiansPerDegree;
  constexpr double kReach = 2.0; // in the tracker's noise
  return apart(poses, kTurn_rad, kReach * options.tracker_noise_mm).size();
}

template <class... Values> std::string format(const char *pattern, Values... values) {
  char buffer[256];
  std::snprintf(buffer, sizeof buffer, pattern, values...);
  return buffer;
}

struct Judgement {
  PivotVerdict verdict;
  std::string text;
};

// The reason why no estimate is possible; no result if one is.
std::optional<Judgement> judge_motion(const PivotResult &r, std::size_t places, const PivotOptions &options) {
  const double wide = r.rotation_rad[0] / geometry::kRadiansPerDegree;
  const double narrow = r.rotation_rad[1] / geometry::kRadiansPerDegree;
  if (r.poses + r.repeated >= options.min_poses && r.rotation_rad[0] < kStatic_rad) {
    return Judgement{PivotVerdict::kStatic,
                     format("refused: the tool was not moved (it turned by %.1f degrees)", wide)};
  }
  if (r.poses < options.min_poses) {
    const std::string repeats = r.repeated > 0 ? format(" different (%zu repeat an earlier one)", r.repeated) : "";
    return Judgement{PivotVerdict::kTooFewPoses, format("refused: %zu%s poses, at least %zu are needed", r.poses,
                                                        repeats.c_str(), options.min_poses)};
  }
  if (const std::size_t least = options.min_poses / 2; places < least) {
    return Judgement{
        PivotVerdict::kTooFewPoses,
        format("refused: the tool rested in %zu places, at least %zu are needed: turn it all the time", places, least)};
  }
  if (r.rotation_rad[1] < options.min_rotation_rad) {
    return Judgement{PivotVerdict::kTooLittleRotation,
                     format("refused: the tool was turned by %.0f degrees about one axis and by %.0f about the other; "
                            "at least %.0f about both are needed",
                            wide, narrow, options.min_rotation_rad / geometry::kRadiansPerDegree)};
  }
  return std::nullopt;
}

Judgement judge_errors(const PivotResult &r, const PivotOptions &options) {
  const double fraction = static_cast<double>(r.outliers) / static_cast<double>(r.poses);
  const double ratio = r.rms_mm / options.tracker_noise_mm;
  const double tip_mm = r.tip_mm.norm();
  // All comparisons are negated, so that what is not a number is refused.
  if (!(r.covariance_mm2.allFinite() && std::isfinite(ratio) && tip_mm <= options.max_tip_mm)) {
    return {PivotVerdict::kTipImplausible,
            std::isfinite(tip_mm)
                ? format("refused: the tip is %.0f mm from the tool's origin, at most %.0f mm are taken: "
                         "are the poses in mm?",
                         tip_mm, options.max_tip_mm)
                : "refused: the poses do not determine the tip"};
  }
  if (ratio < options.min_noise_ratio) {
    return {
        PivotVerdict::kResidualTooSmall,
        format("refused: RMS %.5f mm is %.4f times the tracker's noise of %.2f mm, which is too good: are the poses in "
               "mm, and measured, and is the noise right?",
               r.rms_mm, ratio, options.tracker_noise_mm)};
  }
  if (!(ratio <= options.max_noise_ratio)) {
    return {PivotVerdict::kResidualTooLarge,
            format("not fit for navigation: RMS %.2f mm (%.2f mm with outliers) is %.1f times the tracker's noise of "
                   "%.2f mm, at most %.1f times is allowed",
                   r.rms_mm, r.least_squares.rms_mm, ratio, options.tracker_noise_mm, options.max_noise_ratio)};
  }
  if (fraction > options.max_outlier_fraction) {
    return {PivotVerdict::kTooManyOutliers,
            format("refused: %zu of %zu poses (%.0f %%) do not fit: did the tip stay in its dimple?", r.outliers,
                   r.poses, 100.0 * fraction)};
  }
  const double sigma = std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix3d>(r.covariance_mm2).eigenvalues()[2]);
  constexpr double kShortTip_mm = 40.0; // sensors in needles are as near to their tip; markers are not
  return {PivotVerdict::kAccepted,
          format("accepted: tip %.1f mm from the tool's origin, known to %.2f mm (1 sigma, "
                 "worst direction), RMS %.2f mm over %zu of %zu poses%s",
                 tip_mm, sigma, r.rms_mm, r.poses - r.outliers, r.poses,
                 tip_mm < kShortTip_mm ? "; few tools are as short: are the poses in mm?" : "")};
}

PivotFit to_fit(const PivotProblem &problem, const Estimate &estimate) {
  if (!estimate.valid()) {
    return {estimate.tip, estimate.pivot, geometry::kUnknown, geometry::kUnknown, geometry::kUnknown};
  }
  const auto errors = problem.errors(estimate, std::numeric_limits<double>::infinity());
  return {estimate.tip, problem.pivot_in_fixed_frame(estimate), errors.rms, errors.rms / std::sqrt(3.0), errors.worst};
}

} // namespace

PivotFit fit_pivot_least_squares(std::span<const PivotPose> poses) {
  const PivotProblem problem(poses);
  const std::vector<double> ones(poses.size(), 1.0);
  return to_fit(problem, poses.empty() ? Estimate() : problem.least_squares(ones));
}

PivotResult calibrate_pivot(std::span<const PivotPose> recorded, const PivotOptions &options) {
  const std::vector<PivotPose> different = without_repeats(recorded, options);
  const std::span<const PivotPose> poses(different);
  PivotResult out;
  out.poses = poses.size();
  out.repeated = recorded.size() - poses.size();
  if (!poses.empty()) {
    const auto ranges = widest_rotations(poses);
    std::copy(ranges.begin(), ranges.end(), out.rotation_rad);
  }
  if (auto refused = judge_motion(out, places_of(poses, options), options)) {
    out.verdict = refused->verdict;
    out.text = std::move(refused->text);
    return out;
  }
  out.estimated = true;
  out.least_squares = fit_pivot_least_squares(poses);
  PivotProblem problem(poses);
  const Estimate estimate = problem.robust(problem.robust_start(), 0, 0);
  const auto errors = problem.errors(estimate, kOutlierReach * problem.sigma(estimate, 0, 0));
  out.tip_mm = estimate.tip;
  out.pivot_mm = problem.pivot_in_fixed_frame(estimate);
  out.rms_mm = errors.rms;
  out.worst_mm = errors.worst;
  out.outliers = errors.beyond;
  out.covariance_mm2 = jackknife_covariance(problem, estimate);

  const std::size_t middle = poses.size() / 2;
  out.half_tips_mm[0] = problem.robust(estimate, middle, poses.size()).tip;
  out.half_tips_mm[1] = problem.robust(estimate, 0, middle).tip;
  out.halves_apart_mm = (out.half_tips_mm[0] - out.half_tips_mm[1]).norm();

  Judgement judgement = judge_errors(out, options);
  out.verdict = judgement.verdict;
  out.text = std::move(judgement.text);
  return out;
}

} // namespace bregma::calibration
