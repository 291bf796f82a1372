// What an arm carries, with its calibration in the flange (TOML): tools, and range sensors.
//
//   arm = "mz07f.toml"        # the arm's links (dh_arm.hpp); optional: without it the daemon plans no motion
//   table_mm = 0              # height of the table in RobotBase, an obstacle; optional
//
//   [[tools]]
//   name = "Guide"
//   tip_mm = [0, 0, 120]      # in the flange
//   axis = [0, 0, 1]          # in the flange, from the flange towards the tip
//   sigma_mm = 0.1            # of each coordinate of the tip
//   sigma_deg = 0.1           # of the axis; optional
//   radius_mm = 6             # of its body, from the flange to the tip; optional
//
//   [[sensors]]
//   name = "Range"            # of the device
//   beam = "beam.json"        # as `bregma calibrate beam --json` writes it
//   curve = "curve.json"      # as `bregma calibrate range --json` writes it, from the device's distances; optional
//   window = 100              # readings of the filter
//   delay_ms = 38.3           # age of a value when the sensor gives it
//   sigma_mm = 0.5            # of a filtered value; optional: as the sensor states
//   near_mm = 100
//   far_mm = 400
//   excess_mm = 5             # 1 sigma of what it reads too far on tilted skin; optional (5); 0: it does not
//   radius_mm = 25            # of its body, from the flange to the beam's origin; optional
//
//   [hand_eye]                # a tracker beside the arm, which sees the patient's reference; optional
//   file = "hand_eye.json"    # as `bregma calibrate hand-eye --json` writes it (A X = Y B)
//   tracker = "Tracker"       # the device that was calibrated
//   flange_body = "Marker"    # the tracked body on the flange (X), a tool of the case; optional: without it the
//                             # calibration is not checked while the arm navigates
//
// Files are named relative to this one. Errors name file, line, key and value.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/range/power_law.hpp"
#include "algorithms/robot/arm_model.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

struct RobotToolModel {
  std::string name; // as RobotState::tool
  Eigen::Vector3d tip_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ(); // unit length
  double sigma_mm = 0.1;
  double sigma_rad = 0.0;
  double radius_mm = 6.0;
};

struct RangeSensorModel {
  std::string name;                                     // as RangeSample::device
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();  // of the beam, in the flange, where the reading is zero
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ(); // unit length
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero(); // rotation of the direction, origin
  // True distance by the stated one: a law with its corrections. At most kMaxCurveCorrections.
  std::optional<range::PowerLawFit> curve;
  std::int64_t window = 100;
  double delay_ms = 0.0;
  double sigma_mm = 0.0; // 1 sigma of a filtered value; 0: as the sensor states
  double near_mm = 0.0, far_mm = 1e4;
  double radius_mm = 25.0;
  double excess_mm = 5.0; // 1 sigma, before a scan, of what it reads too far on tilted skin; 0: it does not
};
inline constexpr std::size_t kMaxCurveCorrections = 16;

// Where a tracker stands beside the arm, and where a body that it tracks sits on the flange
// (algorithms/calibration/hand_eye.hpp).
struct HandEyeModel {
  std::string tracker; // as TrackerFrame::device
  geometry::UncertainPose<geometry::frame::RobotBase, geometry::frame::Tracker> T_base_tracker;
  std::string flange_body; // name of the tracked body; empty: none is tracked
  geometry::UncertainPose<geometry::frame::RobotFlange, geometry::frame::Tool> T_flange_body;
  // Of the left perturbations of T_flange_body and T_base_tracker, in this order. Their errors compensate each other.
  Eigen::Matrix<double, 12, 12> joint = Eigen::Matrix<double, 12, 12>::Zero();
};

struct RobotEquipment {
  std::optional<robot::ArmModel> arm;
  std::optional<double> table_z_mm; // in RobotBase
  std::vector<RobotToolModel> tools;
  std::vector<RangeSensorModel> sensors;
  std::optional<HandEyeModel> hand_eye; // empty: no tracker beside the arm
};

// Refused: no tools, names that repeat or are too long for the wire, an axis without length, and a calibration that was
// refused itself, is that of voltages, or of motions alone (A X = X B); an arm that is not described by its table.
[[nodiscard]] base::Result<RobotEquipment> read_robot_equipment(const std::filesystem::path &file);

} // namespace bregma::casefile
