// The peer of image registration: elastix (Debian package), 3-D rigid with mutual information [Klein 2010].
#pragma once

#include <vector>

#include <Eigen/Core>

#include "algorithms/intensity/rigid_image.hpp"
#include "base/result.hpp"

namespace bregma::bench {

struct ElastixResult {
  intensity::ReferenceFromFloating T_reference_floating;
  double time_s = 0.0; // its own figure: without reading and writing files
};
// Three levels, Mattes' measure with 32 bins, 2,048 random samples per step, 250 steps per level, started with centres
// of geometry aligned, on two threads. An error says that the program is missing, or what it printed.
[[nodiscard]] base::Result<ElastixResult> run_elastix(const intensity::Volume &fixed, const intensity::Volume &moving);

struct ElastixField {
  std::vector<Eigen::Vector3d> moved_mm; // where each point of the fixed image lies in the moving one
  double time_s = 0.0;
};
// Cubic B-splines on a lattice of grid_mm (three levels, twice as coarse on the first), 500 steps per level of 4,096
// samples, from the pose of the headers, on two threads.
[[nodiscard]] base::Result<ElastixField> run_elastix_nonrigid(const intensity::Volume &fixed,
                                                              const intensity::Volume &moving, double grid_mm,
                                                              const std::vector<Eigen::Vector3d> &points_mm);

} // namespace bregma::bench
