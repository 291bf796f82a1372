#include "algorithms/mri/harmonic_series.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include <Eigen/Cholesky>
#include <Eigen/QR>

namespace bregma::mri {

namespace {

using Eigen::Index;
using geometry::Points3;

constexpr Index kMinPoints = 12;
constexpr int kFlatDegrees = 2;     // degrees 0 and 1
constexpr double kFlatScale = 1e3;  // their prior sigma over the largest value
constexpr double kTinyScale = 1e-6; // smallest sigma over the largest value

// Harmonics of degree n begin here.
Index first(int degree) { return static_cast<Index>(degree) * degree; }
Index count(int degree) { return 2 * static_cast<Index>(degree) + 1; }

struct Posterior {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

// Evidence of one value's series. A: one column per point.
class EvidenceFit {
public:
  EvidenceFit(const Eigen::MatrixXd &A, const Eigen::VectorXd &values, int degree)
      : A_(A), values_(values), degree_(degree), normal_(A * A.transpose()), right_(A * values),
        scale_(std::max(values.cwiseAbs().maxCoeff(), 1e-9)) {
    variance_.assign(static_cast<std::size_t>(degree) + 1, scale_ * scale_);
    std::fill_n(variance_.begin(), kFlatDegrees, kFlatScale * kFlatScale * scale_ * scale_);
    noise_ = 0.01 * scale_ * scale_;
  }

  // MacKay's fixed point: gamma is the number of coefficients of a degree that the values determine.
  void run(int max_iterations, double tolerance) {
    for (int i = 0; i < max_iterations; ++i) {
      const Posterior p = posterior();
      const double smallest = kTinyScale * kTinyScale * scale_ * scale_;
      double change = 0.0, determined = 0.0;
      for (int n = 0; n <= degree_; ++n) {
        double &v = variance_[static_cast<std::size_t>(n)];
        const double gamma =
            static_cast<double>(count(n)) - p.covariance.diagonal().segment(first(n), count(n)).sum() / v;
        determined += std::max(gamma, 0.0);
        if (n < kFlatDegrees) {
          continue;
        }
        const double next =
            std::max(p.mean.segment(first(n), count(n)).squaredNorm() / std::max(gamma, 1e-9), smallest);
        if (v > 10.0 * smallest || next > 10.0 * smallest) {
          change = std::max(change, std::abs(std::log(next / v)));
        }
        v = next;
      }
      const double degrees_of_freedom = std::max(static_cast<double>(values_.size()) - determined, 1.0);
      const double next = std::max((values_ - A_.transpose() * p.mean).squaredNorm() / degrees_of_freedom, smallest);
      change = std::max(change, std::abs(std::log(next / noise_)));
      noise_ = next;
      if (change < tolerance) {
        break;
      }
    }
  }

  [[nodiscard]] Posterior posterior() const {
    Eigen::MatrixXd precision = normal_ / noise_;
    for (int n = 0; n <= degree_; ++n) {
      precision.diagonal().segment(first(n), count(n)).array() += 1.0 / variance_[static_cast<std::size_t>(n)];
    }
    const Eigen::LLT<Eigen::MatrixXd> cholesky(precision);
    return {cholesky.solve(right_ / noise_), cholesky.solve(Eigen::MatrixXd::Identity(normal_.rows(), normal_.cols()))};
  }

  // Variances for the prediction: a degree that the points do not show may still be as large as the decay of those that
  // they show lets expect. The decay joins the largest degree and the last one above the noise of a coefficient.
  void apply_decay() {
    const double resolution = noise_ / static_cast<double>(values_.size());
    int largest = kFlatDegrees, last = kFlatDegrees;
    for (int n = kFlatDegrees; n <= degree_; ++n) {
      const double v = variance_[static_cast<std::size_t>(n)];
      largest = v > variance_[static_cast<std::size_t>(largest)] ? n : largest;
      last = v > resolution ? n : last;
    }
    const double top = std::max(variance_[static_cast<std::size_t>(largest)], resolution);
    const double end = std::max(variance_[static_cast<std::size_t>(last)], resolution);
    const double decay = last > largest ? std::log(end / top) / (last - largest) : std::log(0.1);
    for (int n = largest + 1; n <= degree_; ++n) {
      double &v = variance_[static_cast<std::size_t>(n)];
      v = std::max(v, top * std::exp(decay * (n - largest)));
    }
  }

  [[nodiscard]] double noise() const { return noise_; }
  [[nodiscard]] const std::vector<double> &variances() const { return variance_; }

private:
  const Eigen::MatrixXd &A_;
  const Eigen::VectorXd &values_;
  int degree_;
  Eigen::MatrixXd normal_;
  Eigen::VectorXd right_;
  double scale_, noise_ = 1.0;
  std::vector<double> variance_; // by degree
};

} // namespace

tl::expected<HarmonicSeries, std::string> HarmonicSeries::fit(const Points3 &points_mm, const Eigen::VectorXd &values,
                                                              const HarmonicOptions &options) {
  if (points_mm.cols() != values.size()) {
    return tl::unexpected(std::to_string(points_mm.cols()) + " points but " + std::to_string(values.size()) +
                          " values");
  }
  if (points_mm.cols() < kMinPoints) {
    return tl::unexpected(std::to_string(points_mm.cols()) + " points; a series of harmonics needs " +
                          std::to_string(kMinPoints));
  }
  if (!points_mm.allFinite() || !values.allFinite()) {
    return tl::unexpected(std::string("a point or a value is not finite"));
  }
  if (options.max_degree < 2 || options.max_degree > kMaxHarmonicDegree || !(options.radius_mm >= 0.0) ||
      !std::isfinite(options.radius_mm)) {
    return tl::unexpected("degree " + std::to_string(options.max_degree) + " or radius " +
                          std::to_string(options.radius_mm) + " mm is out of range");
  }
  HarmonicSeries out;
  out.degree_ = options.max_degree;
  out.radius_mm_ = options.radius_mm > 0.0 ? options.radius_mm : points_mm.colwise().norm().maxCoeff();
  if (!(out.radius_mm_ > 0.0)) {
    return tl::unexpected(std::string("all points lie in the origin"));
  }
  const Eigen::MatrixXd A = harmonic_matrix(points_mm, out.degree_, out.radius_mm_);
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> linear(A.topRows(4).transpose());
  if (std::abs(linear.matrixQR()(3, 3)) < 1e-3 * std::abs(linear.matrixQR()(0, 0))) {
    return tl::unexpected(std::string("the points lie in a plane"));
  }

  EvidenceFit evidence(A, values, out.degree_);
  evidence.run(options.max_iterations, options.tolerance);
  evidence.apply_decay();
  const Posterior posterior = evidence.posterior();
  out.coefficients_ = posterior.mean;
  out.noise_sigma_ = std::sqrt(evidence.noise());
  for (const double v : evidence.variances()) {
    out.prior_sigma_.push_back(std::sqrt(v));
  }
  out.factor_ = posterior.covariance.llt().matrixU();
  // e_i / (1 - h_i) with h_i = a_i' covariance a_i / noise.
  const Eigen::VectorXd leverage = (out.factor_ * A).colwise().squaredNorm().transpose() / evidence.noise();
  out.leave_one_out_ = (values - A.transpose() * out.coefficients_).array() / (1.0 - leverage.array()).max(1e-9);
  return out;
}

double HarmonicSeries::operator()(const Eigen::Vector3d &point_mm) const noexcept {
  std::array<double, static_cast<std::size_t>(harmonic_count(kMaxHarmonicDegree))> row{};
  solid_harmonics(degree_, point_mm / radius_mm_, row);
  return Eigen::Map<const Eigen::VectorXd>(row.data(), coefficients_.size()).dot(coefficients_);
}

HarmonicSeries::Estimate HarmonicSeries::estimate(const Eigen::Vector3d &point_mm) const noexcept {
  std::array<double, static_cast<std::size_t>(harmonic_count(kMaxHarmonicDegree))> row{};
  solid_harmonics(degree_, point_mm / radius_mm_, row);
  const Eigen::Map<const Eigen::VectorXd> a(row.data(), coefficients_.size());
  double variance = 0.0;
  for (Index i = 0; i < factor_.rows(); ++i) {
    const Index rest = factor_.cols() - i;
    const double part = factor_.row(i).tail(rest).dot(a.tail(rest));
    variance += part * part;
  }
  return {a.dot(coefficients_), std::sqrt(variance)};
}

} // namespace bregma::mri
