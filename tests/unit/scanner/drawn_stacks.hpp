// Drawn stacks with balls of lost signal, and a small frame: cheap inputs with known centres.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "algorithms/mri/coils/robot_registration.hpp"
#include "drivers/sim/random.hpp"

namespace bregma::mri::test {

inline constexpr double kPixel_mm = 1.5;

// Water with balls of lost signal at given places, with noise: a stack of coronal-like slices about the isocentre.
inline Stack drawn(const std::vector<Vector3d> &balls_mm, double radius_mm, std::uint64_t seed, double gain = 1.0,
                   int slices = 100) {
  Stack out;
  out.size = {128, 128, slices};
  out.T_image_index.topLeftCorner<3, 3>() = kPixel_mm * Eigen::Matrix3d::Identity();
  out.T_image_index.topRightCorner<3, 1>() = -0.5 * kPixel_mm * Vector3d(127, 127, slices - 1);
  out.voxels.resize(out.pixels());
  sim::Random random(seed, "drawn");
  for (std::size_t i = 0; i < out.voxels.size(); ++i) {
    const Vector3d at = out.pixel_mm(i);
    double signal = at.cwiseAbs().maxCoeff() < 88.0 ? 1000.0 : 0.0;
    for (const Vector3d &ball : balls_mm) { // with edges as soft as a pixel
      signal *= std::clamp(((at - ball).norm() - radius_mm) / kPixel_mm + 0.5, 0.0, 1.0);
    }
    out.voxels[i] = static_cast<float>(std::abs(gain * signal + random.normal(30.0)));
  }
  return out;
}

// A frame of six coils without symmetry, in two groups.
inline CoilFrame small_frame() {
  CoilFrame out;
  out.name = "small";
  out.coils = {{"a1", "a", {-50, -45, 30}}, {"a2", "a", {52, -40, 22}},  {"a3", "a", {40, 50, 35}},
               {"b1", "b", {-46, 20, -30}}, {"b2", "b", {10, -52, -36}}, {"b3", "b", {0, 5, 10}}};
  return out;
}
inline std::vector<Vector3d> places(const CoilFrame &frame, const std::vector<int> &coils,
                                    const Rigid3<frame::Device, frame::Base> &T_device_base) {
  std::vector<Vector3d> out;
  for (const int c : coils) {
    out.push_back(T_device_base * frame.coils[static_cast<std::size_t>(c)].position_mm);
  }
  return out;
}
inline const Rigid3<frame::Device, frame::Base> kPlaced(geometry::rotation_exp(Vector3d(0.05, -0.1, 0.2)),
                                                        Vector3d(3, -2, 1));

} // namespace bregma::mri::test
