// Motion of a hand in tests.
#pragma once

#include <random>

#include "algorithms/geometry/points.hpp"
#include "drivers/sim/motion.hpp"

namespace bregma::server::tracking_test {

// Strokes of a hand that the filter does not know: straight minimum-jerk movements of up to 0.5 m/s with pauses.
class Strokes {
public:
  explicit Strokes(unsigned seed) : rng_(seed) {}
  // Time must increase.
  geometry::Vector3d at(double time_s) {
    while (time_s >= begin_s_ + duration_s_ + pause_s_) {
      begin_s_ += duration_s_ + pause_s_;
      from_mm_ = to_mm_;
      std::normal_distribution<double> normal;
      using geometry::Vector3d;
      const auto uniform = [this](double low, double high) {
        return std::uniform_real_distribution<double>(low, high)(rng_);
      };
      do {
        const Vector3d direction = Vector3d(normal(rng_), normal(rng_), normal(rng_)).normalized();
        to_mm_ = from_mm_ + uniform(10.0, 250.0) * direction;
      } while (to_mm_.norm() > 200.0);
      duration_s_ = 1.875 * (to_mm_ - from_mm_).norm() / uniform(50.0, 500.0); // 1.875: peak over mean speed
      pause_s_ = uniform(0.0, 0.4);
    }
    return from_mm_ + sim::minimum_jerk((time_s - begin_s_) / duration_s_) * (to_mm_ - from_mm_);
  }

private:
  std::mt19937 rng_;
  double begin_s_ = 0.0, duration_s_ = 0.0, pause_s_ = 0.0;
  geometry::Vector3d from_mm_ = geometry::Vector3d::Zero();
  geometry::Vector3d to_mm_ = geometry::Vector3d::Zero();
};

} // namespace bregma::server::tracking_test
