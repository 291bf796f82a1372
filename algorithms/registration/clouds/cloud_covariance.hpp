// How well two clouds without known correspondences fix their rigid pose: the inverse of the observed information of
// the mixture that coherent point drift fits (cpd.hpp), by Louis (J R Stat Soc B 44 (1982) 226): the information that
// known correspondences would give, less what not knowing them takes away. Clouds that could slide on each other have a
// large covariance, not that of their many pairs.
//
// sigma_mm and outlier_constant as estimated by the drift; their own errors are not propagated. mm; reentrant; in time
// sources x targets.
#pragma once

#include <optional>

#include "algorithms/geometry/points.hpp"
#include "algorithms/geometry/pose_covariance.hpp"

namespace bregma::registration {

// Of T_target_source, left perturbation (geometry/pose_covariance.hpp). Nothing where the information is not positive:
// the pose is not fixed, or the estimate is no maximum.
[[nodiscard]] std::optional<geometry::Matrix6d> cloud_pose_covariance(const geometry::Points3 &moved_source_mm,
                                                                      const geometry::Points3 &target_mm,
                                                                      double sigma_mm, double outlier_constant);

} // namespace bregma::registration
