#include "algorithms/calibration/rotation_spread.hpp"

#include <algorithm>
#include <vector>

#include <Eigen/Eigenvalues>

#include "algorithms/geometry/rigid3.hpp"

namespace bregma::calibration {

std::array<double, 3> rotation_ranges(std::span<const Eigen::Quaterniond> rotations) {
  std::array<double, 3> ranges{};
  if (rotations.empty()) {
    return ranges;
  }
  // Mean rotation: the eigenvector of the largest eigenvalue of sum q q' [Markley 2007].
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Eigen::Quaterniond &rotation : rotations) {
    const Eigen::Vector4d &q = rotation.coeffs();
    sum += q * q.transpose();
  }
  const Eigen::Quaterniond mean(Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(sum).eigenvectors().col(3).eval());
  std::vector<Eigen::Vector3d> turns;
  turns.reserve(rotations.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Eigen::Quaterniond &rotation : rotations) {
    turns.push_back(geometry::rotation_log(mean.conjugate() * rotation));
    spread += turns.back() * turns.back().transpose();
  }
  const Eigen::Matrix3d axes = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvectors();
  std::vector<double> along(turns.size());
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const Eigen::Vector3d axis = axes.col(2 - static_cast<Eigen::Index>(i));
    std::transform(turns.begin(), turns.end(), along.begin(), [&axis](const auto &w) { return axis.dot(w); });
    std::sort(along.begin(), along.end());
    const std::size_t trim = along.size() / 100;
    ranges[i] = along[along.size() - 1 - trim] - along[trim];
  }
  return ranges;
}

} // namespace bregma::calibration
