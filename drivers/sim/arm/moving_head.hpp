// A head before an arm that moves: from where it rests, by a displacement about its middle.
//
// RobotBase, Image; mm, rad, ns of the caller's clock. Const members from any thread.
#pragma once

#include <algorithm>
#include <cstdint>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/geometry/rigid3.hpp"

namespace bregma::sim {

using BaseImage = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::Image>;

class MovingHead {
public:
  MovingHead() = default;
  // middle_mm: in Image.
  MovingHead(const BaseImage &resting, const geometry::Vector3d &middle_mm)
      : resting_(resting), middle_mm_(resting * middle_mm) {}

  // From now on, within this time, smoothly to this displacement from the rest: turn about the middle, then its way.
  void move(const geometry::Vector6d &to, double seconds, std::int64_t now_ns) {
    from_ = displacement(now_ns);
    to_ = to;
    begin_ns_ = now_ns;
    duration_ns_ = std::max<std::int64_t>(1, static_cast<std::int64_t>(1e9 * seconds));
  }
  [[nodiscard]] BaseImage at(std::int64_t now_ns) const {
    const geometry::Vector6d moved = displacement(now_ns);
    const Eigen::Quaterniond turn = geometry::rotation_exp(moved.head<3>());
    return {turn * resting_.rotation(), middle_mm_ + moved.tail<3>() + turn * (resting_.translation() - middle_mm_)};
  }

private:
  [[nodiscard]] geometry::Vector6d displacement(std::int64_t now_ns) const {
    const double part =
        std::clamp(static_cast<double>(now_ns - begin_ns_) / static_cast<double>(duration_ns_), 0.0, 1.0);
    return from_ + part * part * (3.0 - 2.0 * part) * (to_ - from_);
  }

  BaseImage resting_;
  geometry::Vector3d middle_mm_ = geometry::Vector3d::Zero(); // in RobotBase, at rest
  geometry::Vector6d from_ = geometry::Vector6d::Zero(), to_ = geometry::Vector6d::Zero();
  std::int64_t begin_ns_ = 0, duration_ns_ = 1;
};

} // namespace bregma::sim
