// By how much a triangulating range sensor reads too far on tilted skin: excess * (1 - cos(tilt)), with two slopes over
// the normal's parts across the beam, because such a sensor looks from one side.
#pragma once

#include <algorithm>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace bregma::registration {

inline constexpr double kExcessSlopes = 0.5; // 1 sigma of the slopes, over that of the excess

// What excess and slopes (mm) are multiplied with on skin of this outward normal. towards_sensor and across: unit,
// perpendicular to each other, in the frame of the normal; across is fixed in the sensor.
[[nodiscard]] inline Eigen::Vector3d excess_terms(const Eigen::Vector3d &normal, const Eigen::Vector3d &towards_sensor,
                                                  const Eigen::Vector3d &across) {
  const double tilted = 1.0 - std::clamp(normal.dot(towards_sensor), 0.0, 1.0);
  return tilted * Eigen::Vector3d(1.0, normal.dot(across), normal.dot(towards_sensor.cross(across)));
}

} // namespace bregma::registration
