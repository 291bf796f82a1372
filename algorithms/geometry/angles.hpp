#pragma once
// Angles are in radians everywhere in the code; degrees appear in files and output only.

#include <numbers>

namespace bregma::geometry {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

} // namespace bregma::geometry
