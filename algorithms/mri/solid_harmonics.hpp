// Real regular solid harmonics: the polynomials that satisfy Laplace's equation, as the fields of a scanner's coils do
// inside the bore.
//
// r^n P_n^m(cos theta) cos(m phi), sin(m phi), with Schmidt's semi-normalisation and without the Condon-Shortley phase:
// on a sphere of radius 1 the mean square of every function of degree n is 1 / (2 n + 1). Coordinates are divided by a
// radius, so that the functions are of order one at it. Order: degree 0 to n; within a degree m = 0, cos 1, sin 1,
// cos 2, ... Pure functions.
#pragma once

#include <array>
#include <span>

#include <Eigen/Core>

#include "algorithms/geometry/points.hpp"

namespace bregma::mri {

inline constexpr int kMaxHarmonicDegree = 16;

[[nodiscard]] constexpr int harmonic_count(int degree) { return (degree + 1) * (degree + 1); }
[[nodiscard]] constexpr int degree_of_harmonic(int index) {
  int degree = 0;
  while (harmonic_count(degree) <= index) {
    ++degree;
  }
  return degree;
}

// out: harmonic_count(degree) values at a point (without unit, relative to the radius); degree 0 to kMaxHarmonicDegree.
// No allocation.
void solid_harmonics(int degree, const Eigen::Vector3d &point, std::span<double> out) noexcept;

// harmonic_count(degree) rows, a column per point; points_mm are divided by radius_mm. Allocates.
[[nodiscard]] Eigen::MatrixXd harmonic_matrix(const geometry::Points3 &points_mm, int degree, double radius_mm);

} // namespace bregma::mri
