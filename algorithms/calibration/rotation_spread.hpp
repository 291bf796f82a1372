// How far a body was rotated in a recording: the check that a calibration's motion is not degenerate.
//
// Pure functions; any thread.
#pragma once

#include <array>
#include <span>

#include <Eigen/Geometry>

namespace bregma::calibration {

// Ranges (rad) of the rotation vectors about the mean rotation, along their principal axes, widest first. The outer 1 %
// at each end are left out: a single wrong pose must not count as rotation. Zeros without rotations.
[[nodiscard]] std::array<double, 3> rotation_ranges(std::span<const Eigen::Quaterniond> rotations);

} // namespace bregma::calibration
