// The measuring volume that a tracker states: a frustum about its z axis, which points away from the camera.
#pragma once

#include <algorithm>
#include <cmath>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/geometry/points.hpp"

namespace bregma::server {

struct TrackerVolume {
  double near_mm = 950.0;
  double far_mm = 2400.0;
  double half_width_deg = 30.0;
  double half_height_deg = 26.0;

  // 1 on the border, larger outside. A margin covers the size of a body, of which only the markers must be inside.
  [[nodiscard]] double position(const geometry::Vector3d &point_mm) const noexcept {
    constexpr double kMargin_mm = 50.0;
    const double depth = std::max(point_mm.z(), 0.0);
    const double width = depth * std::tan(half_width_deg * geometry::kRadiansPerDegree) + kMargin_mm;
    const double height = depth * std::tan(half_height_deg * geometry::kRadiansPerDegree) + kMargin_mm;
    const double from_middle = std::abs(point_mm.z() - 0.5 * (near_mm + far_mm));
    return std::max({from_middle / (0.5 * std::abs(far_mm - near_mm) + kMargin_mm), std::abs(point_mm.x()) / width,
                     std::abs(point_mm.y()) / height});
  }
};

} // namespace bregma::server
