#include "server/stages/navigation/tip_filter.hpp"

#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>

#include "algorithms/geometry/unknown.hpp"

namespace bregma::server {
namespace {

using geometry::Matrix3d;
using geometry::Vector3d;

constexpr double kStartSpeed_mm_s = 300.0;       // standard deviation: a hand may be moving when it is first seen
constexpr std::int64_t kMaxGap_ns = 100'000'000; // after a longer gap the known motion is void
constexpr double kMemory = 0.2;                  // weight of the newest innovation in the running mean
constexpr double kLost = 21.1;                   // chi-square, 3 degrees of freedom, 99.99 %
constexpr std::int64_t kFramesForVelocity = 5;

} // namespace

void TipFilter::start(const Vector3d &position_mm, const Matrix3d &noise) noexcept {
  frames_ = 1;
  position_ = position_mm;
  velocity_.setZero();
  P_pp_ = noise;
  P_pv_.setZero();
  P_vv_ = Matrix3d::Identity() * kStartSpeed_mm_s * kStartSpeed_mm_s;
  gain_.setIdentity();
  bias_.setZero();
  whitened_.setZero();
}

void TipFilter::add(const Vector3d &position_mm, const Matrix3d &noise, std::int64_t time_ns,
                    double bandwidth_hz) noexcept {
  const std::int64_t elapsed_ns = time_ns - time_ns_;
  if (frames_ > 0 && elapsed_ns <= 0) {
    return;
  }
  time_ns_ = time_ns;
  if (frames_ == 0 || elapsed_ns > kMaxGap_ns) {
    start(position_mm, noise);
    return;
  }
  // In the steady state the filter's bandwidth is (q / r)^(1/4), q and r the densities of acceleration and noise.
  const double dt = 1e-9 * static_cast<double>(elapsed_ns);
  const double q = noise.trace() / 3.0 * dt * std::pow(2.0 * std::numbers::pi * bandwidth_hz, 4);
  position_ += dt * velocity_;
  P_pp_ += dt * (P_pv_ + P_pv_.transpose()) + dt * dt * P_vv_ + Matrix3d::Identity() * (q * dt * dt * dt / 3.0);
  P_pv_ += dt * P_vv_ + Matrix3d::Identity() * (q * dt * dt / 2.0);
  P_vv_ += Matrix3d::Identity() * (q * dt);

  const Vector3d innovation = position_mm - position_;
  const Eigen::LLT<Matrix3d> S(P_pp_ + noise);
  bias_ += kMemory * (innovation - bias_);
  whitened_ += kMemory * (S.matrixL().solve(innovation) - whitened_);
  if (whitened_.squaredNorm() * (2.0 - kMemory) / kMemory > kLost) {
    start(position_mm, noise);
    return;
  }
  gain_ = S.solve(P_pp_).transpose();
  const Matrix3d velocity_gain = S.solve(P_pv_).transpose();
  position_ += gain_ * innovation;
  velocity_ += velocity_gain * innovation;
  P_vv_ -= velocity_gain * P_pv_;
  P_pv_ -= gain_ * P_pv_;
  P_pp_ -= gain_ * P_pp_;
  P_pp_ = 0.5 * (P_pp_ + P_pp_.transpose().eval());
  P_vv_ = 0.5 * (P_vv_ + P_vv_.transpose().eval());
  ++frames_;
}

Vector3d TipFilter::velocity_mm_s() const noexcept {
  return frames_ >= kFramesForVelocity ? velocity_ : Vector3d::Constant(geometry::kUnknown);
}

} // namespace bregma::server
