#include "algorithms/registration/clouds/cpd.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include <Eigen/LU>
#include <Eigen/SVD>

#include "algorithms/registration/clouds/gauss_sums.hpp"

namespace bregma::registration {

using geometry::Points;

namespace {

template <int D> using Vector = Eigen::Matrix<double, D, 1>;
template <int D> using Matrix = Eigen::Matrix<double, D, D>;

template <int D> struct Normalised {
  Points<D> points; // centroid at the origin, divided by size
  Vector<D> centre;
  double size = 1.0; // RMS distance from the centroid
};

template <int D> Normalised<D> centred(const Points<D> &points) {
  Normalised<D> out;
  out.centre = points.rowwise().mean();
  out.points = points.colwise() - out.centre;
  out.size = std::sqrt(out.points.squaredNorm() / static_cast<double>(points.cols()));
  return out;
}

template <int D> double box_volume(const Points<D> &points) {
  const Vector<D> sides = points.rowwise().maxCoeff() - points.rowwise().minCoeff();
  return sides.cwiseMax(0.1 * sides.maxCoeff()).prod();
}

template <int D> double constant_of(double volume, double sigma, double w, Eigen::Index sources) {
  return std::pow(2.0 * std::numbers::pi * sigma * sigma, 0.5 * D) * w / (1.0 - w) * static_cast<double>(sources) /
         volume;
}

// The rotation nearest to A [Myronenko 2010, lemma 1]. False where A does not determine one.
template <int D> bool nearest_rotation(const Matrix<D> &A, Matrix<D> &out) {
  const Eigen::JacobiSVD<Matrix<D>> svd(A, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vector<D> signs = Vector<D>::Ones();
  signs[D - 1] = svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0 ? -1.0 : 1.0;
  out = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  return svd.singularValues()[D - 2] > 1e-9 * svd.singularValues()[0];
}

// The M-step of [Myronenko 2010, figures 2 and 3]: each source is fitted to y' + pull / weight with its weight. `moved`
// are the sources under the present transform. False where the pairs do not determine the model.
template <int D>
bool maximise(const Points<D> &source, const Points<D> &moved, const GaussSums<D> &sums, CpdModel model,
              CpdTransform<D> &transform) {
  const double total = sums.source_weight.sum();
  const Vector<D> source_mean = source * sums.source_weight / total;
  const Vector<D> drawn_mean = (moved * sums.source_weight + sums.pull.rowwise().sum()) / total;
  const Points<D> centred_source = source.colwise() - source_mean;
  const Points<D> weighted = centred_source * sums.source_weight.asDiagonal();
  const Matrix<D> A = (moved.colwise() - drawn_mean) * weighted.transpose() + sums.pull * centred_source.transpose();
  const Matrix<D> spread = weighted * centred_source.transpose();
  if (model == CpdModel::kAffine) {
    Eigen::FullPivLU<Matrix<D>> lu(spread);
    lu.setThreshold(1e-9);
    if (!lu.isInvertible()) {
      return false;
    }
    transform.linear = lu.solve(A.transpose()).transpose();
  } else {
    Matrix<D> rotation;
    if (!nearest_rotation<D>(A, rotation)) {
      return false;
    }
    const double scale = model == CpdModel::kSimilarity ? (A.array() * rotation.array()).sum() / spread.trace() : 1.0;
    transform.linear = scale * rotation;
  }
  transform.translation = drawn_mean - transform.linear * source_mean;
  return true;
}

} // namespace

const char *name(CpdOutcome outcome) noexcept {
  switch (outcome) {
  case CpdOutcome::kConverged:
    return "converged";
  case CpdOutcome::kNotConverged:
    return "not converged";
  case CpdOutcome::kTooFewPoints:
    return "too few points";
  case CpdOutcome::kNotFinite:
    return "a coordinate or an option is not a number in its range";
  case CpdOutcome::kNoOverlap:
    return "the clouds do not overlap: all targets are outliers";
  case CpdOutcome::kDegenerate:
    return "the points lie on a line or in a plane";
  }
  return "";
}

template <int D>
CpdResult<D> register_cpd(const Points<D> &source_mm, const Points<D> &target_mm, const CpdOptions &options,
                          const CpdTransform<D> *start) {
  CpdResult<D> out;
  if (source_mm.cols() <= D || target_mm.cols() <= D) {
    return out;
  }
  const double w = options.outlier_weight;
  if (!source_mm.allFinite() || !target_mm.allFinite() || !(w >= 0.0 && w < 1.0) || !(options.start_sigma_mm >= 0.0)) {
    out.outcome = CpdOutcome::kNotFinite;
    return out;
  }
  Normalised<D> source = centred<D>(source_mm);
  Normalised<D> target = centred<D>(target_mm);
  if (!(source.size > 0.0) || !(target.size > 0.0)) {
    out.outcome = CpdOutcome::kDegenerate;
    return out;
  }
  if (options.model == CpdModel::kRigid) {
    source.size = target.size;
  }
  source.points /= source.size;
  target.points /= target.size;
  const auto normalise = [&](const CpdTransform<D> &T) {
    CpdTransform<D> n;
    n.linear = T.linear * (source.size / target.size);
    n.translation = (T.linear * source.centre + T.translation - target.centre) / target.size;
    return n;
  };
  CpdTransform<D> transform = start != nullptr ? normalise(*start) : CpdTransform<D>{};
  Points<D> moved = transform * source.points;

  const auto M = static_cast<double>(source_mm.cols());
  const auto N = static_cast<double>(target_mm.cols());
  const double volume = box_volume<D>(target.points);
  // The mean squared distance of all pairs per coordinate, including both centroids.
  const double all_pairs = (target.points.squaredNorm() / N + moved.squaredNorm() / M -
                            2.0 * target.points.rowwise().mean().dot(moved.rowwise().mean())) /
                           D;
  double sigma = options.start_sigma_mm > 0.0 ? options.start_sigma_mm / target.size : std::sqrt(all_pairs);

  GaussSummer<D> summer(target.points, options.threads);
  GaussSums<D> sums;
  out.outcome = CpdOutcome::kNotConverged;
  while (out.outcome == CpdOutcome::kNotConverged && out.iterations < options.max_iterations) {
    ++out.iterations;
    summer.sum(moved, sigma, constant_of<D>(volume, sigma, w, source_mm.cols()), sums);
    const double total = sums.source_weight.sum();
    if (!(total > D)) {
      out.outcome = CpdOutcome::kNoOverlap;
      break;
    }
    if (!maximise<D>(source.points, moved, sums, options.model, transform)) {
      out.outcome = CpdOutcome::kDegenerate;
      break;
    }
    const Points<D> next = transform * source.points;
    const Points<D> step = next - moved;
    const double squares = sums.squares - 2.0 * (step.array() * sums.pull.array()).sum() +
                           (step.colwise().squaredNorm() * sums.source_weight).value();
    const double next_sigma = std::max(std::sqrt(std::max(squares, 0.0) / (total * D)), options.min_sigma);
    out.log_likelihood = (sums.log_divisors -
                          N * (std::log(M / (1.0 - w)) + 0.5 * D * std::log(2.0 * std::numbers::pi * sigma * sigma))) /
                         N;
    out.outlier_share = 1.0 - total / N;
    const bool still = std::sqrt(step.squaredNorm() / M) < options.tolerance;
    if (still && std::abs(next_sigma - sigma) < 1e3 * options.tolerance * sigma) {
      out.outcome = CpdOutcome::kConverged;
    }
    sigma = next_sigma;
    moved = next;
  }

  out.transform.linear = transform.linear * (target.size / source.size);
  out.transform.translation =
      target.size * transform.translation + target.centre - out.transform.linear * source.centre;
  nearest_rotation<D>(out.transform.linear, out.rotation);
  out.scale = std::pow(std::abs(out.transform.linear.determinant()), 1.0 / D);
  out.sigma_mm = sigma * target.size;
  return out;
}

template <int D>
CpdCorrespondences correspondences(const Points<D> &moved_source_mm, const Points<D> &target_mm, double sigma_mm,
                                   double outlier_constant) {
  const Eigen::Index M = moved_source_mm.cols();
  const double inverse = 0.5 / (sigma_mm * sigma_mm);
  CpdCorrespondences out;
  out.of_source.resize(static_cast<std::size_t>(M));
  out.of_target.resize(static_cast<std::size_t>(target_mm.cols()));
  // Logarithms of P, so that far pairs are still ordered where their Gaussians vanish.
  Eigen::VectorXd best = Eigen::VectorXd::Constant(M, -std::numeric_limits<double>::infinity());
  Eigen::ArrayXd exponents(M);
  for (Eigen::Index n = 0; n < target_mm.cols(); ++n) {
    exponents = (moved_source_mm.colwise() - target_mm.col(n)).colwise().squaredNorm().transpose().array() * -inverse;
    Eigen::Index nearest = 0;
    const double largest = exponents.maxCoeff(&nearest);
    const double log_divisor =
        largest + std::log((exponents - largest).exp().sum() + outlier_constant * std::exp(-largest));
    out.of_target[static_cast<std::size_t>(n)] = {static_cast<int>(nearest), std::exp(largest - log_divisor)};
    for (Eigen::Index m = 0; m < M; ++m) {
      if (exponents[m] - log_divisor > best[m]) {
        best[m] = exponents[m] - log_divisor;
        out.of_source[static_cast<std::size_t>(m)].index = static_cast<int>(n);
      }
    }
  }
  for (Eigen::Index m = 0; m < M; ++m) {
    out.of_source[static_cast<std::size_t>(m)].probability = std::exp(best[m]);
  }
  return out;
}

template <int D>
double outlier_constant(const Points<D> &target_mm, double sigma_mm, double outlier_weight, Eigen::Index sources) {
  return constant_of<D>(box_volume<D>(target_mm), sigma_mm, outlier_weight, sources);
}

template CpdResult<2> register_cpd<2>(const Points<2> &, const Points<2> &, const CpdOptions &,
                                      const CpdTransform<2> *);
template CpdResult<3> register_cpd<3>(const Points<3> &, const Points<3> &, const CpdOptions &,
                                      const CpdTransform<3> *);
template CpdCorrespondences correspondences<2>(const Points<2> &, const Points<2> &, double, double);
template CpdCorrespondences correspondences<3>(const Points<3> &, const Points<3> &, double, double);
template double outlier_constant<2>(const Points<2> &, double, double, Eigen::Index);
template double outlier_constant<3>(const Points<3> &, double, double, Eigen::Index);

} // namespace bregma::registration
