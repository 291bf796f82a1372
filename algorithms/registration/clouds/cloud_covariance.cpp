#include "algorithms/registration/clouds/cloud_covariance.hpp"

#include <cmath>
#include <vector>

#include <Eigen/Cholesky>

#include "algorithms/registration/twist.hpp"

namespace bregma::registration {

using geometry::Matrix36d;
using geometry::Matrix6d;
using geometry::Vector6d;

std::optional<Matrix6d> cloud_pose_covariance(const geometry::Points3 &moved_source_mm,
                                              const geometry::Points3 &target_mm, double sigma_mm,
                                              double outlier_constant) {
  constexpr double kFar = 50.0; // d^2 / sigma^2 beyond which a Gaussian is negligible against the outliers
  const double information = 1.0 / (sigma_mm * sigma_mm);
  // About the centre of the targets, where the six columns have the same order of magnitude.
  const Eigen::Vector3d middle = target_mm.rowwise().mean();
  std::vector<Matrix36d> jacobians;
  for (Eigen::Index m = 0; m < moved_source_mm.cols(); ++m) {
    jacobians.push_back(geometry::point_jacobian(moved_source_mm.col(m) - middle));
  }
  struct Near {
    Eigen::Index source;
    double density;
  };
  std::vector<Near> near;
  Matrix6d observed = Matrix6d::Zero();
  for (Eigen::Index n = 0; n < target_mm.cols(); ++n) {
    near.clear();
    double divisor = outlier_constant;
    for (Eigen::Index m = 0; m < moved_source_mm.cols(); ++m) {
      const double z2 = (target_mm.col(n) - moved_source_mm.col(m)).squaredNorm() * information;
      if (z2 < kFar) {
        near.push_back({m, std::exp(-0.5 * z2)});
        divisor += near.back().density;
      }
    }
    Vector6d mean_score = Vector6d::Zero();
    for (const Near &one : near) {
      const double p = one.density / divisor;
      const Matrix36d &J = jacobians[static_cast<std::size_t>(one.source)];
      const Vector6d score = information * J.transpose() * (target_mm.col(n) - moved_source_mm.col(one.source));
      observed += p * (information * J.transpose() * J - score * score.transpose());
      mean_score += p * score;
    }
    observed += mean_score * mean_score.transpose();
  }
  const Eigen::LLT<Matrix6d> factor(observed);
  if (factor.info() != Eigen::Success) {
    return std::nullopt;
  }
  const Matrix6d about_middle = factor.solve(Matrix6d::Identity());
  return about_middle.allFinite() ? std::optional(covariance_at_origin(about_middle, middle)) : std::nullopt;
}

} // namespace bregma::registration
