// Position and velocity of a tip from successive frames: a Kalman filter with constant velocity in Reference and each
// frame's own marker noise [Bar-Shalom 2001, sections 5.4 and 6.2].
//
// The tip of a single frame scatters by the markers' noise, enlarged by the lever from the markers to the tip. The
// filter follows motions up to its bandwidth and averages faster ones. A motion that it cannot follow appears as
// innovations on one side. Their running mean estimates the filter's bias, so its square is added to the covariance. A
// filter that has lost the hand restarts at the frame's position.
//
// One thread. No allocation, no exceptions.
#pragma once

#include <cstdint>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::server {

class TipFilter {
public:
  void reset() noexcept { frames_ = 0; }

  // noise: covariance of this frame's position from its markers only; positive definite. A time that is not after the
  // last one has no effect. After a gap the filter restarts.
  void add(const geometry::Vector3d &position_mm, const geometry::Matrix3d &noise, std::int64_t time_ns,
           double bandwidth_hz) noexcept;

  [[nodiscard]] const geometry::Vector3d &position_mm() const noexcept { return position_; }
  [[nodiscard]] geometry::Matrix3d covariance() const noexcept { return P_pp_ + bias_ * bias_.transpose(); }
  // Relation of the estimate's error to the frame's: its covariance with an error e of the frame is cov(e, frame) K'.
  [[nodiscard]] const geometry::Matrix3d &gain() const noexcept { return gain_; }
  // mm/s; NaN until enough frames have arrived.
  [[nodiscard]] geometry::Vector3d velocity_mm_s() const noexcept;

private:
  void start(const geometry::Vector3d &position_mm, const geometry::Matrix3d &noise) noexcept;

  std::int64_t frames_ = 0; // since the start
  std::int64_t time_ns_ = 0;
  geometry::Vector3d position_ = geometry::Vector3d::Zero();
  geometry::Vector3d velocity_ = geometry::Vector3d::Zero();
  geometry::Matrix3d P_pp_ = geometry::Matrix3d::Zero();
  geometry::Matrix3d P_pv_ = geometry::Matrix3d::Zero();
  geometry::Matrix3d P_vv_ = geometry::Matrix3d::Zero();
  geometry::Matrix3d gain_ = geometry::Matrix3d::Identity();
  geometry::Vector3d bias_ = geometry::Vector3d::Zero();     // running mean of the innovations
  geometry::Vector3d whitened_ = geometry::Vector3d::Zero(); // the same in units of their standard deviation
};

} // namespace bregma::server
