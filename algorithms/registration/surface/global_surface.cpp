#include "algorithms/registration/surface/global_surface.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "algorithms/registration/surface/degenerate_shape.hpp"
#include "algorithms/registration/surface/pose_search.hpp"
#include "algorithms/surface/neighbours.hpp"
#include "algorithms/uncertainty/tre.hpp"

namespace bregma::registration {

namespace {

constexpr double kOutlierRange_mm = 100.0; // an outlier may lie anywhere in this range
constexpr double kInlierLimit = 3.0;       // standard deviations
constexpr double kScaleSlack = 1.15; // factor by which residuals may exceed the stated error, in addition to scatter
constexpr double kChance = 4.0;      // standard deviations of the scale's scatter
constexpr int kTouchCandidates = 400;

} // namespace

struct GlobalRegistration::Workspace {
  Workspace(const surface::SurfaceField &field_in, const GlobalOptions &options_in, std::size_t capacity)
      : field(&field_in), options(options_in), sigma(std::hypot(options.sigma_mm, options.model_sigma_mm)),
        search(field_in, options_in.rotations, options_in.threads),
        local(field_in, local_options(options_in), capacity), neighbours(options_in.correlation_length_mm, capacity),
        weight(capacity), residuals(capacity) {
    samples.reserve(capacity);
    hypotheses.reserve(64);
  }

  // The estimate itself assumes independent errors. The correlation of neighbours enters through the weights of the
  // likelihood and the covariance.
  static LocalOptions local_options(const GlobalOptions &options) {
    LocalOptions out;
    out.sigma_mm = std::hypot(options.sigma_mm, options.model_sigma_mm);
    out.correlation_length_mm = options.correlation_length_mm;
    out.correlated_fraction = options.model_sigma_mm * options.model_sigma_mm / (out.sigma_mm * out.sigma_mm);
    return out;
  }

  void take(std::span<const Vector3d> source_mm);
  [[nodiscard]] double log_likelihood(std::span<const double> residual_mm) const;
  void find_hypotheses();
  void test_shape();
  void measure_dilution();
  void judge();
  void advise();

  const surface::SurfaceField *field;
  GlobalOptions options;
  double sigma;
  PoseSearch search;
  LocalRegistration local;
  surface::Neighbours neighbours;
  std::vector<Vector3d> samples;
  std::vector<double> weight; // weight of a sample's likelihood: its effective number of independent samples
  std::vector<double> residuals;
  struct Found {
    PoseHypothesis hypothesis;
    Matrix6d covariance;
    double scale;
  };
  std::vector<Found> hypotheses;
  Spread spread;
  GlobalResult result;
};

void GlobalRegistration::Workspace::take(std::span<const Vector3d> source_mm) {
  result = GlobalResult{};
  hypotheses.clear();
  samples.clear();
  const std::size_t room = weight.size();
  const std::size_t wanted = std::min(source_mm.size(), room);
  for (std::size_t i = 0; i < wanted; ++i) {
    const Vector3d &p = source_mm[i * source_mm.size() / wanted];
    if (p.allFinite()) {
      samples.push_back(p);
    }
  }
  result.count = static_cast<int>(samples.size());
  neighbours.set(samples);
  std::fill(weight.begin(), weight.end(), 1.0);
  const double correlated = std::pow(options.model_sigma_mm / sigma, 2);
  neighbours.each([&](std::size_t i, std::size_t j, double rho) {
    weight[i] += correlated * rho;
    weight[j] += correlated * rho;
  });
  for (std::size_t i = 0; i < samples.size(); ++i) {
    weight[i] = 1.0 / weight[i];
  }
  spread = spread_of(samples);
}

double GlobalRegistration::Workspace::log_likelihood(std::span<const double> residual_mm) const {
  const double normal = (1.0 - options.outliers) / (sigma * std::sqrt(2.0 * std::numbers::pi));
  const double outlier = std::max(options.outliers, 1e-3) / kOutlierRange_mm;
  double sum = 0.0;
  for (std::size_t i = 0; i < residual_mm.size(); ++i) {
    const double z = residual_mm[i] / sigma;
    sum += weight[i] * std::log(normal * std::exp(-0.5 * z * z) + outlier);
  }
  return sum;
}

void GlobalRegistration::Workspace::find_hypotheses() {
  for (const PoseCandidate &candidate : search.run(samples, sigma, 0.5 * options.distinct_mm)) {
    const LocalFit &fit = local.fit(samples, candidate.T_target_source);
    Found found;
    found.hypothesis.T_target_source = fit.T_target_source;
    found.hypothesis.log_likelihood = log_likelihood(local.residuals_mm());
    found.hypothesis.rms_mm = fit.rms_mm;
    found.hypothesis.inliers = fit.inliers;
    found.covariance = fit.covariance;
    found.scale = fit.scale;
    hypotheses.push_back(found);
  }
  std::stable_sort(hypotheses.begin(), hypotheses.end(), [](const Found &a, const Found &b) {
    return a.hypothesis.log_likelihood > b.hypothesis.log_likelihood;
  });
  double total = 0.0;
  double near_mm2 = 0.0;
  for (const Found &found : hypotheses) {
    const auto begin = result.hypotheses.begin();
    const auto end = begin + static_cast<std::ptrdiff_t>(result.hypothesis_count);
    const double likelihood = std::exp(found.hypothesis.log_likelihood - hypotheses.front().hypothesis.log_likelihood);
    const bool distinct = std::none_of(begin, end, [&](const PoseHypothesis &other) {
      const double apart = pose_distance_mm(found.hypothesis.T_target_source, other.T_target_source, spread);
      if (&other == &result.hypotheses[0] && apart < options.distinct_mm) {
        near_mm2 = std::max(near_mm2, likelihood * apart * apart);
      }
      return apart < options.distinct_mm;
    });
    if (distinct && result.hypothesis_count < kMaxHypotheses) {
      PoseHypothesis &kept = result.hypotheses[result.hypothesis_count++];
      kept = found.hypothesis;
      kept.probability = likelihood;
      total += likelihood;
    }
  }
  result.uncertainty_mm = std::sqrt(near_mm2);
  for (std::size_t i = 0; i < result.hypothesis_count; ++i) {
    result.hypotheses[i].probability /= total;
  }
  result.T_target_source = hypotheses.front().hypothesis.T_target_source;
  result.covariance = hypotheses.front().covariance;
  result.log_odds = result.hypothesis_count > 1
                        ? result.hypotheses[0].log_likelihood - result.hypotheses[1].log_likelihood
                        : std::numeric_limits<double>::infinity();
}

// If a plane, a sphere or a spheroid explains the samples about as well as the head does, the fit to the head is no
// evidence for this pose. A spheroid has one parameter more than a pose, which is penalised as in the Bayesian
// information criterion.
void GlobalRegistration::Workspace::test_shape() {
  const std::span<double> residual(residuals.data(), samples.size());
  fit_plane(samples, residual);
  double best = log_likelihood(residual);
  fit_sphere(samples, sigma, residual);
  best = std::fmax(best, log_likelihood(residual));
  fit_spheroid(samples, sigma, residual);
  best = std::fmax(best, log_likelihood(residual) - 0.5 * std::log(static_cast<double>(samples.size())));
  result.shape_log_odds = result.hypotheses[0].log_likelihood - best;
}

void GlobalRegistration::Workspace::measure_dilution() {
  const Vector3d centre = result.T_target_source * spread.middle_mm;
  Matrix6d information = Matrix6d::Zero();
  Matrix6d motion = Matrix6d::Zero(); // motion of all samples by a twist: sum of J'J
  double used = 0.0;
  for (const Vector3d &p : samples) {
    const Vector3d mapped = result.T_target_source * p;
    const surface::SurfacePoint on = field->closest(mapped);
    const geometry::Matrix36d J = geometry::point_jacobian(mapped - centre);
    motion += J.transpose() * J;
    if (on.distance_mm < kInlierLimit * sigma) {
      const geometry::Vector6d row = J.transpose() * on.normal;
      information += row * row.transpose();
      used += 1.0;
    }
  }
  const Eigen::LDLT<Matrix6d> factor(information);
  const double trace = factor.solve(motion).trace() * used / static_cast<double>(samples.size());
  const bool fixed = factor.info() == Eigen::Success && factor.isPositive() && trace > 0.0;
  result.dilution = fixed ? std::sqrt(trace) : std::numeric_limits<double>::infinity();
}

void GlobalRegistration::Workspace::judge() {
  const PoseHypothesis &best = result.hypotheses[0];
  const auto n = static_cast<double>(samples.size());
  measure_dilution();
  double squares = 0.0;
  for (const Vector3d &p : samples) {
    squares += uncertainty::tre_covariance(result.covariance, result.T_target_source * p).trace();
  }
  result.uncertainty_mm = std::hypot(result.uncertainty_mm, std::sqrt(squares / n));
  result.scale = hypotheses.front().scale;
  const double allowed = kScaleSlack + kChance / std::sqrt(2.0 * n);
  const double lost = 1.0 - best.inliers / n;
  const double may_be_lost = options.outliers + 0.01 + kChance * std::sqrt((options.outliers + 0.01) / n);
  if (result.scale > allowed || lost > may_be_lost) {
    result.verdict = Verdict::kRefused;
    result.reason = VerdictReason::kFitsBadly;
  } else if (result.log_odds < options.min_log_odds) {
    result.verdict = Verdict::kAmbiguous;
    result.reason = VerdictReason::kAnotherPose;
  } else if (result.shape_log_odds < options.min_log_odds) {
    result.verdict = Verdict::kAmbiguous;
    result.reason = VerdictReason::kDegenerateShape;
  } else if (!(result.uncertainty_mm <= options.max_uncertainty_mm) || !(result.dilution <= options.max_dilution)) {
    result.verdict = Verdict::kAmbiguous;
    result.reason = VerdictReason::kDirectionNotFixed;
  } else {
    result.verdict = Verdict::kFound;
    result.reason = VerdictReason::kNone;
  }
}

// The information of a touch: the distance of the skin there under the second-best pose, or, if there is only one pose,
// the uncertainty of the surface there along its normal.
void GlobalRegistration::Workspace::advise() {
  const surface::SurfaceModel &surface = field->surface();
  const auto triangles = static_cast<int>(surface.triangle_count());
  const int stride = std::max(1, triangles / kTouchCandidates);
  const bool rival = result.hypothesis_count > 1 && result.reason == VerdictReason::kAnotherPose;
  const auto T_rival_best = result.hypotheses[rival ? 1 : 0].T_target_source * result.T_target_source.inverse();
  double best = -1.0;
  for (int t = 0; t < triangles; t += stride) {
    const surface::SurfaceModel::Box box = surface.box(t);
    const surface::SurfacePoint at = surface.closest_on(t, 0.5 * (box.low_mm + box.high_mm));
    if (at.normal.z() < -0.5) {
      continue; // not accessible from below
    }
    double expected = 0.0;
    if (rival) {
      const Eigen::Vector3f there = (T_rival_best * at.point_mm).cast<float>();
      const surface::SurfaceField::Plane &plane = field->plane(there);
      expected = std::abs(static_cast<double>(plane.normal.dot(there) + plane.offset));
    } else if (result.covariance.allFinite()) {
      expected = at.normal.dot(uncertainty::tre_covariance(result.covariance, at.point_mm) * at.normal);
    }
    if (expected > best) {
      best = expected;
      result.touch_mm = at.point_mm;
    }
  }
}

GlobalRegistration::GlobalRegistration(const surface::SurfaceField &field, const GlobalOptions &options,
                                       std::size_t capacity) {
  if (!(options.sigma_mm > 0.0) || !(options.model_sigma_mm >= 0.0) || !(options.outliers >= 0.0) ||
      !(options.outliers < 0.5) || !(options.distinct_mm > 0.0) || options.rotations < 1 || options.threads < 1) {
    throw std::invalid_argument("global registration: sigma, outliers, rotations or threads out of range");
  }
  workspace_ = std::make_unique<Workspace>(field, options, capacity);
}
GlobalRegistration::~GlobalRegistration() = default;
GlobalRegistration::GlobalRegistration(GlobalRegistration &&) noexcept = default;
GlobalRegistration &GlobalRegistration::operator=(GlobalRegistration &&) noexcept = default;

const GlobalResult &GlobalRegistration::locate(std::span<const Vector3d> source_mm) {
  Workspace &w = *workspace_;
  w.take(source_mm);
  if (w.result.count < kMinGlobalSamples) {
    return w.result;
  }
  w.find_hypotheses();
  w.test_shape();
  w.judge();
  w.advise();
  return w.result;
}

} // namespace bregma::registration
