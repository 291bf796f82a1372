#include "algorithms/registration/surface/local_surface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/registration/surface/normal_kernel.hpp"
#include "algorithms/registration/surface/plane_step.hpp"
#include "algorithms/registration/twist.hpp"
#include "algorithms/surface/neighbours.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::registration {

using geometry::Matrix36d;
using geometry::Vector6d;

namespace {

constexpr std::size_t kMinSamples = 6;
constexpr std::size_t kCoarseSamples = 256; // number of samples for the first steps
constexpr double kCoarseSettled_mm = 0.05;
constexpr double kSettled_mm = 5e-3;
const double kMadToNormal = 1.0 / uncertainty::normal_quantile(0.75);
const double kMedianOfNorm = std::sqrt(uncertainty::chi_square_upper_quantile(0.5, 3)); // in space, sigma 1 per axis
constexpr double kWideReach = 3.0;    // reach of the first steps' loss, in units of their scale
constexpr double kTukeyReach = 4.685; // 95 % efficient for normal errors, each
constexpr double kHuberReach = 1.345;
constexpr double kGemanReach = 3.648;
constexpr double kHampelKnee = 2.5; // 99 % efficient
constexpr double kHampelReach = 4.5;
constexpr double kInlier = 3.0; // standard deviations
constexpr double kScaleSettled = 0.05;
constexpr int kScaledSteps = 6; // exact steps that may change the scale
constexpr double kBlind = 1e-9; // relative eigenvalue below which a direction counts as free
constexpr double kSurfaceTouch_mm = 1e-6;

// Weight of a residual of z standard deviations.
double weight_of(RobustLoss loss, double z) {
  switch (loss) {
  case RobustLoss::kHuber:
    return std::abs(z) <= kHuberReach ? 1.0 : kHuberReach / std::abs(z);
  case RobustLoss::kTukey: {
    const double inside = std::max(0.0, 1.0 - z * z / (kTukeyReach * kTukeyReach));
    return inside * inside;
  }
  case RobustLoss::kGemanMcClure: {
    const double falloff = kGemanReach * kGemanReach / (kGemanReach * kGemanReach + z * z);
    return falloff * falloff;
  }
  case RobustLoss::kHampel: {
    const double size = std::abs(z);
    const double left = std::clamp((kHampelReach - size) / (kHampelReach - kHampelKnee), 0.0, 1.0);
    return left * std::min(1.0, kHampelKnee / size);
  }
  case RobustLoss::kSquare:
    break;
  }
  return 1.0;
}

} // namespace

struct LocalRegistration::Workspace {
  Workspace(const surface::SurfaceField *field_in, const surface::CloudModel *cloud_in, const LocalOptions &options_in,
            std::size_t capacity)
      : field(field_in), cloud(cloud_in), options(options_in), neighbours(options_in.correlation_length_mm, capacity),
        samples(capacity), coarse(std::min(capacity, kCoarseSamples)), mapped(capacity), known(capacity),
        rows_each(options_in.metric == SurfaceMetric::kPointToPlane ? 1 : 3), rows(rows_each * capacity),
        residuals(capacity), magnitudes(whole_lanes(capacity)), correlation_sum(capacity), sums(capacity) {
    if (!(options.sigma_mm > 0.0) || !(options.trim >= 0.0 && options.trim < 0.9) ||
        !(options.correlation_length_mm >= 0.0) || options.max_iterations < 1) {
      throw std::invalid_argument("local registration: sigma, trim, correlation length or iterations out of range");
    }
    if (cloud != nullptr && !cloud->has_normals() && options.metric == SurfaceMetric::kPointToPlane) {
      throw std::invalid_argument("local registration: point to plane needs a cloud with normals");
    }
  }

  bool take(std::span<const Vector3d> source_mm);
  void approach(PairedPose &T);
  void settle(PairedPose &T);
  void linearise(const PairedPose &T, bool rescale);
  [[nodiscard]] Matrix6d covariance_about_centre();
  void report(const PairedPose &T);

  const surface::SurfaceField *field;
  const surface::CloudModel *cloud;
  LocalOptions options;
  surface::Neighbours neighbours;
  std::size_t count = 0;
  std::size_t coarse_count = 0;
  std::vector<Vector3d> samples;
  SampleLanes coarse;
  std::vector<Vector3d> mapped;                     // samples in the target frame
  std::vector<surface::SurfaceField::Nearby> known; // closest triangle of each sample, kept between steps
  std::size_t rows_each;                            // rows per sample: one along the normal, or three
  NormalRows rows;                                  // twists about the centre
  std::vector<double> residuals;                    // signed distance, or distance from the point
  std::vector<float> magnitudes;                    // absolute residuals
  std::vector<double> correlation_sum;              // sum of correlations of a sample with all
  std::vector<Vector6d> sums;
  Vector3d centre_source = Vector3d::Zero();
  Vector3d centre = Vector3d::Zero(); // in the target frame: centre of the steps' rotations
  double sigma = 1.0;                 // scaled
  LocalFit result;
};

bool LocalRegistration::Workspace::take(std::span<const Vector3d> source_mm) {
  count = 0;
  centre_source.setZero();
  for (const Vector3d &p : source_mm) {
    if (count < samples.size() && p.allFinite()) {
      samples[count++] = p;
      centre_source += p;
    }
  }
  result = LocalFit{};
  result.count = static_cast<int>(count);
  if (count < kMinSamples) {
    return false;
  }
  centre_source /= static_cast<double>(count);
  coarse_count = std::min(count, coarse.capacity());
  for (std::size_t i = 0; i < coarse_count; ++i) {
    coarse.set(i, samples[i * count / coarse_count]);
  }
  std::fill_n(known.begin(), count, surface::SurfaceField::Nearby{});
  neighbours.set({samples.data(), count});
  std::fill_n(correlation_sum.begin(), count, 1.0);
  neighbours.each([this](std::size_t i, std::size_t j, double rho) {
    correlation_sum[i] += options.correlated_fraction * rho;
    correlation_sum[j] += options.correlated_fraction * rho;
  });
  return true;
}

// Over the field's planes, the loss narrowing with the residuals.
void LocalRegistration::Workspace::approach(PairedPose &T) {
  while (result.iterations < options.max_iterations / 2) {
    ++result.iterations;
    const double middle_mm = plane_median_mm(*field, coarse, coarse_count, T, magnitudes.data());
    const double scale = std::max(options.sigma_mm, kMadToNormal * middle_mm);
    const Vector3d about = T * centre_source;
    const PlaneStep step = plane_step(*field, coarse, coarse_count, T, about, kWideReach * scale);
    const Vector6d twist = solve_damped(step.normal, step.gradient, 1e-4, kStepLimit_mm);
    T = moved_about(about, twist, T);
    if (motion_at_lever_mm(twist) < kCoarseSettled_mm) {
      break;
    }
  }
}

void LocalRegistration::Workspace::linearise(const PairedPose &T, bool rescale) {
  const Matrix3d R = T.rotation_matrix();
  const bool plane = options.metric == SurfaceMetric::kPointToPlane;
  for (std::size_t i = 0; i < count; ++i) {
    mapped[i] = R * samples[i] + T.translation();
  }
  using Ahead = surface::SurfaceField::Ahead;
  constexpr std::array<std::pair<std::size_t, Ahead>, 3> kAhead{
      {{12, Ahead::kPlace}, {6, Ahead::kList}, {3, Ahead::kTriangles}}};
  for (std::size_t i = 0; i < count; ++i) {
    for (const auto &[ahead, what] : kAhead) {
      if (field != nullptr && i + ahead < count) {
        field->prefetch(mapped[i + ahead], known[i + ahead], what);
      }
    }
    const Vector3d &p = mapped[i];
    const surface::SurfacePoint on = cloud != nullptr ? cloud->closest(p) : field->closest(p, known[i]);
    const Vector3d at = p - centre;
    if (plane) {
      // The gradient of the distance itself, also over an edge.
      const bool known_by_surface = cloud != nullptr || on.distance_mm < kSurfaceTouch_mm;
      const Vector3d normal = known_by_surface ? on.normal : Vector3d((p - on.point_mm) / on.signed_mm);
      residuals[i] = on.signed_mm;
      rows.set(i, at.cross(normal), normal, on.signed_mm);
    } else {
      const Vector3d offset = p - on.point_mm;
      residuals[i] = on.distance_mm;
      for (Eigen::Index k = 0; k < 3; ++k) {
        const Vector3d axis = Vector3d::Unit(k);
        rows.set(3 * i + static_cast<std::size_t>(k), at.cross(axis), axis, offset[k]);
      }
    }
    magnitudes[i] = static_cast<float>(std::abs(residuals[i]));
  }
  if (rescale && options.loss != RobustLoss::kSquare) {
    const auto middle = static_cast<double>(ranked(magnitudes, count, count / 2));
    sigma = std::max(options.sigma_mm, middle * (plane ? kMadToNormal : 1.0 / kMedianOfNorm));
  }
  float trimmed_at = std::numeric_limits<float>::infinity();
  if (options.trim > 0.0) {
    const auto kept = static_cast<std::size_t>((1.0 - options.trim) * static_cast<double>(count));
    trimmed_at = ranked(magnitudes, count, std::max(kept, kMinSamples) - 1);
  }
  for (std::size_t i = 0; i < count; ++i) {
    const double weight =
        magnitudes[i] <= trimmed_at ? weight_of(options.loss, residuals[i] / sigma) / correlation_sum[i] : 0.0;
    for (std::size_t k = 0; k < rows_each; ++k) {
      rows.set_weight(rows_each * i + k, weight);
    }
  }
  rows.pad(rows_each * count);
}

// With exact closest points.
void LocalRegistration::Workspace::settle(PairedPose &T) {
  double last = std::numeric_limits<double>::infinity();
  for (int step = 0; result.iterations < options.max_iterations; ++step) {
    ++result.iterations;
    centre = T * centre_source;
    // The scale follows the residuals until the pose is stable; then it is constant, so that the last steps converge.
    const bool rescale = step < kScaledSteps || (last > kCoarseSettled_mm && step < options.max_iterations / 2);
    linearise(T, rescale);
    Matrix6d normal = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    add_rows(rows, rows_each * count, normal, gradient);
    Vector6d twist = solve_damped(normal, gradient, 1e-8, kStepLimit_mm);
    const double motion = motion_at_lever_mm(twist);
    if (options.metric == SurfaceMetric::kPointToPlane && motion > 0.5 * last && step > 2) {
      twist *= 0.5; // the surface is curved within the step: two closest points alternate
    }
    T = moved_about(centre, twist, T);
    last = motion;
    if (motion < kSettled_mm) {
      // A pose that was stable for a while earlier still has the scale of that place.
      const double kept = sigma;
      linearise(T, true);
      if (std::abs(sigma - kept) < kScaleSettled * kept) {
        result.converged = true;
        return;
      }
      step = -1;
    }
  }
  result.converged = last < kCoarseSettled_mm;
}

// A^-1 B A^-1; B = J'W K W J with K = sigma^2 (rho_ij).
Matrix6d LocalRegistration::Workspace::covariance_about_centre() {
  Matrix6d A = Matrix6d::Zero();
  Vector6d unused = Vector6d::Zero();
  add_rows(rows, rows_each * count, A, unused);
  Vector6d lever;
  lever << Vector3d::Constant(1.0 / kHeadLever_mm), Vector3d::Ones();
  const Matrix6d scaled = lever.asDiagonal() * A * lever.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scaled);
  if (!(eigen.eigenvalues()[0] > kBlind * eigen.eigenvalues()[5])) {
    return Matrix6d::Constant(geometry::kUnknown);
  }
  const Matrix6d inverse = lever.asDiagonal() * eigen.eigenvectors() * eigen.eigenvalues().cwiseInverse().asDiagonal() *
                           eigen.eigenvectors().transpose() * lever.asDiagonal();
  Matrix6d B = Matrix6d::Zero();
  if (options.metric ==
      SurfaceMetric::kPointToPoint) { // as if all rows of neighbours were fully correlated: an upper bound
    for (std::size_t i = 0; i < 3 * count; ++i) {
      const Vector6d J = rows.jacobian(i);
      B.noalias() += (rows.weight(i) * rows.weight(i) * correlation_sum[i / 3] * J) * J.transpose();
    }
    return sigma * sigma * (inverse * B * inverse);
  }
  B = squared_weight_sum(rows, count);
  if (options.correlation_length_mm > 0.0) {
    std::fill_n(sums.begin(), count, Vector6d::Zero());
    neighbours.each([&](std::size_t i, std::size_t j, double rho) {
      sums[i] += options.correlated_fraction * rho * rows.weight(j) * rows.jacobian(j);
    });
    Matrix6d between = Matrix6d::Zero();
    for (std::size_t i = 0; i < count; ++i) {
      between.noalias() += (rows.weight(i) * rows.jacobian(i)) * sums[i].transpose();
    }
    B += between + between.transpose();
  }
  return sigma * sigma * (inverse * B * inverse);
}

void LocalRegistration::Workspace::report(const PairedPose &T) {
  result.T_target_source = T;
  result.scale = sigma / options.sigma_mm;
  result.covariance = covariance_at_origin(covariance_about_centre(), centre);
  double squares = 0.0;
  for (std::size_t i = 0; i < count; ++i) {
    if (std::abs(residuals[i]) <= kInlier * sigma) {
      ++result.inliers;
      squares += residuals[i] * residuals[i];
      result.effective += 1.0 / correlation_sum[i];
    }
  }
  result.rms_mm = result.inliers > 0 ? std::sqrt(squares / result.inliers) : 0.0;
}

LocalRegistration::LocalRegistration(const surface::SurfaceField &field, const LocalOptions &options,
                                     std::size_t capacity)
    : workspace_(std::make_unique<Workspace>(&field, nullptr, options, capacity)) {}
LocalRegistration::LocalRegistration(const surface::CloudModel &cloud, const LocalOptions &options,
                                     std::size_t capacity)
    : workspace_(std::make_unique<Workspace>(nullptr, &cloud, options, capacity)) {}
LocalRegistration::~LocalRegistration() = default;
LocalRegistration::LocalRegistration(LocalRegistration &&) noexcept = default;
LocalRegistration &LocalRegistration::operator=(LocalRegistration &&) noexcept = default;

std::span<const double> LocalRegistration::residuals_mm() const noexcept {
  return {workspace_->residuals.data(), workspace_->count};
}

const LocalFit &LocalRegistration::fit(std::span<const Vector3d> source_mm, const PairedPose &start) noexcept {
  Workspace &w = *workspace_;
  const bool enough = w.take(source_mm);
  w.result.T_target_source = start;
  if (!enough || !start.translation().allFinite() || !start.rotation().coeffs().allFinite()) {
    w.count = enough ? 0 : w.count;
    return w.result;
  }
  PairedPose T = start;
  w.sigma = w.options.sigma_mm;
  if (w.field != nullptr && w.options.metric == SurfaceMetric::kPointToPlane) {
    w.approach(T);
  }
  w.settle(T);
  w.report(T);
  return w.result;
}

} // namespace bregma::registration
