// The pose of the tool on an arm's flange: kinematics, calibration and, with a valid registration, the scanner.
//
//   T_base_tip = T_base_flange T_flange_tip          T_scanner_tip = (T_base_scanner)^-1 T_base_tip
//
// The tip's frame has its origin at the tip and its z axis along the tool, from the flange towards the tip. A pose is
// live as long as every pose of the daemon (idl/validity.hpp); otherwise it is NaN. Units: mm, rad, ns UTC.
// Threads: any. No allocation, no exceptions.
#pragma once

#include <cstdint>
#include <span>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/mri/frames.hpp"
#include "idl/topics.hpp"
#include "server/stages/views.hpp"

namespace bregma::server {

struct RobotToolCalibration {
  wire::Name name{};
  geometry::UncertainPose<geometry::frame::RobotFlange, geometry::frame::Tip> T_flange_tip;
};

struct ToolPoseOptions {
  // 1 sigma of the flange per coordinate and axis, for an arm that states no covariance.
  double flange_sigma_mm = 0.2;
  double flange_sigma_rad = 0.001;
};

// Covariance of a flange in Base: as stated by the arm; otherwise that of the options, about the flange's origin.
[[nodiscard]] geometry::Matrix6d flange_covariance(const wire::PoseCovariance &stated,
                                                   const geometry::Vector3d &origin_mm,
                                                   const ToolPoseOptions &options) noexcept;

// tools: all calibrated ones. default_tool: for an arm that states none; empty: none. An arm in another mode is shown
// as well: its kinematics are measured.
[[nodiscard]] wire::RobotTool tool_pose(const RobotView &robot, std::span<const RobotToolCalibration> tools,
                                        const wire::Name &default_tool, const ScannerPoseView &scanner,
                                        const ToolPoseOptions &options, std::int64_t now_ns) noexcept;

} // namespace bregma::server
