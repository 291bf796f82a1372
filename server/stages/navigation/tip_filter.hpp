// Position and velocity of a tip from successive frames: a Kalman filter with constant velocity in Reference and each
// frame's own marker noise [Bar-Shalom 2001, sections 5.4 and 6.2].
//
// The tip of a single frame scatters by the markers' noise, enlarged by the lever from the markers to the tip. The
// filter follows motions up to its bandwidth and averages faster ones. A motion that it cannot follow appears as
// innovations on one side. Their running mean b estimates the filter's lag. In the steady state a constant acceleration
// causes the lag b of the position and sqrt(2) w b of the velocity, w the bandwidth, so both are added to the
// covariance. A filter that has lost the hand restarts at the frame's position.
//
// One thread. No allocation, no exceptions.
#pragma once

#include <cstdint>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::server {

// A moving point with the covariances of its position (P), of its velocity (V) and between them (C).
struct MovingPoint {
  geometry::Vector3d position_mm = geometry::Vector3d::Zero();
  geometry::Vector3d velocity_mm_s = geometry::Vector3d::Zero();
  geometry::Matrix3d P = geometry::Matrix3d::Zero();
  geometry::Matrix3d C = geometry::Matrix3d::Zero();
  geometry::Matrix3d V = geometry::Matrix3d::Zero();

  // The point after dt with an unknown constant acceleration, whose standard deviation per coordinate is given.
  [[nodiscard]] MovingPoint after(double dt_s, double acceleration_sigma_mm_s2) const noexcept;
};

class TipFilter {
public:
  void reset() noexcept { frames_ = 0; }

  // noise: covariance of this frame's position from its markers only. A time that is not after the last one, or a
  // position or noise that is not finite, has no effect. After a gap the filter restarts.
  void add(const geometry::Vector3d &position_mm, const geometry::Matrix3d &noise, std::int64_t time_ns,
           double bandwidth_hz) noexcept;

  // At the last frame. A filter that has just started knows that a hand moves, but not where to: velocity 0 with a
  // large covariance.
  [[nodiscard]] MovingPoint estimate() const noexcept;
  // The position of the last frame itself with the filter's velocity.
  [[nodiscard]] MovingPoint unfiltered() const noexcept;
  // Relation of the estimate's error to the frame's: its covariance with an error e of the frame is cov(e, frame) K'.
  [[nodiscard]] const geometry::Matrix3d &gain() const noexcept { return gain_; }

private:
  void start(const geometry::Vector3d &position_mm, const geometry::Matrix3d &noise) noexcept;

  std::int64_t frames_ = 0; // since the start
  std::int64_t time_ns_ = 0;
  double bandwidth_rad_s_ = 0.0;
  geometry::Vector3d measured_ = geometry::Vector3d::Zero(); // the last frame
  geometry::Matrix3d noise_ = geometry::Matrix3d::Zero();
  geometry::Vector3d position_ = geometry::Vector3d::Zero();
  geometry::Vector3d velocity_ = geometry::Vector3d::Zero();
  geometry::Matrix3d P_pp_ = geometry::Matrix3d::Zero();
  geometry::Matrix3d P_pv_ = geometry::Matrix3d::Zero();
  geometry::Matrix3d P_vv_ = geometry::Matrix3d::Zero();
  geometry::Matrix3d gain_ = geometry::Matrix3d::Identity();
  geometry::Matrix3d velocity_gain_ = geometry::Matrix3d::Zero();
  geometry::Vector3d bias_ = geometry::Vector3d::Zero();     // running mean of the innovations
  geometry::Vector3d whitened_ = geometry::Vector3d::Zero(); // the same in units of their standard deviation
};

} // namespace bregma::server
