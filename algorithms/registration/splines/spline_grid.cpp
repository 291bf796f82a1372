#include "algorithms/registration/splines/spline_grid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>
#include <thread>

namespace bregma::registration {

using geometry::Points;

namespace {

constexpr Eigen::Index kNodesAtOnce = 4096;
constexpr Eigen::Index kCheckedCentres = 2000;
constexpr Eigen::Index kCheckedPoints = 4000; // in total
constexpr unsigned kCheckSeed = 1;

// Lagrange weights of nodes -1, 0, 1, 2 at t.
std::array<double, 4> cubic_weights(double t) {
  return {-t * (t - 1.0) * (t - 2.0) / 6.0, (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0, -(t + 1.0) * t * (t - 2.0) / 2.0,
          (t + 1.0) * t * (t - 1.0) / 6.0};
}

} // namespace

template <int D>
SplineGrid<D>::SplineGrid(const ThinPlateSpline<D> &spline, const Vector &low_mm, const Vector &high_mm,
                          double spacing_mm, int threads)
    : spline_(spline), low_(low_mm), high_(high_mm) {
  if (!low_.allFinite() || !high_.allFinite() || !((high_ - low_).minCoeff() > 0.0) || !(spacing_mm > 0.0)) {
    throw std::invalid_argument("a spline's grid needs a box with extent and a spacing above 0");
  }
  // At least three cells, since a cubic needs four nodes.
  const Vector cells = ((high_ - low_) / spacing_mm).array().ceil().max(3.0);
  if ((cells.array() + 1.0).prod() > static_cast<double>(kMaxGridNodes)) {
    throw std::invalid_argument("a spline's grid of more than " + std::to_string(kMaxGridNodes) + " nodes");
  }
  size_ = (cells.array() + 1.0).template cast<Eigen::Index>();
  spacing_ = (high_ - low_).cwiseQuotient(cells);
  values_.resize(D, size_.prod());
  const auto run = [&](Eigen::Index first) {
    for (Eigen::Index begin = first; begin < nodes(); begin += std::max(threads, 1) * kNodesAtOnce) {
      Points<D> at(D, std::min(kNodesAtOnce, nodes() - begin));
      for (Eigen::Index i = 0; i < at.cols(); ++i) {
        Eigen::Index rest = begin + i;
        for (int d = 0; d < D; ++d) {
          at(d, i) = low_[d] + spacing_[d] * static_cast<double>(rest % size_[d]);
          rest /= size_[d];
        }
      }
      values_.middleCols(begin, at.cols()) = spline_.map(at);
    }
  };
  {
    std::vector<std::jthread> others;
    for (int i = 1; i < threads; ++i) {
      others.emplace_back(run, i * kNodesAtOnce);
    }
    run(0);
  }
  measure_error();
}

template <int D> void SplineGrid<D>::measure_error() {
  const Points<D> centres = spline_.centres_mm();
  Points<D> places(D, kCheckedPoints);
  Eigen::Index count = 0;
  const Eigen::Index stride = (centres.cols() + kCheckedCentres - 1) / kCheckedCentres;
  for (Eigen::Index i = 0; i < centres.cols(); i += stride) {
    if ((centres.col(i).array() >= low_.array()).all() && (centres.col(i).array() <= high_.array()).all()) {
      places.col(count++) = centres.col(i);
    }
  }
  std::mt19937 rng(kCheckSeed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (; count < kCheckedPoints; ++count) {
    for (int d = 0; d < D; ++d) {
      places(d, count) = low_[d] + unit(rng) * (high_[d] - low_[d]);
    }
  }
  const Points<D> exact = spline_.map(places);
  double squares = 0.0;
  for (Eigen::Index i = 0; i < count; ++i) {
    const double error = ((*this)(places.col(i)) - exact.col(i)).norm();
    largest_error_mm_ = std::max(largest_error_mm_, error);
    squares += error * error;
  }
  rms_error_mm_ = std::sqrt(squares / static_cast<double>(count));
}

template <int D> typename SplineGrid<D>::Vector SplineGrid<D>::operator()(const Vector &point_mm) const {
  std::array<Eigen::Index, D> first{};
  std::array<std::array<double, 4>, D> weights{};
  for (std::size_t d = 0; d < static_cast<std::size_t>(D); ++d) {
    const auto axis = static_cast<Eigen::Index>(d);
    const double at = (point_mm[axis] - low_[axis]) / spacing_[axis];
    if (!(at >= 0.0 && at <= static_cast<double>(size_[axis] - 1))) {
      return spline_(point_mm);
    }
    // The outermost cells use the polynomial of their inner neighbours.
    const Eigen::Index cell = std::clamp<Eigen::Index>(static_cast<Eigen::Index>(at), 1, size_[axis] - 3);
    first[d] = cell - 1;
    weights[d] = cubic_weights(at - static_cast<double>(cell));
  }
  Vector out = Vector::Zero();
  const auto add_row = [&](Eigen::Index start, double weight) {
    const double *v = values_.data() + D * start;
    for (std::size_t i = 0; i < 4; ++i) {
      for (int d = 0; d < D; ++d) {
        out[d] += weight * weights[0][i] * v[D * static_cast<int>(i) + d];
      }
    }
  };
  for (Eigen::Index j = 0; j < 4; ++j) {
    const double wj = weights[1][static_cast<std::size_t>(j)];
    if constexpr (D == 2) {
      add_row(first[0] + size_[0] * (first[1] + j), wj);
    } else {
      for (Eigen::Index k = 0; k < 4; ++k) {
        add_row(first[0] + size_[0] * (first[1] + j + size_[1] * (first[2] + k)),
                wj * weights[2][static_cast<std::size_t>(k)]);
      }
    }
  }
  return out;
}

template class SplineGrid<2>;
template class SplineGrid<3>;

} // namespace bregma::registration
