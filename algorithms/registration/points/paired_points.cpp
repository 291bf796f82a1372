#include "algorithms/registration/points/paired_points.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/registration/twist.hpp"
#include "algorithms/uncertainty/distributions.hpp"

namespace bregma::registration {

using geometry::Matrix36d;
using geometry::skew;
using geometry::Vector6d;

namespace {

constexpr int kMaxIterations = 50;
constexpr double kRefinedStep_mm = 1e-9;

Matrix3d residual_covariance(const PointPair &pair, const Matrix3d &R) {
  return R * pair.source_covariance * R.transpose() + pair.target_covariance;
}

std::optional<PairedPose> start_pose(std::span<const PointPair> pairs) {
  std::array<Vector3d, kMaxPairs> source;
  std::array<Vector3d, kMaxPairs> target;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    source[i] = pairs[i].source_mm;
    target[i] = pairs[i].target_mm;
  }
  return fit_rigid({source.data(), pairs.size()}, {target.data(), pairs.size()});
}

Vector3d mean_target(std::span<const PointPair> pairs) {
  Vector3d sum = Vector3d::Zero();
  for (const PointPair &pair : pairs) {
    sum += pair.target_mm;
  }
  return sum / static_cast<double>(pairs.size());
}

} // namespace

std::optional<PairedPose> fit_rigid(std::span<const Vector3d> source_mm, std::span<const Vector3d> target_mm,
                                    std::span<const double> weights) noexcept {
  const std::size_t n = source_mm.size();
  if (n < 3 || target_mm.size() != n || (!weights.empty() && weights.size() != n)) {
    return std::nullopt;
  }
  const auto weight = [&](std::size_t i) { return weights.empty() ? 1.0 : weights[i]; };
  double total = 0.0;
  Vector3d source_mean = Vector3d::Zero();
  Vector3d target_mean = Vector3d::Zero();
  for (std::size_t i = 0; i < n; ++i) {
    total += weight(i);
    source_mean += weight(i) * source_mm[i];
    target_mean += weight(i) * target_mm[i];
  }
  source_mean /= total;
  target_mean /= total;
  Matrix3d H = Matrix3d::Zero(); // [Arun 1987, eq. 11]
  for (std::size_t i = 0; i < n; ++i) {
    H += weight(i) * (source_mm[i] - source_mean) * (target_mm[i] - target_mean).transpose();
  }
  if (!H.allFinite()) {
    return std::nullopt;
  }
  const Eigen::JacobiSVD<Matrix3d> svd(H, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (!(svd.singularValues()[1] > 1e-9 * svd.singularValues()[0])) {
    return std::nullopt;
  }
  // [Umeyama 1991, eq. 43]: the last axis is flipped where the best orthogonal matrix is a reflection.
  const double sign = svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0 ? -1.0 : 1.0;
  const Matrix3d R = svd.matrixV() * Vector3d(1.0, 1.0, sign).asDiagonal() * svd.matrixU().transpose();
  const PairedPose rotation(R, Vector3d::Zero());
  return PairedPose(rotation.rotation(), target_mean - rotation * source_mean);
}

Vector3d spread_mm(std::span<const Vector3d> points_mm) noexcept {
  if (points_mm.empty()) {
    return Vector3d::Zero();
  }
  const auto n = static_cast<double>(points_mm.size());
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d &p : points_mm) {
    mean += p / n;
  }
  Matrix3d scatter = Matrix3d::Zero();
  for (const Vector3d &p : points_mm) {
    scatter += (p - mean) * (p - mean).transpose() / n;
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(scatter, Eigen::EigenvaluesOnly);
  return solver.eigenvalues().reverse().cwiseMax(0.0).cwiseSqrt();
}

FiducialFit assess_fiducial(const PointPair &pair, const PairedPose &T_target_source, const Matrix6d &covariance,
                            const Matrix6d &normal_inverse, bool fixed_by_others) noexcept {
  const Vector3d mapped = T_target_source * pair.source_mm;
  const Matrix36d J = geometry::point_jacobian(mapped);
  const Matrix3d S = residual_covariance(pair, T_target_source.rotation_matrix());
  // With r = e + J d and d = -A^-1 (J' S^-1 e + ...): cov(r) = S + J P J' - 2 J A^-1 J'.
  const Matrix3d own_share = J * normal_inverse * J.transpose();
  const Matrix3d of_residual = S + J * covariance * J.transpose() - 2.0 * own_share;

  FiducialFit out;
  out.residual_mm = mapped - pair.target_mm;
  out.norm_mm = out.residual_mm.norm();
  out.expected_squared_mm2 = of_residual.trace();
  // With three fiducials the residual of each has fewer than three dimensions.
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(of_residual);
  const Vector3d along = solver.eigenvectors().transpose() * out.residual_mm;
  int rank = 0;
  for (int i = 0; i < 3; ++i) {
    if (solver.eigenvalues()[i] > 1e-6 * S.trace()) {
      out.chi_square += along[i] * along[i] / solver.eigenvalues()[i];
      ++rank;
    }
  }
  out.p_value = rank > 0 ? uncertainty::chi_square_survival(out.chi_square, rank) : 1.0;
  out.leave_one_out_mm = geometry::kUnknown;
  if (fixed_by_others) {
    // (I - J A^-1 J' S^-1)^-1 r: the residual when the pair is removed from the normal equations.
    const Eigen::FullPivLU<Matrix3d> others(S - own_share);
    if (others.isInvertible()) {
      out.leave_one_out_mm = (S * others.solve(out.residual_mm)).norm();
    }
  }
  return out;
}

PairedFit fit_paired(std::span<const PointPair> pairs, const PairedPose *start) noexcept {
  PairedFit out;
  if (pairs.size() < 3 || pairs.size() > kMaxPairs) {
    return out;
  }
  const std::optional<PairedPose> by_svd = start_pose(pairs);
  if (!by_svd) {
    return out;
  }
  out.count = static_cast<int>(pairs.size());
  out.T_target_source = start != nullptr ? *start : *by_svd;

  const Vector3d centre = mean_target(pairs);
  Eigen::LDLT<Matrix6d> solver;
  while (!out.converged && out.iterations < kMaxIterations) {
    ++out.iterations;
    Matrix6d A = Matrix6d::Zero();
    Vector6d g = Vector6d::Zero();
    out.chi_square = 0.0;
    const Matrix3d R = out.T_target_source.rotation_matrix();
    for (const PointPair &pair : pairs) {
      const Eigen::LLT<Matrix3d> S(residual_covariance(pair, R));
      if (S.info() != Eigen::Success) {
        return out;
      }
      const Vector3d mapped = out.T_target_source * pair.source_mm;
      const Vector3d residual = mapped - pair.target_mm;
      const Matrix36d J = geometry::point_jacobian(mapped - centre);
      const Matrix36d WJ = S.solve(J);
      A += J.transpose() * WJ;
      g += WJ.transpose() * residual;
      out.chi_square += residual.dot(S.solve(residual));
    }
    solver.compute(A);
    const Vector6d step = -solver.solve(g);
    if (solver.info() != Eigen::Success || !step.allFinite()) {
      return out;
    }
    out.T_target_source = moved_about(centre, step, out.T_target_source);
    // A rotation step counts as the motion of a point 100 mm away.
    out.converged = 100.0 * step.head<3>().norm() + step.tail<3>().norm() < kRefinedStep_mm;
  }

  out.covariance = covariance_at_origin(solver.solve(Matrix6d::Identity()), centre);
  out.p_value = out.count > 2 ? uncertainty::chi_square_survival(out.chi_square, 3 * out.count - 6) : 1.0;
  double squares = 0.0;
  double expected = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    out.fiducials[i] =
        assess_fiducial(pairs[i], out.T_target_source, out.covariance, out.covariance, pairs.size() >= 4);
    squares += out.fiducials[i].norm_mm * out.fiducials[i].norm_mm;
    expected += out.fiducials[i].expected_squared_mm2;
  }
  out.fre_mm = std::sqrt(squares / out.count);
  out.fre_expected_mm = std::sqrt(std::max(expected, 0.0) / out.count);
  return out;
}

Matrix6d marker_fit_covariance(std::span<const Vector3d> markers_mm, std::uint32_t used,
                               const geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool> &T_tracker_tool,
                               double sigma_lateral_mm, double sigma_depth_mm) noexcept {
  const Matrix3d R = T_tracker_tool.rotation_matrix();
  const std::size_t count = std::min<std::size_t>(markers_mm.size(), 32);
  const auto takes_part = [used](std::size_t i) { return ((used >> i) & 1U) != 0; };
  double n = 0.0;
  Vector3d mean = Vector3d::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    if (takes_part(i)) {
      mean += R * markers_mm[i];
      n += 1.0;
    }
  }
  mean /= n;
  // About the centroid J'J and J'SJ are block diagonal: rotation and translation are uncorrelated.
  const Vector3d variance(sigma_lateral_mm * sigma_lateral_mm, sigma_lateral_mm * sigma_lateral_mm,
                          sigma_depth_mm * sigma_depth_mm);
  Matrix3d normal = Matrix3d::Zero();
  Matrix3d noise = Matrix3d::Zero();
  for (std::size_t i = 0; i < count; ++i) {
    if (takes_part(i)) {
      const Matrix3d Jw = -skew(R * markers_mm[i] - mean);
      normal += Jw.transpose() * Jw;
      noise += Jw.transpose() * variance.asDiagonal() * Jw;
    }
  }
  const double size = normal.trace();
  if (n < 3.0 || !(normal.determinant() > 1e-9 * size * size * size)) {
    return Matrix6d::Constant(geometry::kUnknown);
  }
  const Matrix3d inverse = normal.inverse();
  Matrix6d about_centroid = Matrix6d::Zero();
  about_centroid.topLeftCorner<3, 3>() = inverse * noise * inverse;
  about_centroid.bottomRightCorner<3, 3>() = (variance / n).asDiagonal();
  return covariance_at_origin(about_centroid, mean + T_tracker_tool.translation());
}

} // namespace bregma::registration
