#include "algorithms/intensity/pose_starts.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace bregma::intensity {

using Eigen::Vector3d;

Vector3d centre_of_mass(const Volume &image) {
  const GreyRange range = grey_range(image.voxels, 0.01);
  Vector3d sum = Vector3d::Zero();
  double total = 0.0;
  for (std::size_t i = 0; i < image.voxels.size(); ++i) {
    const float v = image.voxels[i];
    if (std::isfinite(v)) {
      const double weight = static_cast<double>(std::clamp(v, range.low, range.high) - range.low);
      sum += weight * image.pixel_mm(i);
      total += weight;
    }
  }
  return total > 0.0 ? Vector3d(sum / total) : image.point_mm(Vector3d::Zero());
}

Eigen::Quaterniond spread_rotation(int i, int count) {
  constexpr double kPhi = std::numbers::sqrt2;
  constexpr double kPsi = 1.533751168755204288118041;
  const double s = i + 0.5;
  const double r = std::sqrt(s / count);
  const double R = std::sqrt(1.0 - s / count);
  const double alpha = 2.0 * std::numbers::pi * s / kPhi;
  const double beta = 2.0 * std::numbers::pi * s / kPsi;
  return {R * std::cos(beta), r * std::sin(alpha), r * std::cos(alpha), R * std::sin(beta)};
}

} // namespace bregma::intensity
