// Angular velocity of a tool in Reference from successive frames, and the error that its rotation has when it is
// published some time after its exposure. A state contains the rotation of its frame: it is not predicted, because the
// markers' noise would be predicted too.
//
// One thread. No allocation, no exceptions.
#pragma once

#include <cmath>
#include <cstdint>

#include <Eigen/Geometry>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::server {

class TurnRate {
public:
  static constexpr double kMemory_s = 0.05;               // time constant of the mean
  static constexpr std::int64_t kMaxGap_ns = 100'000'000; // after a longer gap the known motion is void
  // Of a turn that the mean does not know yet, 1 sigma about an axis: a flick of 0.5 rad in 0.4 s peaks at twice that.
  static constexpr double kAcceleration_rad_s2 = 10.0;

  void reset() noexcept { started_ = false; }

  // A time that is not after the last one has no effect.
  void add(const Eigen::Quaterniond &rotation, std::int64_t time_ns) noexcept {
    const std::int64_t elapsed_ns = time_ns - time_ns_;
    if (started_ && elapsed_ns <= 0) {
      return;
    }
    if (!started_ || elapsed_ns > kMaxGap_ns) {
      rate_rad_s_.setZero();
    } else {
      const double dt = 1e-9 * static_cast<double>(elapsed_ns);
      const Eigen::AngleAxisd turn(rotation * rotation_.conjugate());
      rate_rad_s_ += (1.0 - std::exp(-dt / kMemory_s)) * (turn.angle() / dt * turn.axis() - rate_rad_s_);
    }
    started_ = true;
    time_ns_ = time_ns;
    rotation_ = rotation;
  }

  // Covariance of the rotation after age_s, in addition to that of the frame: rad^2, axes of Reference.
  [[nodiscard]] geometry::Matrix3d growth(double age_s) const noexcept {
    const geometry::Vector3d turned = age_s * rate_rad_s_;
    const double unknown = 0.5 * kAcceleration_rad_s2 * age_s * age_s;
    return turned * turned.transpose() + unknown * unknown * geometry::Matrix3d::Identity();
  }

private:
  bool started_ = false;
  std::int64_t time_ns_ = 0;
  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity();
  geometry::Vector3d rate_rad_s_ = geometry::Vector3d::Zero();
};

} // namespace bregma::server
