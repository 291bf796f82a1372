// Picture of a case: translucent scalp, brain, critical structures in colour, fiducials, trajectories.
#pragma once

#include <Eigen/Core>

#include "casefile/case.hpp"
#include "casefile/volumes/render.hpp"

namespace bregma::casefile {

// The colour of the n-th critical structure, the same in every picture; eight colours are repeated.
[[nodiscard]] Colour structure_colour(std::size_t index);

// `c` must outlive the scene. Landmarks are drawn smaller than fiducials; targets as spheres at their trajectories'
// ends.
[[nodiscard]] Scene case_scene(const Case &c, const Eigen::Vector3d &towards_eye, int width, int height);

} // namespace bregma::casefile
