// Position of a tool relative to the planned line. All points in one frame (usually Image), mm.
#pragma once

#include <Eigen/Core>

namespace bregma::planning {

struct PlannedLine {
  Eigen::Vector3d entry_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d target_mm = Eigen::Vector3d::Zero(); // at least 1e-6 mm from the entry; otherwise the results are NaN
};

struct Guidance {
  double distance_to_target_mm = 0.0;
  double lateral_deviation_mm = 0.0; // distance of the tip from the infinite planned line
  double angle_rad = 0.0;            // between the tool's axis and entry-to-target, 0 to pi
  double remaining_depth_mm = 0.0;   // along the planned line; negative beyond the target
};

// axis: direction of the tool towards its tip, unit. Pure, no allocation.
[[nodiscard]] Guidance guide(const PlannedLine &line, const Eigen::Vector3d &tip_mm,
                             const Eigen::Vector3d &axis) noexcept;

} // namespace bregma::planning
