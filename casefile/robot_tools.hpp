// Tools that an arm carries, with their calibration in the flange (TOML).
//
//   [[tools]]
//   name = "Guide"
//   tip_mm = [0, 0, 120]      # in the flange
//   axis = [0, 0, 1]          # in the flange, from the flange towards the tip
//   sigma_mm = 0.1            # of each coordinate of the tip
//   sigma_deg = 0.1           # of the axis; optional
//
// Errors name file, line, key and value.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/result.hpp"

namespace bregma::casefile {

struct RobotToolModel {
  std::string name; // as RobotState::tool
  Eigen::Vector3d tip_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ(); // unit length
  double sigma_mm = 0.1;
  double sigma_rad = 0.0;
};

// Refused: no tools, names that repeat or are too long for the wire, an axis without length.
[[nodiscard]] base::Result<std::vector<RobotToolModel>> read_robot_tools(const std::filesystem::path &file);

} // namespace bregma::casefile
