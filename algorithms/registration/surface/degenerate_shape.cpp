#include "algorithms/registration/surface/degenerate_shape.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "algorithms/registration/surface/pose_search.hpp"

namespace bregma::registration {

namespace {

constexpr int kSphereIterations = 10;
constexpr int kSpheroidIterations = 25;
constexpr std::size_t kMaxFittedPoints = 400; // maximum number of points for a spheroid; more are thinned evenly
constexpr double kMinRadius_mm = 5.0, kMaxRadius_mm = 500.0;
constexpr double kRelativeDamping = 1e-3; // relative to the diagonal of the normal matrix

// The robust loss r^2 / (reach^2 + r^2): its weight in least squares, and the loss itself.
double weight_of(double r, double sigma) {
  const double reach2 = 9.0 * sigma * sigma;
  return std::pow(reach2 / (reach2 + r * r), 2);
}
double loss_of(double r, double sigma) { return r * r / (9.0 * sigma * sigma + r * r); }

FittedSphere robust_sphere(std::span<const Eigen::Vector3d> points, double sigma) {
  FittedSphere sphere = fit_sphere(points);
  for (int iteration = 0; iteration < kSphereIterations; ++iteration) {
    Eigen::Matrix4d A = 1e-9 * Eigen::Matrix4d::Identity();
    Eigen::Vector4d b = Eigen::Vector4d::Zero();
    for (const Eigen::Vector3d &p : points) {
      const Eigen::Vector3d from = p - sphere.centre_mm;
      const double r = from.norm() - sphere.radius_mm;
      const double w = weight_of(r, sigma);
      Eigen::Vector4d J;
      J << -from.normalized(), -1.0;
      A += w * J * J.transpose();
      b += w * r * J;
    }
    const Eigen::Vector4d step = -A.ldlt().solve(b);
    sphere.centre_mm += step.head<3>();
    sphere.radius_mm += step[3];
  }
  return sphere;
}

struct Spheroid {
  Eigen::Vector3d centre_mm, axis;
  double equatorial_mm, polar_mm; // radii

  struct Distance {
    double value;
    Eigen::Matrix<double, 7, 1> gradient; // by centre, two rotations of the axis, two radii
  };
  // rho^2 / a^2 + z^2 / b^2 - 1 over the length of its gradient in space, which is treated as constant.
  [[nodiscard]] Distance distance(const Eigen::Vector3d &p, const Eigen::Vector3d &turn_1,
                                  const Eigen::Vector3d &turn_2) const {
    const Eigen::Vector3d q = p - centre_mm;
    const double z = q.dot(axis);
    const Eigen::Vector3d aside = q - z * axis;
    const double a2 = equatorial_mm * equatorial_mm;
    const double b2 = polar_mm * polar_mm;
    const Eigen::Vector3d slope = 2.0 * (aside / a2 + z / b2 * axis);
    const double scale = 1.0 / std::max(slope.norm(), 1e-9);
    const double by_turn = 2.0 * z * (1.0 / b2 - 1.0 / a2);
    Distance out;
    out.value = (aside.squaredNorm() / a2 + z * z / b2 - 1.0) * scale;
    out.gradient << -slope, by_turn * turn_1.dot(aside), by_turn * turn_2.dot(aside),
        -2.0 * aside.squaredNorm() / (a2 * equatorial_mm), -2.0 * z * z / (b2 * polar_mm);
    out.gradient *= scale;
    return out;
  }
};

// Damped Gauss-Newton; loss receives the loss of the returned shape.
Spheroid robust_spheroid(std::span<const Eigen::Vector3d> points, double sigma, Spheroid now, double &loss) {
  const std::size_t stride = (points.size() + kMaxFittedPoints - 1) / kMaxFittedPoints;
  Spheroid best = now;
  loss = static_cast<double>(points.size()) + 1.0; // above any possible loss
  for (int iteration = 0; iteration < kSpheroidIterations; ++iteration) {
    const Eigen::Vector3d turn_1 = now.axis.unitOrthogonal();
    const Eigen::Vector3d turn_2 = now.axis.cross(turn_1);
    Eigen::Matrix<double, 7, 7> A = Eigen::Matrix<double, 7, 7>::Zero();
    Eigen::Matrix<double, 7, 1> b = Eigen::Matrix<double, 7, 1>::Zero();
    double sum = 0.0;
    for (std::size_t i = 0; i < points.size(); i += stride) {
      const auto [r, J] = now.distance(points[i], turn_1, turn_2);
      const double w = weight_of(r, sigma);
      A += w * J * J.transpose();
      b += w * r * J;
      sum += loss_of(r, sigma);
    }
    if (sum < loss) {
      loss = sum;
      best = now;
    }
    A.diagonal() *= 1.0 + kRelativeDamping;
    A.diagonal().array() += 1e-9;
    const Eigen::Matrix<double, 7, 1> step = -A.ldlt().solve(b);
    if (!step.allFinite()) {
      break;
    }
    now.centre_mm += step.head<3>();
    now.axis = (now.axis + step[3] * turn_1 + step[4] * turn_2).normalized();
    now.equatorial_mm = std::clamp(now.equatorial_mm + step[5], kMinRadius_mm, kMaxRadius_mm);
    now.polar_mm = std::clamp(now.polar_mm + step[6], kMinRadius_mm, kMaxRadius_mm);
  }
  return best;
}

} // namespace

void fit_plane(std::span<const Eigen::Vector3d> points_mm, std::span<double> distance_mm) noexcept {
  const Spread spread = spread_of(points_mm);
  const Eigen::Vector3d normal =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread.covariance).eigenvectors().col(0);
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    distance_mm[i] = normal.dot(points_mm[i] - spread.middle_mm);
  }
}

void fit_sphere(std::span<const Eigen::Vector3d> points_mm, double sigma_mm, std::span<double> distance_mm) noexcept {
  const FittedSphere sphere = robust_sphere(points_mm, sigma_mm);
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    distance_mm[i] = (points_mm[i] - sphere.centre_mm).norm() - sphere.radius_mm;
  }
}

void fit_spheroid(std::span<const Eigen::Vector3d> points_mm, double sigma_mm, std::span<double> distance_mm) noexcept {
  const FittedSphere sphere = robust_sphere(points_mm, sigma_mm);
  const double radius = std::clamp(sphere.radius_mm, kMinRadius_mm, kMaxRadius_mm);
  const Eigen::Matrix3d principal =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread_of(points_mm).covariance).eigenvectors();
  Spheroid best{sphere.centre_mm, principal.col(0), radius, radius};
  double min_loss = static_cast<double>(points_mm.size()) + 2.0;
  for (Eigen::Index k = 0; k < 3; ++k) {
    double loss = 0.0;
    const Spheroid fitted =
        robust_spheroid(points_mm, sigma_mm, {sphere.centre_mm, principal.col(k), radius, radius}, loss);
    if (loss < min_loss) {
      min_loss = loss;
      best = fitted;
    }
  }
  const Eigen::Vector3d turn_1 = best.axis.unitOrthogonal();
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    distance_mm[i] = best.distance(points_mm[i], turn_1, best.axis.cross(turn_1)).value;
  }
}

} // namespace bregma::registration
