#include "algorithms/registration/surface/beam_errors.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include <Eigen/Dense>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/registration/surface/tilt_excess.hpp"
#include "algorithms/registration/twist.hpp"
#include "algorithms/surface/neighbours.hpp"

namespace bregma::registration {

namespace {

using MatrixAll = Eigen::Matrix<double, 10, 10>;
using VectorAll = Eigen::Matrix<double, 10, 1>;

struct BeamRow {
  VectorAll jacobian = VectorAll::Zero(); // of the distance by twist about the centre, excess and offset
  double residual = 0.0;
  double weight = 0.0;
  bool used = false; // not on steep skin
};

class BeamEstimate {
public:
  BeamEstimate(const surface::SurfaceField &field, std::span<const Vector3d> source_mm, const Vector3d &up,
               const BeamErrorOptions &options)
      : field_(field), options_(options), up_(up), side_(up.unitOrthogonal()),
        sigma_(std::hypot(options.sigma_mm, options.model_sigma_mm)),
        correlated_(std::pow(options.model_sigma_mm / sigma_, 2)),
        neighbours_(options.correlation_length_mm, source_mm.size()) {
    for (const Vector3d &p : source_mm) {
      if (p.allFinite()) {
        points_.push_back(p);
        centre_source_ += p;
      }
    }
    centre_source_ /= static_cast<double>(std::max<std::size_t>(points_.size(), 1));
    rows_.resize(points_.size());
    neighbours_.set(points_);
    correlation_sum_.assign(points_.size(), 1.0);
    neighbours_.each([this](std::size_t i, std::size_t j, double rho) {
      correlation_sum_[i] += correlated_ * rho;
      correlation_sum_[j] += correlated_ * rho;
    });
  }

  [[nodiscard]] BeamErrorFit run(const PairedPose &start) {
    BeamErrorFit out;
    out.T_target_source = start;
    if (points_.size() < static_cast<std::size_t>(kMinPoints)) {
      return spoilt(out);
    }
    double last_mm = std::numeric_limits<double>::infinity(); // of the steps that were made
    double last_size_mm = last_mm;                            // of the steps as they were computed
    double damping = 1.0;
    Vector3d excess = Vector3d::Zero();
    for (int i = 0; i < options_.max_iterations && last_mm >= kSettled_mm; ++i) {
      linearise(out.T_target_source, excess, i < kScaledSteps);
      if (used_ < kMinPoints) {
        return spoilt(out);
      }
      // The offset stays where its prior has it: the pose follows it entirely.
      const MatrixAll normal = normal_matrix();
      VectorAll gradient = VectorAll::Zero();
      for (const BeamRow &row : rows_) {
        gradient += row.weight * row.residual * row.jacobian;
      }
      gradient.segment<3>(kExcess) += prior().segment<3>(kExcess).cwiseProduct(excess);
      VectorAll step = VectorAll::Zero();
      step.head<kOffset>() = -normal.topLeftCorner<kOffset, kOffset>().ldlt().solve(gradient.head<kOffset>());
      if (!step.allFinite()) {
        return spoilt(out);
      }
      const double size_mm = std::max(
          {kHeadRadius_mm * step.head<3>().norm(), step.segment<3>(3).norm(), step.segment<3>(kExcess).norm()});
      // The surface is curved within the step, and two closest points alternate: the minimum lies on the edge between.
      if (size_mm > 0.5 * last_size_mm) {
        damping *= 0.6;
      } else if (i < options_.max_iterations / 2) {
        damping = std::min(1.0, 1.5 * damping);
      }
      last_size_mm = size_mm;
      step *= damping;
      last_mm = damping * size_mm;
      out.T_target_source = moved_about(centre_, step.head<6>(), out.T_target_source);
      excess += step.segment<3>(kExcess);
    }
    out.converged = last_mm < kNearlySettled_mm;
    if (!out.converged) {
      return spoilt(out);
    }
    linearise(out.T_target_source, excess, true);
    const MatrixAll covariance = covariance_about_centre();
    if (!covariance.allFinite()) {
      return spoilt(out);
    }
    out.covariance = covariance_at_origin(covariance.topLeftCorner<6, 6>(), centre_);
    out.excess_mm = excess[0];
    out.excess_sigma_mm = std::sqrt(covariance(kExcess, kExcess));
    double squares = 0.0;
    for (const BeamRow &row : rows_) {
      if (row.weight > 0.0 && std::abs(row.residual) <= kInlier * scale_) {
        ++out.inliers;
        squares += row.residual * row.residual;
      }
    }
    out.rms_mm = out.inliers > 0 ? std::sqrt(squares / out.inliers) : 0.0;
    return out;
  }

private:
  // Unknowns: the twist, the excess and its two slopes, the offset.
  static constexpr Eigen::Index kExcess = 6, kOffset = 9;
  static constexpr int kMinPoints = 9;
  static constexpr double kHeadRadius_mm = 80.0; // turns a rotation into a motion
  static constexpr double kMadToNormal = 1.4826;
  static constexpr double kInlier = 3.0;
  static constexpr double kFull = 2.5, kNone = 4.5; // Hampel's weights, in sigma
  static constexpr double kSettled_mm = 0.005;      // a step of a head or of the excess that ends the iteration
  static constexpr double kNearlySettled_mm = 0.1;  // at the maximum of iterations
  // The scale and the choice of points follow for so many steps; then they are constant, so that the last ones
  // converge.
  static constexpr int kScaledSteps = 8;

  static double hampel(double z) {
    const double size = std::abs(z);
    return size <= kFull ? 1.0 : size >= kNone ? 0.0 : kFull / size * (kNone - size) / (kNone - kFull);
  }

  static BeamErrorFit spoilt(BeamErrorFit out) {
    out.converged = false;
    out.covariance.setConstant(geometry::kUnknown);
    return out;
  }

  void linearise(const PairedPose &T, const Vector3d &excess, bool rescale) {
    centre_ = T * centre_source_;
    const Vector3d up = T.rotation() * up_;
    const Vector3d side = T.rotation() * side_;
    const auto too_far = [&](const Vector3d &normal) { return excess_terms(normal, up, side); };
    magnitudes_.clear();
    used_ = 0;
    for (std::size_t i = 0; i < points_.size(); ++i) {
      BeamRow &row = rows_[i];
      const Vector3d place = T * points_[i];
      // The tilt where the point lies decides by how much it is raised, and the raised point where it lies.
      const Vector3d p = place + too_far(field_.closest(place).normal).dot(excess) * up;
      const surface::SurfacePoint on = field_.closest(p);
      const double cosine = on.normal.dot(up);
      row.residual = on.signed_mm;
      row.jacobian << (p - centre_).cross(on.normal), on.normal, cosine * too_far(on.normal), cosine;
      if (rescale) {
        row.used = cosine >= std::cos(options_.max_tilt_rad);
      }
      row.weight = row.used ? 1.0 : 0.0;
      if (row.used) {
        ++used_;
        magnitudes_.push_back(std::abs(row.residual));
      }
    }
    if (magnitudes_.empty()) {
      return;
    }
    if (rescale) {
      const auto middle = magnitudes_.begin() + static_cast<std::ptrdiff_t>(magnitudes_.size() / 2);
      std::nth_element(magnitudes_.begin(), middle, magnitudes_.end());
      scale_ = std::max(sigma_, kMadToNormal * *middle);
    }
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      rows_[i].weight *= hampel(rows_[i].residual / scale_) / correlation_sum_[i];
    }
  }

  // The inverse of the priors' variances times scale^2, as the rows have it.
  [[nodiscard]] VectorAll prior() const {
    constexpr double kFixed = 1e12; // of a parameter that is known to be zero
    const auto of = [this](double sigma_mm) { return sigma_mm > 0.0 ? std::pow(scale_ / sigma_mm, 2) : kFixed; };
    VectorAll out = VectorAll::Zero();
    out[kExcess] = of(options_.excess_sigma_mm);
    out.segment<2>(kExcess + 1).setConstant(of(kExcessSlopes * options_.excess_sigma_mm));
    out[kOffset] = of(options_.offset_sigma_mm);
    return out;
  }

  [[nodiscard]] MatrixAll normal_matrix() const {
    MatrixAll out = prior().asDiagonal();
    for (const BeamRow &row : rows_) {
      out += row.weight * row.jacobian * row.jacobian.transpose();
    }
    return out;
  }

  // N^-1 (J'W K W J + prior) N^-1 times scale^2, with K_ij = correlated rho_ij, 1 on the diagonal.
  [[nodiscard]] MatrixAll covariance_about_centre() const {
    const MatrixAll inverse = normal_matrix().inverse();
    MatrixAll middle = prior().asDiagonal();
    std::vector<VectorAll> sums(rows_.size(), VectorAll::Zero());
    neighbours_.each([&](std::size_t i, std::size_t j, double rho) {
      sums[i] += correlated_ * rho * rows_[j].weight * rows_[j].jacobian;
    });
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      const VectorAll g = rows_[i].weight * rows_[i].jacobian;
      middle += g * g.transpose() + g * sums[i].transpose() + sums[i] * g.transpose();
    }
    return scale_ * scale_ * inverse * middle * inverse;
  }

  const surface::SurfaceField &field_;
  BeamErrorOptions options_;
  Vector3d up_, side_; // of the source
  double sigma_, correlated_;
  surface::Neighbours neighbours_;
  std::vector<Vector3d> points_;
  std::vector<double> correlation_sum_, magnitudes_;
  std::vector<BeamRow> rows_;
  Vector3d centre_source_ = Vector3d::Zero(), centre_ = Vector3d::Zero();
  double scale_ = 1.0;
  int used_ = 0;
};

} // namespace

BeamErrorFit fit_beam_errors(const surface::SurfaceField &field, std::span<const Vector3d> source_mm,
                             const Vector3d &towards_sensor, const PairedPose &start, const BeamErrorOptions &options) {
  if (!(options.sigma_mm > 0.0) || !(options.model_sigma_mm >= 0.0) || !(options.offset_sigma_mm >= 0.0) ||
      !(options.excess_sigma_mm >= 0.0) || !(options.max_tilt_rad > 0.0)) {
    throw std::invalid_argument("errors of a beam must not be negative, sigma_mm and max_tilt_rad must be positive");
  }
  return BeamEstimate(field, source_mm, towards_sensor.normalized(), options).run(start);
}

} // namespace bregma::registration
