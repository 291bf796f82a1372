// Beam calibration: origin and direction of a range sensor's beam in the robot's flange.
//
// A reading r in the flange's pose T_i gives the point T_i (o + r u). Scans of a plane or of a sphere whose place is
// not known, in several orientations of the flange, determine o and u together with the plane or the sphere: maximum
// likelihood by Levenberg-Marquardt over o, u and the body, from six start directions. The covariance is that of the
// likelihood, with the body's parameters eliminated.
//
// A scan in one orientation does not determine the origin: an offset of the beam vanishes into the body's place, and
// later moves everything that the robot points at by as much. Such scans, and others that leave a part of the beam
// free, are refused by name.
//
// Units mm and rad. Pure functions; any thread; a thousand readings take tens of milliseconds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::calibration {

using BeamFlange = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::RobotFlange>;

struct Beam {
  geometry::Vector3d origin_mm = geometry::Vector3d::Zero();  // in the flange, where the reading is zero
  geometry::Vector3d direction = geometry::Vector3d::UnitZ(); // unit vector in the flange
};

struct BeamReading {
  BeamFlange T_base_flange;
  double range_mm = 0.0;
};

enum class BeamBody : std::uint8_t { kPlane, kSphere };

struct BeamOptions {
  BeamBody body = BeamBody::kPlane;
  std::optional<double> radius_mm = std::nullopt; // of the sphere, if it is known
  double range_sigma_mm = 0.5;                    // of a reading along the beam, 1 sigma, independent
  double robot_sigma_mm = 0.05;                   // of each coordinate of the beam's foot
  std::size_t min_readings = 30;
  double min_rotation_rad = 0.17;   // of the flange about each of two axes: 10 degrees
  double min_range_change_mm = 5.0; // between the 5th and the 95th percentile of the readings
  double max_origin_sigma_mm = 2.0; // worst direction; above it the scan does not fix the beam
  double max_direction_sigma_rad = 0.0175;
  double min_p_value = 1e-6; // of the residuals, if the stated errors hold
};

enum class BeamVerdict : std::uint8_t {
  kAccepted,
  kTooFewReadings,
  kInvalidReading,   // not finite, or a range that is not positive
  kFixedOrientation, // degenerate: the offset vanishes into the body's place
  kOneAxis,          // degenerate: the origin along the axis is free
  kConstantRange,    // degenerate: only one point of the beam is observed, its direction is free
  kPoorlyObserved,   // predicted errors exceed the limits
  kNotConverged,
  kFitsBadly // residuals larger than stated
};

struct BeamResult {
  BeamVerdict verdict = BeamVerdict::kTooFewReadings;
  std::string text;       // the verdict as a sentence, with the figures that decided it
  bool estimated = false; // what follows is valid
  Beam beam;
  // Rotation vector of the direction's error first (rank two: perpendicular to it), then the origin's: mm and rad.
  geometry::Matrix6d covariance = geometry::Matrix6d::Zero();
  double rms_mm = 0.0; // of the distances from the body; a consistency
  double chi_square = 0.0, p_value = 0.0;
  double rotation_rad[2] = {0.0, 0.0};
  double range_change_mm = 0.0;

  [[nodiscard]] bool accepted() const { return verdict == BeamVerdict::kAccepted; }
};

[[nodiscard]] BeamResult calibrate_beam(std::span<const BeamReading> readings, const BeamOptions &options = {});

// Covariance, in RobotBase, of the point that a reading gives: that of the beam, of the reading and of the foot.
[[nodiscard]] geometry::Matrix3d beam_point_covariance(const BeamResult &calibration, const BeamReading &reading,
                                                       double range_sigma_mm, double robot_sigma_mm);
[[nodiscard]] geometry::Vector3d beam_point(const Beam &beam, const BeamReading &reading);

} // namespace bregma::calibration
