#include "drivers/sim/probed_brain.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::sim {

namespace {

constexpr double kPoisson = 0.45;
constexpr double kSlow_mm_s = 0.5; // below this speed cutting and friction decrease to zero: sticking is not modelled

} // namespace

ProbedBrain::ProbedBrain(const surface::TriangleMesh &brain, const TissueParameters &parameters)
    : parameters_(parameters) {
  if (!brain.triangles.empty()) {
    surface_.emplace(brain);
  }
  const double plane_N_per_mm2 = 1e-6 * parameters.young_Pa / (1.0 - kPoisson * kPoisson);
  hertz_N_per_mm15_ = 4.0 / 3.0 * plane_N_per_mm2 * std::sqrt(parameters.tip_radius_mm);
}

double ProbedBrain::force_N(const Eigen::Vector3d &tip_mm, double speed_mm_s) {
  if (!surface_) {
    return 0.0;
  }
  const surface::SurfacePoint nearest = surface_->closest(tip_mm);
  const double depth_mm = -nearest.signed_mm;
  if (depth_mm <= 0.0) {
    ruptured_ = false;
    return 0.0;
  }
  if (!ruptured_) {
    const double dent_N = hertz_N_per_mm15_ * std::pow(depth_mm, 1.5);
    ruptured_ = std::any_of(holes_mm_.begin(), holes_mm_.end(), [&](const Eigen::Vector3d &hole) {
      return (hole - nearest.point_mm).norm() < parameters_.tip_radius_mm;
    });
    if (!ruptured_ && dent_N < parameters_.rupture_N) {
      return dent_N;
    }
    if (!ruptured_) {
      holes_mm_.push_back(nearest.point_mm);
      ruptured_ = true;
    }
  }
  const double against = speed_mm_s / (std::abs(speed_mm_s) + kSlow_mm_s);
  const double cutting_N = speed_mm_s > 0.0 ? parameters_.cutting_N : 0.0;
  return against * (cutting_N + parameters_.friction_N_per_mm * depth_mm);
}

} // namespace bregma::sim
