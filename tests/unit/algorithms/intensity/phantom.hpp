// Images with structure and known places: nested ellipsoids with texture, in the plane and in space.
#pragma once

#include <cmath>
#include <random>

#include <Eigen/Geometry>

#include "algorithms/intensity/features.hpp"

namespace bregma::test {

// Grey value of a head-like body at a point (mm): asymmetric, with edges and smooth parts. 0 outside.
inline float phantom_grey(const Eigen::Vector3d &p) {
  const auto ellipsoid = [&](double x, double y, double z, double a, double b, double c) {
    return std::pow((p.x() - x) / a, 2) + std::pow((p.y() - y) / b, 2) + std::pow((p.z() - z) / c, 2);
  };
  // Soft edges of about 3 mm: an image is not sharper than its voxels.
  const auto inside = [](double level) { return 1.0 / (1.0 + std::exp(14.0 * (level - 1.0))); };
  double grey = 90.0 * inside(ellipsoid(0, 0, 0, 27, 32, 25));
  grey += 60.0 * inside(ellipsoid(0, 2, 1, 22, 26, 20));
  grey -= 70.0 * inside(ellipsoid(-6, 6, 2, 5, 10, 7));
  grey += 50.0 * inside(ellipsoid(9, -8, -4, 7, 6, 9));
  grey += 35.0 * inside(ellipsoid(-8, -12, 6, 6, 5, 5));
  grey += 80.0 * inside(ellipsoid(3, 24, -18, 9, 12, 8)); // a face: without it the body is nearly symmetric
  grey -= 60.0 * inside(ellipsoid(6, 10, 12, 9, 6, 6));
  return static_cast<float>(grey + 12.0 * std::sin(0.25 * p.x()) * std::cos(0.2 * p.y() + 0.1 * p.z()) *
                                       inside(ellipsoid(0, 0, 0, 27, 32, 25)));
}

inline intensity::Volume phantom(std::array<int, 3> size, const Eigen::Vector3d &spacing_mm,
                                 const Eigen::Affine3d &T_body_image = Eigen::Affine3d::Identity()) {
  intensity::Volume out;
  out.size = size;
  out.T_image_index.topLeftCorner<3, 3>() = spacing_mm.asDiagonal();
  for (int d = 0; d < 3; ++d) {
    out.T_image_index(d, 3) = -0.5 * spacing_mm[d] * (size[static_cast<std::size_t>(d)] - 1);
  }
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    out.voxels.push_back(phantom_grey(T_body_image * out.pixel_mm(i)));
  }
  return out;
}
inline intensity::Volume head_phantom() { return phantom({34, 36, 30}, {2.0, 2.2, 2.1}); }
inline intensity::Volume plane_phantom() { return phantom({64, 70, 1}, {1.0, 1.0, 1.0}); }

// The same values in whole steps from 0 to levels - 1.
inline intensity::Volume quantised(intensity::Volume image, int levels) {
  const intensity::GreyRange range = intensity::grey_range(image.voxels);
  for (float &v : image.voxels) {
    v = std::floor((v - range.low) / (range.high - range.low) * (static_cast<float>(levels) - 0.01F));
  }
  return image;
}

inline Eigen::Matrix4d pose(const Eigen::Vector3d &rotation_deg, const Eigen::Vector3d &translation_mm) {
  constexpr double kDegree = 3.14159265358979323846 / 180.0;
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  const double angle = rotation_deg.norm();
  if (angle > 0.0) {
    out.rotate(Eigen::AngleAxisd(angle * kDegree, rotation_deg / angle));
  }
  out.pretranslate(translation_mm);
  return out.matrix();
}

} // namespace bregma::test
