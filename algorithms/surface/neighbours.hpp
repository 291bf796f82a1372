// Pairs of samples whose errors are correlated because they are close together: rho = exp(-d^2 / 2 l^2).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>
#include <vector>

#include <Eigen/Core>

namespace bregma::surface {

// Owns its memory: set() and each() do not allocate up to the capacity. One thread at a time.
class Neighbours {
public:
  // length_mm 0: no sample has a neighbour.
  Neighbours(double length_mm, std::size_t capacity) : length_(length_mm), order_(capacity), points_(capacity) {
    for (std::size_t i = 0; i < kSteps; ++i) {
      const double middle = (static_cast<double>(i) + 0.5) / static_cast<double>(kSteps);
      correlation_[i] = std::exp(-0.5 * kCutoff * kCutoff * middle);
    }
  }

  void set(std::span<const Eigen::Vector3d> points_mm) noexcept {
    count_ = length_ > 0.0 ? std::min(points_mm.size(), points_.size()) : 0;
    for (std::size_t i = 0; i < count_; ++i) {
      order_[i] = {static_cast<float>(points_mm[i].x()), i};
    }
    std::sort(order_.begin(), order_.begin() + static_cast<std::ptrdiff_t>(count_));
    for (std::size_t i = 0; i < count_; ++i) {
      points_[i] = points_mm[order_[i].second].cast<float>();
    }
  }

  // Calls visit(i, j, rho) once for every pair; all pairs of one i are consecutive.
  template <class Visit> void each(Visit &&visit) const {
    const auto reach = static_cast<float>(length_) * kCutoff;
    const float limit = reach * reach;
    for (std::size_t a = 0; a < count_; ++a) {
      // Samples are sorted by x: no further sample is in reach.
      for (std::size_t b = a + 1; b < count_ && points_[b].x() - points_[a].x() < reach; ++b) {
        const float d2 = (points_[b] - points_[a]).squaredNorm();
        if (d2 < limit) {
          visit(order_[a].second, order_[b].second,
                correlation_[static_cast<std::size_t>(d2 / limit * static_cast<float>(kSteps))]);
        }
      }
    }
  }

private:
  static constexpr float kCutoff = 3.0F; // in correlation lengths; beyond it rho is below 0.012
  static constexpr std::size_t kSteps = 1024;
  double length_;
  std::size_t count_ = 0;
  std::vector<std::pair<float, std::size_t>> order_;
  std::vector<Eigen::Vector3f> points_;
  std::array<double, kSteps + 1> correlation_{}; // by squared distance; the last entry is never in reach
};

} // namespace bregma::surface
