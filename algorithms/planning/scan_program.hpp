// The raster over a face at constant height [NeuroGuide], as positions of a sensor, as poses of the flange that carries
// it, and as G-code.
//
// Frame: RobotBase, z up from the table, mm. Pure functions; any thread.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/robot/arm_model.hpp"

namespace bregma::planning {

struct RasterScan {
  double from_x_mm = 0.0, to_x_mm = 0.0; // along the lines
  double from_y_mm = 0.0, to_y_mm = 0.0; // across
  double height_mm = 200.0;              // of the sensor above the table
  double table_z_mm = 0.0;
  double line_mm = 5.0; // between lines
};

// The ends of all lines, there and back. Throws std::invalid_argument with the value: an area without extent, a line
// distance that is not positive, more than 10,000 lines.
[[nodiscard]] std::vector<Eigen::Vector3d> raster_corners(const RasterScan &scan);
// Length of the way over all positions.
[[nodiscard]] double length_mm(std::span<const Eigen::Vector3d> positions);

// Where the sensor sits on the flange: the origin of its beam, and the beam's direction (unit), in RobotFlange.
struct MountedSensor {
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
};
// The flange whose sensor is at the position and looks straight down; turned by yaw_rad about the beam.
[[nodiscard]] robot::FlangePose flange_above(const Eigen::Vector3d &sensor_mm, const MountedSensor &sensor,
                                             double yaw_rad);

// The positions of the sensor as a program in G-code (ISO 6983): mm, absolute, the first position at rapid speed, the
// others by G1. approach_mm: height above the first and the last position where the program begins and ends.
[[nodiscard]] std::string gcode(std::span<const Eigen::Vector3d> positions, double speed_mm_s, double approach_mm,
                                const std::string &name);

} // namespace bregma::planning
