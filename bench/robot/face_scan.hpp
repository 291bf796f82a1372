// A printed face on a table before a robot, scanned from a constant height by the simulated range sensor, in virtual
// time: for the benchmark and the tests.
//
// The sensor is drivers/sim/range, not the model of the estimator. Frames: Image is RAS of the case, RobotBase has z up
// from the table; mm.
#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Geometry>

#include "algorithms/range/surface_scan.hpp"
#include "algorithms/surface/triangle_mesh.hpp"
#include "drivers/sim/range/surface_under_beam.hpp"

namespace bregma::bench {

// A raster of parallel lines, there and back, at constant speed.
struct ScanPlan {
  double line_mm = 5.0;  // between lines
  double point_mm = 5.0; // along a line, between two points
  double speed_mm_s = 5.0;
  range::ChainOptions chain = range::robust_chain();
  bool at_newest = false; // the delay of the chain is not removed

  // Lines and points as far apart as gives this number of points on an area.
  [[nodiscard]] static ScanPlan of_points(double count, double area_mm2, double speed_mm_s);
};

// A face that lies on its back, turned and tilted at random, its lowest point on the table.
class PlacedFace {
public:
  PlacedFace(const surface::TriangleMesh &shell_ras, std::uint64_t seed);

  [[nodiscard]] const Eigen::Isometry3d &T_robot_image() const { return T_robot_image_; }
  [[nodiscard]] const sim::SurfaceUnderBeam &surface() const { return surface_; }
  // Under the face, seen from above.
  [[nodiscard]] double area_mm2() const;

private:
  Eigen::Isometry3d T_robot_image_;
  sim::SurfaceUnderBeam surface_;
};

struct ScannedFace {
  range::SurfaceScan scan;
  double seconds = 0.0; // of the robot's motion
  double rms_mm = 0.0;  // error of the points' heights, against the surface under them
  double bias_mm = 0.0; // mean of it
};

inline constexpr std::int64_t kSensorDelay_ns = 38'300'000; // the sensor measures for one period, then holds the value
// The power law fits the sensor between these distances; nearer points are left out.
inline constexpr double kCurveFrom_mm = 110.0, kCurveTo_mm = 205.0;
inline constexpr double kScanHeight_mm = 200.0; // [NeuroGuide]
// bias_mm: by which the sensor is higher than the robot states.
[[nodiscard]] ScannedFace scan_face(const PlacedFace &face, const ScanPlan &plan, const range::RangeCurve &curve,
                                    double bias_mm, std::uint64_t seed);

// Readings of the simulated sensor at rest at known distances, the means of 1,000 each.
[[nodiscard]] std::vector<range::CalibrationPoint> calibration_readings(double from_mm, double to_mm, double step_mm,
                                                                        std::uint64_t seed);

} // namespace bregma::bench
