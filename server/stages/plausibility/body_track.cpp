#include "server/stages/plausibility/body_track.hpp"

#include <algorithm>
#include <cmath>

#include "algorithms/geometry/angles.hpp"

namespace bregma::server {
namespace {

// A minimum-jerk stroke of 0.4 m that reaches 2 m/s has a peak acceleration of 30 m/s^2: two sigma.
constexpr double kAcceleration_mm_s2 = 15'000.0;
constexpr double kUnknownSpeed_mm_s = 1'000.0; // 1 sigma of a coordinate: half of a hand's maximum
constexpr double kMaxTurn_rad_s = 20.0;        // a hand that flicks a tool

} // namespace

BodyTrack::State BodyTrack::predicted(std::int64_t time_ns) const noexcept {
  const double dt = 1e-9 * static_cast<double>(time_ns - last_.time_ns);
  const double q = kAcceleration_mm_s2 * kAcceleration_mm_s2 * dt * dt;
  State out = state_;
  out.position_mm += dt * state_.velocity_mm_s;
  out.pp += 2.0 * dt * state_.pv + dt * dt * state_.vv + 0.25 * q * dt * dt;
  out.pv += dt * state_.vv + 0.5 * q * dt;
  out.vv += q;
  return out;
}

double BodyTrack::test(const BodySample &sample) const noexcept {
  const State now = predicted(sample.time_ns);
  const double moved = (sample.point_mm - now.position_mm).squaredNorm() / (now.pp + sample.variance_mm2);
  const double dt = 1e-9 * static_cast<double>(sample.time_ns - last_.time_ns);
  const double scatter_rad = std::sqrt(kThreshold * (sample.rotation_variance + last_.rotation_variance));
  const double turned = geometry::angle_between(last_.rotation, sample.rotation) / (kMaxTurn_rad_s * dt + scatter_rad);
  return std::max(moved, kThreshold * turned * turned);
}

void BodyTrack::start(const BodySample &sample) noexcept {
  started_ = true;
  last_ = sample;
  state_ = {sample.point_mm, geometry::Vector3d::Zero(), sample.variance_mm2, 0.0,
            kUnknownSpeed_mm_s * kUnknownSpeed_mm_s};
}

void BodyTrack::update(const BodySample &sample) noexcept {
  State now = predicted(sample.time_ns);
  const double s = now.pp + sample.variance_mm2;
  const double gain = now.pp / s;
  const double velocity_gain = now.pv / s;
  const geometry::Vector3d innovation = sample.point_mm - now.position_mm;
  now.position_mm += gain * innovation;
  now.velocity_mm_s += velocity_gain * innovation;
  now.vv -= velocity_gain * now.pv;
  now.pv -= gain * now.pv;
  now.pp -= gain * now.pp;
  state_ = now;
  last_ = sample;
}

} // namespace bregma::server
