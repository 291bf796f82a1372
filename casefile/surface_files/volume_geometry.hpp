// The geometry of the volume that FreeSurfer made a surface of. Private to this library.
//
// Its surfaces are in "surface RAS": relative to the centre of that volume, with axes to the left, inferior and
// anterior. The geometry gives the transform to scanner RAS, the coordinates of the NIfTI image.
#pragma once

#include <cmath>

#include <Eigen/LU>

namespace bregma::casefile::detail {

struct VolumeGeometry {
  bool valid = false;
  bool in_scanner = false;                            // the points are in scanner RAS already
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity(); // columns: directions of the voxels' axes in scanner RAS
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();

  [[nodiscard]] bool has_axes() const { return std::abs(std::abs(axes.determinant()) - 1.0) <= 1e-3; }
  // Scanner RAS of a point in surface RAS.
  [[nodiscard]] Eigen::Vector3d scanner_ras(const Eigen::Vector3d &p) const {
    return axes * Eigen::Vector3d(-p.x(), -p.z(), p.y()) + centre;
  }
};

} // namespace bregma::casefile::detail
