#include "algorithms/planning/trajectory_guidance.hpp"

#include <cmath>

#include <Eigen/Geometry>

#include "algorithms/geometry/unknown.hpp"

namespace bregma::planning {

Guidance guide(const PlannedLine &line, const Eigen::Vector3d &tip_mm, const Eigen::Vector3d &axis) noexcept {
  constexpr double kMinLength_mm = 1e-6;
  const Eigen::Vector3d to_target = line.target_mm - tip_mm;
  const Eigen::Vector3d planned = line.target_mm - line.entry_mm;
  const double length = planned.norm();
  if (!(length > kMinLength_mm)) {
    return {to_target.norm(), geometry::kUnknown, geometry::kUnknown, geometry::kUnknown};
  }
  const Eigen::Vector3d direction = planned / length;
  const double remaining = to_target.dot(direction);
  return {to_target.norm(), (to_target - remaining * direction).norm(),
          // Exact near 0 and pi, where the arc cosine of the scalar product is not.
          std::atan2(axis.cross(direction).norm(), axis.dot(direction)), remaining};
}

} // namespace bregma::planning
