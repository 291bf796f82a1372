// The registration frame of a robot: coils at known places of the robot's base, switched in groups [Tuna 2022, V-A].
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace bregma::mri {

struct FrameCoil {
  std::string name;                                      // "mid-top-1"
  std::string group;                                     // coils that are switched together
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero(); // in the robot's base, from its drawing
};

struct CoilFrame {
  std::string name;
  double build_sigma_mm = 0.2; // of each coordinate: how well the frame was built
  std::vector<FrameCoil> coils;
  // Rotation from Base to Patient (LPS) in which the frame is mounted, roughly; none where any is allowed.
  std::optional<Eigen::Matrix3d> R_patient_base;

  [[nodiscard]] int find(const std::string &coil) const { // -1: none of this name
    for (std::size_t i = 0; i < coils.size(); ++i) {
      if (coils[i].name == coil) {
        return static_cast<int>(i);
      }
    }
    return -1;
  }
};

} // namespace bregma::mri
