// Points of a surface from a scan with a range sensor that looks down from a constant height [NeuroGuide].
//
// The records follow each other at the sensor's rate: the robot's X and Y, and a reading, NaN where it is missing. They
// pass a RangeChain. A point lies below the sensor by the distance: z = height - distance, above the table. Its X and Y
// are those of the time at which the distance held, between two records; with `at_newest` those of the newest record,
// as in [NeuroGuide], so that the delay of the chain shifts the points along the path.
//
// Pure functions; any thread. Frame: the robot's x and y, z up from the table, mm.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "algorithms/range/range_filters.hpp"

namespace bregma::range {

struct ScanRecord {
  double x_mm = 0.0, y_mm = 0.0; // NaN: not known
  double reading = 0.0;          // NaN: missing
};

struct ScanOptions {
  ChainOptions chain = robust_chain();
  RangeCurve curve;
  double height_mm = 200.0; // of the sensor above the table
  double period_ms = 1.0;   // between two records
  bool at_newest = false;
  double near_mm = 0.0, far_mm = std::numeric_limits<double>::infinity(); // distances outside are left out
  double lowest_mm = -std::numeric_limits<double>::infinity();            // so are points below this height
  // So are points on steeper slopes, where such a sensor reads too far, or on an edge. The slope is that of the plane
  // through the points within slope_radius_mm; where these do not determine a plane, it is not known, and the point is
  // kept.
  double max_slope_rad = std::numeric_limits<double>::infinity();
  double slope_radius_mm = 12.0; // every point is compared with every other: for thousands, not millions
};

struct SurfaceScan {
  std::vector<Eigen::Vector3d> points_mm;
  std::vector<std::size_t> newest; // index of the newest record that each point used
  std::size_t missing = 0;         // readings that are NaN
  std::size_t too_near = 0, too_far = 0, too_low = 0, too_steep = 0;
  std::size_t without_position = 0; // values at whose time no position is known
  double delay_ms = 0.0;            // mean, of the values that became points
};

// Throws std::invalid_argument for options of the chain out of range, and for a period that is not positive.
[[nodiscard]] SurfaceScan surface_points(std::span<const ScanRecord> records, const ScanOptions &options);

} // namespace bregma::range
