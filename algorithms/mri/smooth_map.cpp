#include "algorithms/mri/smooth_map.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>

#include "algorithms/mri/lattice.hpp"
#include "algorithms/mri/solid_harmonics.hpp"

namespace bregma::mri {

namespace {

using Eigen::Index;
using geometry::Points3;

constexpr int kRounds = 12;
constexpr double kTukey = 4.685;         // 95 % efficiency for normal residuals
constexpr double kSigmaPerMedian = 0.65; // of the length of three normal coordinates
constexpr double kMinSigma = 0.02;       // mm; below it every pair counts fully
constexpr Index kPairsPerHarmonic = 3;
// Expectation-maximisation; widths relative to the spacing.
constexpr double kWideSigma = 0.3;
constexpr double kNarrowSigma = 0.08;
constexpr int kWideDegree = 5;
constexpr int kWideIterations = 12; // per degree
constexpr int kCoolingIterations = 20;
constexpr int kNarrowIterations = 6;
constexpr double kOutlierSigmas = 2.5; // an outlier is as likely as a point at this distance
constexpr double kPriorShare = 0.5;    // of the spacing: sigma of a coefficient

} // namespace

SmoothMap::SmoothMap(const Points3 &from_mm, const Points3 &to_mm, int degree)
    : degree_(degree), radius_mm_(std::max(from_mm.colwise().norm().maxCoeff(), 1e-6)) {
  while (degree_ > 0 && kPairsPerHarmonic * harmonic_count(degree_) > from_mm.cols()) {
    --degree_;
  }
  const Eigen::MatrixXd A = harmonic_matrix(from_mm, degree_, radius_mm_);
  const Eigen::MatrixXd displacements = (to_mm - from_mm).transpose();
  Eigen::VectorXd weights = Eigen::VectorXd::Ones(from_mm.cols());
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::MatrixXd weighted = A * weights.asDiagonal();
    Eigen::MatrixXd normal = weighted * A.transpose();
    normal.diagonal().array() += 1e-9 * normal.trace();
    coefficients_ = normal.llt().solve(weighted * displacements);
    const Eigen::VectorXd lengths = (displacements - A.transpose() * coefficients_).rowwise().norm();
    const double sigma =
        std::max(kSigmaPerMedian * median(std::vector<double>(lengths.begin(), lengths.end())), kMinSigma);
    weights = (1.0 - (lengths.array() / (kTukey * std::sqrt(3.0) * sigma)).square()).max(0.0).square();
  }
}

Points3 SmoothMap::operator()(const Points3 &from_mm) const {
  return from_mm + coefficients_.transpose() * harmonic_matrix(from_mm, degree_, radius_mm_);
}

SoftSmoothMap::SoftSmoothMap(const Points3 &from_mm, const Points3 &to_mm, double spacing_mm)
    : from_(from_mm), to_(to_mm), spacing_mm_(spacing_mm),
      radius_mm_(std::max(from_mm.colwise().norm().maxCoeff(), 1e-6)), moved_(from_mm) {}

// The width stays while a degree is added, and falls only when the largest is in: narrower Gaussians would keep points
// at the neighbour to which a lower degree has brought them.
Points3 SoftSmoothMap::run(int degree) {
  constexpr int kDegreesAtOnce = 2; // distortions of coils have odd degrees
  int current = 1;
  for (; current < degree; current = std::min(current + kDegreesAtOnce, degree)) {
    iterate(current, kWideSigma, kWideSigma, kWideIterations);
    if (current == kWideDegree) {
      break;
    }
  }
  iterate(current, kWideSigma, kNarrowSigma, kCoolingIterations);
  for (current = std::min(current + kDegreesAtOnce, degree); current < degree; current += kDegreesAtOnce) {
    iterate(current, 2.0 * kNarrowSigma, kNarrowSigma, kNarrowIterations);
  }
  iterate(degree, 2.0 * kNarrowSigma, kNarrowSigma, kNarrowIterations);
  return moved_;
}

void SoftSmoothMap::iterate(int degree, double from_share, double to_share, int iterations) {
  while (degree > 1 && kPairsPerHarmonic * harmonic_count(degree) > from_.cols()) {
    --degree;
  }
  const Eigen::MatrixXd A = harmonic_matrix(from_, degree, radius_mm_);
  for (int i = 0; i < iterations; ++i) {
    const double progress = iterations > 1 ? static_cast<double>(i) / (iterations - 1) : 1.0;
    const double sigma = spacing_mm_ * from_share * std::pow(to_share / from_share, progress);
    const Responsibility r = expectation(sigma);
    // M: weighted least squares for the displacements. A weak prior on the degrees above the linear one keeps them
    // small where points are few.
    const Eigen::MatrixXd weighted = A * r.weight.asDiagonal();
    Eigen::MatrixXd normal = weighted * A.transpose();
    normal.diagonal().array() += 1e-6;
    normal.diagonal().tail(normal.rows() - harmonic_count(1)).array() +=
        std::pow(sigma / (kPriorShare * spacing_mm_), 2);
    const Points3 pulled = r.sum - from_ * r.weight.asDiagonal();
    moved_ = from_ + normal.llt().solve(A * pulled.transpose()).transpose() * A;
  }
}

// E: the share of each target that each moved point explains.
SoftSmoothMap::Responsibility SoftSmoothMap::expectation(double sigma_mm) const {
  const double reach = 9.0 * sigma_mm * sigma_mm;
  const double outlier = std::exp(-0.5 * kOutlierSigmas * kOutlierSigmas);
  Responsibility out{Eigen::VectorXd::Zero(from_.cols()), Points3::Zero(3, from_.cols())};
  std::vector<std::pair<Index, double>> near;
  for (Index j = 0; j < to_.cols(); ++j) {
    near.clear();
    double total = outlier;
    for (Index k = 0; k < from_.cols(); ++k) {
      const double r2 = (moved_.col(k) - to_.col(j)).squaredNorm();
      if (r2 < reach) {
        near.emplace_back(k, std::exp(-0.5 * r2 / (sigma_mm * sigma_mm)));
        total += near.back().second;
      }
    }
    for (const auto &[k, value] : near) {
      out.weight[k] += value / total;
      out.sum.col(k) += value / total * to_.col(j);
    }
  }
  return out;
}

} // namespace bregma::mri
