#include "server/stages/navigation/tip_filter.hpp"

#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>

namespace bregma::server {
namespace {

using geometry::Matrix3d;
using geometry::Vector3d;

constexpr double kStartSpeed_mm_s = 300.0;       // standard deviation: a hand may be moving when it is first seen
constexpr std::int64_t kMaxGap_ns = 100'000'000; // after a longer gap the known motion is void
constexpr double kMemory = 0.2;                  // weight of the newest innovation in the running mean
constexpr double kLost = 21.1;                   // chi-square, 3 degrees of freedom, 99.99 %

} // namespace

MovingPoint MovingPoint::after(double dt_s, double acceleration_sigma_mm_s2) const noexcept {
  const double dt = dt_s;
  const Matrix3d A = Matrix3d::Identity() * (acceleration_sigma_mm_s2 * acceleration_sigma_mm_s2);
  MovingPoint out;
  out.position_mm = position_mm + dt * velocity_mm_s;
  out.velocity_mm_s = velocity_mm_s;
  out.P = P + dt * (C + C.transpose()) + dt * dt * V + (0.25 * dt * dt * dt * dt) * A;
  out.C = C + dt * V + (0.5 * dt * dt * dt) * A;
  out.V = V + dt * dt * A;
  return out;
}

void TipFilter::start(const Vector3d &position_mm, const Matrix3d &noise) noexcept {
  frames_ = 1;
  measured_ = position_ = position_mm;
  velocity_.setZero();
  noise_ = P_pp_ = noise;
  P_pv_.setZero();
  P_vv_ = Matrix3d::Identity() * kStartSpeed_mm_s * kStartSpeed_mm_s;
  gain_.setIdentity();
  velocity_gain_.setZero();
  bias_.setZero();
  whitened_.setZero();
}

void TipFilter::add(const Vector3d &position_mm, const Matrix3d &noise, std::int64_t time_ns,
                    double bandwidth_hz) noexcept {
  const std::int64_t elapsed_ns = time_ns - time_ns_;
  if ((frames_ > 0 && elapsed_ns <= 0) || !position_mm.allFinite() || !noise.allFinite()) {
    return;
  }
  time_ns_ = time_ns;
  bandwidth_rad_s_ = 2.0 * std::numbers::pi * bandwidth_hz;
  if (frames_ == 0 || elapsed_ns > kMaxGap_ns) {
    start(position_mm, noise);
    return;
  }
  // In the steady state the filter's bandwidth is (q / r)^(1/4), q and r the densities of acceleration and noise.
  const double dt = 1e-9 * static_cast<double>(elapsed_ns);
  const double q = noise.trace() / 3.0 * dt * std::pow(bandwidth_rad_s_, 4);
  position_ += dt * velocity_;
  P_pp_ += dt * (P_pv_ + P_pv_.transpose()) + dt * dt * P_vv_ + Matrix3d::Identity() * (q * dt * dt * dt / 3.0);
  P_pv_ += dt * P_vv_ + Matrix3d::Identity() * (q * dt * dt / 2.0);
  P_vv_ += Matrix3d::Identity() * (q * dt);

  const Vector3d innovation = position_mm - position_;
  const Eigen::LLT<Matrix3d> S(P_pp_ + noise);
  bias_ += kMemory * (innovation - bias_);
  whitened_ += kMemory * (S.matrixL().solve(innovation) - whitened_);
  // Negated, so that a state that is not finite (noise that is not positive definite) restarts too.
  if (!(whitened_.squaredNorm() * (2.0 - kMemory) / kMemory <= kLost)) {
    start(position_mm, noise);
    return;
  }
  measured_ = position_mm;
  noise_ = noise;
  gain_ = S.solve(P_pp_).transpose();
  velocity_gain_ = S.solve(P_pv_).transpose();
  position_ += gain_ * innovation;
  velocity_ += velocity_gain_ * innovation;
  P_vv_ -= velocity_gain_ * P_pv_;
  P_pv_ -= gain_ * P_pv_;
  P_pp_ -= gain_ * P_pp_;
  P_pp_ = 0.5 * (P_pp_ + P_pp_.transpose().eval());
  P_vv_ = 0.5 * (P_vv_ + P_vv_.transpose().eval());
  ++frames_;
}

MovingPoint TipFilter::estimate() const noexcept {
  const Matrix3d lag = bias_ * bias_.transpose();
  const double velocity_lag = std::numbers::sqrt2 * bandwidth_rad_s_; // per lag of the position
  return {position_, velocity_, P_pp_ + lag, P_pv_ + velocity_lag * lag, P_vv_ + velocity_lag * velocity_lag * lag};
}

MovingPoint TipFilter::unfiltered() const noexcept {
  MovingPoint out = estimate();
  out.position_mm = measured_;
  out.P = noise_;
  out.C = noise_ * velocity_gain_.transpose();
  return out;
}

} // namespace bregma::server
