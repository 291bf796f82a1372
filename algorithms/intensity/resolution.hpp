// An image at a lower resolution. NaN marks voxels without a value. Pure; threads are those of the team.
#pragma once

#include "algorithms/image/grid.hpp"
#include "algorithms/parallel/team.hpp"

namespace bregma::intensity {

// Gaussian smoothing, sigma in mm; NaN counts as missing and stays NaN.
[[nodiscard]] image::Image<float, 3> smoothed(const image::Image<float, 3> &image, double sigma_mm,
                                              parallel::Team &team);
// On a grid with the same axes and about this spacing, after smoothing against aliasing. An axis that is as coarse
// already, or has one voxel, stays.
[[nodiscard]] image::Image<float, 3> shrunk(const image::Image<float, 3> &image, double spacing_mm,
                                            parallel::Team &team);

} // namespace bregma::intensity
