// Covariance of the rigid pose between two clouds without known correspondences: the inverse of the observed
// information of the mixture that coherent point drift fits (cpd.hpp). The observed information is that of known
// correspondences, less the information that is missing because they are unknown [Louis 1982]. Clouds that could slide
// on each other therefore have a large covariance, however many pairs they have.
//
// sigma_mm and outlier_constant are those that the drift estimated; their own errors are not propagated. mm; reentrant;
// time is proportional to sources x targets.
#pragma once

#include <optional>

#include "algorithms/geometry/points.hpp"
#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::registration {

// Covariance of T_target_source, left perturbation (geometry/pose_covariance.hpp). No result where the information is
// not positive definite: the pose is not determined, or the estimate is not a maximum.
[[nodiscard]] std::optional<geometry::Matrix6d> cloud_pose_covariance(const geometry::Points3 &moved_source_mm,
                                                                      const geometry::Points3 &target_mm,
                                                                      double sigma_mm, double outlier_constant);

} // namespace bregma::registration
