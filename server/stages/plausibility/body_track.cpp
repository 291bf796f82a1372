#include "server/stages/plausibility/body_track.hpp"

#include <cmath>

#include "algorithms/geometry/angles.hpp"

namespace bregma::server {
namespace {

// A minimum-jerk stroke of 0.4 m that reaches 2 m/s has a peak acceleration of 30 m/s^2: two sigma.
constexpr double kAcceleration_mm_s2 = 15'000.0;
constexpr double kUnknownSpeed_mm_s = 1'000.0; // 1 sigma of a coordinate: half of a hand's maximum
constexpr double kMaxTurn_rad_s = 20.0;        // a hand that flicks a tool

// Squared ratio of a displacement to the largest that is allowed besides the scatter, on the scale of Motion.
double relative(double displacement, double allowed, double variance) noexcept {
  const double ratio = displacement / (allowed + std::sqrt(Motion::kThreshold * variance));
  return Motion::kThreshold * ratio * ratio;
}

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

Motion BodyTrack::by_hand(const BodySample &sample) const noexcept {
  const State now = predicted(sample.time_ns);
  const double dt = 1e-9 * static_cast<double>(sample.time_ns - last_.time_ns);
  return {(sample.point_mm - now.position_mm).squaredNorm() / (now.pp + sample.variance_mm2),
          relative(geometry::angle_between(last_.rotation, sample.rotation), kMaxTurn_rad_s * dt,
                   sample.rotation_variance + last_.rotation_variance)};
}

Motion BodyTrack::from_rest(const BodySample &sample) const noexcept {
  return {relative((sample.point_mm - last_.point_mm).norm(), kRest_mm, sample.variance_mm2 + last_.variance_mm2),
          relative(geometry::angle_between(last_.rotation, sample.rotation), kRest_rad,
                   sample.rotation_variance + last_.rotation_variance)};
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
