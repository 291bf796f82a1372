// Where a search over poses of images begins.
//
// Units: mm. Thread-safe: pure functions.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "algorithms/intensity/similarity_measure.hpp"

namespace bregma::intensity {

// Centre of the grey values above the darkest, in the image's frame; of the grid for an image of one grey value.
[[nodiscard]] Eigen::Vector3d centre_of_mass(const Volume &image);

// The i-th of `count` rotations that cover SO(3) evenly: super-Fibonacci spirals [Alexa 2022].
// Precondition: 0 <= i < count.
[[nodiscard]] Eigen::Quaterniond spread_rotation(int i, int count);

} // namespace bregma::intensity
