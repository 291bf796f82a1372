// The rigid pose of one cloud on another from any start: coherent point drift (cpd.hpp) from rotations spread evenly
// over SO(3), on ever more points and ever fewer candidates.
//
// The source is the whole object (a phantom, a bone); the target may be a part of it: every target must be explained,
// not every source. An optimum is not guaranteed. The second-best pose is returned too, so that the caller can see
// whether the result is unique. For a patient's skin on a head, which needs a verdict, use global_surface.hpp. Units:
// mm. Deterministic for a given number of threads; reentrant; allocates.
#pragma once

#include "algorithms/registration/clouds/cpd.hpp"

namespace bregma::registration {

struct CloudPoseOptions {
  int starts = 120;         // rotations; their spacing is about 55 degrees for 120
  int coarse_points = 200;  // per side, for every start
  int middle_points = 800;  // for the best starts
  int fine_points = 16'000; // for the result
  double outlier_weight = 0.1;
  double distinct_rad = 0.17; // rotations closer than this are one candidate
  int threads = 1;            // the starts are distributed over them
  unsigned seed = 1;          // for the selection of points
};

struct CloudPose {
  CpdResult<3> best;                  // maps source to target
  CpdResult<3> runner_up;             // the next distinct one, on middle_points; kTooFewPoints where there was none
  double middle_log_likelihood = 0.0; // of the best on middle_points, per target; compare with the runner-up's
};

[[nodiscard]] CloudPose find_cloud_pose(const geometry::Points3 &source_mm, const geometry::Points3 &target_mm,
                                        const CloudPoseOptions &options);

} // namespace bregma::registration
