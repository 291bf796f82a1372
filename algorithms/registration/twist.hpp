// Twists about a centre near the data: about an origin two metres away the normal equations of a fit lose precision.
#pragma once

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::registration {

// T after the small motion (rotation w about centre, then translation v), both in the target frame.
template <class Target, class Source>
[[nodiscard]] geometry::Rigid3<Target, Source>
moved_about(const Eigen::Vector3d &centre, const geometry::Vector6d &twist, const geometry::Rigid3<Target, Source> &T) {
  const Eigen::Quaterniond dR = geometry::rotation_exp(twist.head<3>());
  return {dR * T.rotation(), dR * (T.translation() - centre) + centre + twist.tail<3>()};
}

// The twist about the origin of a twist about centre.
[[nodiscard]] inline geometry::Matrix6d twist_to_origin(const Eigen::Vector3d &centre) {
  geometry::Matrix6d out = geometry::Matrix6d::Identity();
  out.bottomLeftCorner<3, 3>() = geometry::skew(centre);
  return out;
}

[[nodiscard]] inline geometry::Matrix6d covariance_at_origin(const geometry::Matrix6d &about_centre,
                                                             const Eigen::Vector3d &centre) {
  const geometry::Matrix6d M = twist_to_origin(centre);
  return M * about_centre * M.transpose();
}

} // namespace bregma::registration
