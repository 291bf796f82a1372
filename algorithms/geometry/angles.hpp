#pragma once
// Angles are radians everywhere in the code; degrees are for files and for people.

#include <numbers>

namespace bregma::geometry {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

} // namespace bregma::geometry
