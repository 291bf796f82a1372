#include "algorithms/registration/splines/thin_plate_spline.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>

namespace bregma::registration {

using geometry::Points;

namespace {

constexpr double kTinySquare = 1e-300; // its r^2 ln r^2 is 0
constexpr Eigen::Index kPointsAtOnce = 32;

// phi as a function of r^2, with the sign that makes it conditionally positive definite.
double kernel_of(SplineKernel kernel, double r2) {
  return kernel == SplineKernel::kR2LogR ? 0.5 * r2 * std::log(std::max(r2, kTinySquare)) : -std::sqrt(r2);
}

template <class Array> void apply_kernel(SplineKernel kernel, Array &&r2) {
  if (kernel == SplineKernel::kR2LogR) {
    r2 = 0.5 * r2 * r2.max(kTinySquare).log();
  } else {
    r2 = -r2.sqrt();
  }
}

// d phi / d(r^2) times two: the gradient along y - c.
double slope_of(SplineKernel kernel, double r2) {
  if (r2 < kTinySquare) {
    return 0.0;
  }
  return kernel == SplineKernel::kR2LogR ? std::log(r2) + 1.0 : -1.0 / std::sqrt(r2);
}

// Squared distances of one point from all centres.
template <int D, class Centres, class Column>
void squared_distances(const Centres &centres, const Eigen::Matrix<double, D, 1> &p, Column &&out) {
  out = (centres.col(0).array() - p[0]).square();
  for (int d = 1; d < D; ++d) {
    out += (centres.col(d).array() - p[d]).square();
  }
}

// A sentence that names two centres at the same position; empty if all are distinct.
template <int D> std::string coincident(const Points<D> &points) {
  std::vector<Eigen::Index> order(static_cast<std::size_t>(points.cols()));
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) {
    return std::lexicographical_compare(points.col(a).begin(), points.col(a).end(), points.col(b).begin(),
                                        points.col(b).end());
  });
  for (std::size_t i = 1; i < order.size(); ++i) {
    if (points.col(order[i]) == points.col(order[i - 1])) {
      return "centres " + std::to_string(std::min(order[i], order[i - 1])) + " and " +
             std::to_string(std::max(order[i], order[i - 1])) + " are the same point";
    }
  }
  return {};
}

} // namespace

template <int D>
tl::expected<ThinPlateSpline<D>, std::string>
ThinPlateSpline<D>::fit(const Points<D> &centres_mm, const Points<D> &values_mm, const SplineOptions &options) {
  const Eigen::Index N = centres_mm.cols();
  constexpr Eigen::Index kPoly = D + 1;
  if (values_mm.cols() != N) {
    return tl::unexpected(std::to_string(N) + " centres but " + std::to_string(values_mm.cols()) + " values");
  }
  if (N < kPoly || N > kMaxSplineCentres) {
    return tl::unexpected(std::to_string(N) + " centres; a spline needs " + std::to_string(kPoly) + " to " +
                          std::to_string(kMaxSplineCentres));
  }
  if (!centres_mm.allFinite() || !values_mm.allFinite() || !(options.regularisation >= 0.0)) {
    return tl::unexpected(std::string("a centre, a value or the regularisation is not a number in its range"));
  }
  if (const std::string same = coincident<D>(centres_mm); !same.empty() && options.regularisation == 0.0) {
    return tl::unexpected(same);
  }

  ThinPlateSpline out;
  out.kernel_ = options.kernel;
  out.origin_ = centres_mm.rowwise().mean();
  out.size_mm_ = std::sqrt((centres_mm.colwise() - out.origin_).squaredNorm() / static_cast<double>(N));
  if (!(out.size_mm_ > 0.0)) {
    return tl::unexpected(std::string("all centres are the same point"));
  }
  out.centres_ = ((centres_mm.colwise() - out.origin_) / out.size_mm_).transpose();
  const double lambda =
      options.regularisation / (options.kernel == SplineKernel::kR2LogR ? out.size_mm_ * out.size_mm_ : out.size_mm_);

  Eigen::MatrixXd polynomials(N, kPoly);
  polynomials << Eigen::VectorXd::Ones(N), out.centres_;
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(polynomials);
  const auto R = qr.matrixQR().topRows(kPoly).template triangularView<Eigen::Upper>();
  if (qr.matrixQR().diagonal().cwiseAbs().minCoeff() < 1e-9 * std::sqrt(static_cast<double>(N))) {
    return tl::unexpected(std::string(D == 3 ? "the centres lie in a plane" : "the centres lie on a line"));
  }

  Eigen::MatrixXd K(N, N);
  for (Eigen::Index i = 0; i < N; ++i) {
    auto column = K.col(i).array();
    squared_distances<D>(out.centres_, Vector(out.centres_.row(i).transpose()), column);
    apply_kernel(options.kernel, column);
  }
  K.diagonal().array() += lambda;
  K.applyOnTheLeft(qr.householderQ().adjoint());
  K.applyOnTheRight(qr.householderQ());
  const Eigen::Index rest = N - kPoly;
  const Eigen::MatrixXd mixed = K.topRightCorner(kPoly, rest); // block between the polynomial and the other part
  Eigen::Ref<Eigen::MatrixXd> projected = K.bottomRightCorner(rest, rest);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> cholesky(projected);
  // Rounding leaves about this much on the diagonal where the system is singular.
  const double floor = 1e-13 * static_cast<double>(N);
  if (rest > 0 && (cholesky.info() != Eigen::Success ||
                   cholesky.matrixLLT().diagonal().array().square().minCoeff() < floor * 1e-3)) {
    return tl::unexpected(std::string("two centres are too close together for numbers of 16 digits"));
  }

  const auto solve = [&](const Eigen::MatrixXd &values) {
    const Eigen::MatrixXd turned = qr.householderQ().adjoint() * values;
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(N, D);
    if (rest > 0) {
      a.bottomRows(rest) = cholesky.solve(turned.bottomRows(rest));
    }
    out.affine_ += R.solve(turned.topRows(kPoly) - mixed * a.bottomRows(rest));
    out.coefficients_ += qr.householderQ() * a;
  };
  out.affine_.setZero();
  out.coefficients_.setZero(N, D);
  const Eigen::MatrixXd values = values_mm.transpose();
  solve(values);
  solve(values - out.map(centres_mm).transpose() - lambda * out.coefficients_);

  if (options.leave_one_out && rest > 0) {
    // a_i / (Q2 B^-1 Q2')_ii, with B = L L': the squared norms of the columns of L^-1 Q2'.
    Eigen::MatrixXd full = Eigen::MatrixXd::Identity(N, N);
    full.applyOnTheLeft(qr.householderQ().adjoint());
    Eigen::MatrixXd half = full.bottomRows(rest);
    cholesky.matrixL().solveInPlace(half);
    out.leave_one_out_mm_ =
        out.coefficients_.rowwise().norm().array() / half.colwise().squaredNorm().transpose().array();
  }
  return out;
}

template <int D>
typename ThinPlateSpline<D>::Vector ThinPlateSpline<D>::operator()(const Vector &point_mm) const noexcept {
  const Vector p = normalised(point_mm);
  Vector out = affine_.row(0).transpose() + affine_.template bottomRows<D>().transpose() * p;
  for (Eigen::Index i = 0; i < centres_.rows(); ++i) {
    out += kernel_of(kernel_, (centres_.row(i).transpose() - p).squaredNorm()) * coefficients_.row(i).transpose();
  }
  return out;
}

template <int D> Points<D> ThinPlateSpline<D>::map(const Points<D> &points_mm) const {
  Points<D> out(D, points_mm.cols());
  Eigen::ArrayXXd kernels(centres_.rows(), std::min(kPointsAtOnce, points_mm.cols()));
  for (Eigen::Index begin = 0; begin < points_mm.cols(); begin += kPointsAtOnce) {
    const Eigen::Index count = std::min(kPointsAtOnce, points_mm.cols() - begin);
    const Points<D> p = (points_mm.middleCols(begin, count).colwise() - origin_) / size_mm_;
    for (Eigen::Index i = 0; i < count; ++i) {
      auto column = kernels.col(i);
      squared_distances<D>(centres_, Vector(p.col(i)), column);
      apply_kernel(kernel_, column);
    }
    out.middleCols(begin, count) =
        coefficients_.transpose() * kernels.leftCols(count).matrix() + affine_.template bottomRows<D>().transpose() * p;
    out.middleCols(begin, count).colwise() += affine_.row(0).transpose();
  }
  return out;
}

template <int D>
typename ThinPlateSpline<D>::Matrix ThinPlateSpline<D>::jacobian(const Vector &point_mm) const noexcept {
  const Vector p = normalised(point_mm);
  Matrix out = affine_.template bottomRows<D>().transpose();
  for (Eigen::Index i = 0; i < centres_.rows(); ++i) {
    const Vector away = p - centres_.row(i).transpose();
    out += coefficients_.row(i).transpose() * (slope_of(kernel_, away.squaredNorm()) * away.transpose());
  }
  return out / size_mm_;
}

template <int D>
std::optional<typename ThinPlateSpline<D>::Vector> ThinPlateSpline<D>::inverse(const Vector &value_mm,
                                                                               const Vector *start_mm) const noexcept {
  const Matrix affine = affine_.template bottomRows<D>().transpose() / size_mm_;
  Vector p = origin_;
  if (start_mm != nullptr) {
    p = *start_mm;
  } else {
    p += affine.inverse() * (value_mm - affine_.row(0).transpose());
  }
  Vector residual = (*this)(p)-value_mm;
  for (int step = 0; step < 50; ++step) {
    const Matrix J = jacobian(p);
    const Vector move = -(J.inverse() * residual);
    if (!move.allFinite()) {
      return std::nullopt;
    }
    double fraction = 1.0;
    Vector next = p + move;
    Vector next_residual = (*this)(next)-value_mm;
    while (next_residual.norm() > residual.norm() && fraction > 1e-3) {
      fraction *= 0.5;
      next = p + fraction * move;
      next_residual = (*this)(next)-value_mm;
    }
    p = next;
    residual = next_residual;
    if (fraction * move.norm() < 1e-9 * size_mm_) {
      const bool settled = residual.norm() < 1e-8 * size_mm_ * std::max(1.0, affine.norm());
      const bool folded = jacobian(p).determinant() * affine.determinant() <= 0.0;
      return settled && !folded ? std::optional<Vector>(p) : std::nullopt;
    }
  }
  return std::nullopt;
}

template <int D> Points<D> ThinPlateSpline<D>::centres_mm() const {
  return (size_mm_ * centres_.transpose()).colwise() + origin_;
}

template class ThinPlateSpline<2>;
template class ThinPlateSpline<3>;

} // namespace bregma::registration
