#include "algorithms/uncertainty/tre.hpp"

#include <cmath>
#include <limits>

#include <Eigen/Eigenvalues>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::uncertainty {

namespace {
const double kChiSquare95 = chi_square_upper_quantile(0.05, 3);
using Eigensolver = Eigen::SelfAdjointEigenSolver<Matrix3d>;
} // namespace

Matrix3d tre_covariance(const Matrix6d &pose_covariance, const Vector3d &point_mm) noexcept {
  const geometry::Matrix36d J = geometry::point_jacobian(point_mm);
  return J * pose_covariance * J.transpose();
}

double rms_mm(const Matrix3d &covariance) noexcept { return std::sqrt(covariance.trace()); }

double mahalanobis_squared(const Matrix3d &covariance, const Vector3d &error_mm) noexcept {
  const Eigensolver solver(covariance);
  const Vector3d along = solver.eigenvectors().transpose() * error_mm;
  double sum = 0.0;
  for (int i = 0; i < 3; ++i) {
    if (along[i] != 0.0) {
      const double variance = solver.eigenvalues()[i];
      sum += variance > 0.0 ? along[i] * along[i] / variance : std::numeric_limits<double>::infinity();
    }
  }
  return sum;
}

Ellipsoid95 ellipsoid_95(const Matrix3d &covariance) noexcept {
  Ellipsoid95 out;
  if (!covariance.allFinite()) {
    out.semi_axes_mm.setConstant(geometry::kUnknown);
    out.axes.setConstant(geometry::kUnknown);
    return out;
  }
  const Eigensolver solver(covariance); // eigenvalues ascend
  for (int i = 0; i < 3; ++i) {
    out.semi_axes_mm[i] = std::sqrt(kChiSquare95 * std::fmax(solver.eigenvalues()[2 - i], 0.0));
    out.axes.row(i) = solver.eigenvectors().col(2 - i).transpose();
  }
  if (out.axes.determinant() < 0.0) {
    out.axes.row(2) = -out.axes.row(2);
  }
  return out;
}

double fitzpatrick_tre_rms_mm(std::span<const Vector3d> fiducials_mm, const Vector3d &target_mm,
                              double fle_rms_mm) noexcept {
  const auto n = static_cast<double>(fiducials_mm.size());
  if (fiducials_mm.size() < 3) {
    return geometry::kUnknown;
  }
  Vector3d centre = Vector3d::Zero();
  for (const Vector3d &p : fiducials_mm) {
    centre += p / n;
  }
  Matrix3d scatter = Matrix3d::Zero();
  for (const Vector3d &p : fiducials_mm) {
    scatter += (p - centre) * (p - centre).transpose() / n;
  }
  const Eigensolver solver(scatter);
  const Vector3d target = solver.eigenvectors().transpose() * (target_mm - centre);
  double ratio = 0.0;
  for (int k = 0; k < 3; ++k) {
    // Mean squared distances of the target and of the fiducials from principal axis k.
    const double d2 = target.squaredNorm() - target[k] * target[k];
    const double f2 = solver.eigenvalues().sum() - solver.eigenvalues()[k];
    if (f2 <= 1e-12 * solver.eigenvalues()[2]) {
      return geometry::kUnknown;
    }
    ratio += d2 / f2;
  }
  return fle_rms_mm * std::sqrt((1.0 + ratio / 3.0) / n);
}

double expected_fre_rms_mm(int fiducials, double fle_rms_mm) noexcept {
  return fiducials < 3 ? geometry::kUnknown : fle_rms_mm * std::sqrt(1.0 - 2.0 / fiducials);
}

} // namespace bregma::uncertainty
