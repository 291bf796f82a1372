// The laws of material.hpp for one triangle of constant strain: stress from the gradient of the motion, in the plane.
// The pressure is an argument (the solver averages it over nodes); the shear follows from the law. SI.
#pragma once

#include <algorithm>
#include <cmath>

#include <Eigen/Core>
#include <Eigen/LU>

#include "algorithms/tissue/material/material.hpp"

namespace bregma::tissue_plane {

// Material parameters for the solver's inner loop.
struct PlaneLaw {
  tissue::Law law = tissue::Law::kNeoHookean;
  double shear_Pa = 0.0;
  double bulk_Pa = 0.0;
  double alpha = 2.0;
};

struct PlaneStress {
  double xx_Pa = 0.0;
  double yy_Pa = 0.0;
  double zz_Pa = 0.0; // across the plane: 0 in plane stress
  double xy_Pa = 0.0;

  // In Pa [thesis, eq. 41]: sqrt(sxx^2 + syy^2 - sxx syy + 3 txy^2). Complete in plane stress; in plane strain it omits
  // the stress across the plane.
  [[nodiscard]] double von_mises_plane() const {
    return std::sqrt(xx_Pa * xx_Pa + yy_Pa * yy_Pa - xx_Pa * yy_Pa + 3.0 * xy_Pa * xy_Pa);
  }
  // In Pa, with the stress across the plane; independent of pressure.
  [[nodiscard]] double von_mises() const {
    const double a = xx_Pa - yy_Pa;
    const double b = yy_Pa - zz_Pa;
    const double c = zz_Pa - xx_Pa;
    return std::sqrt(0.5 * (a * a + b * b + c * c) + 3.0 * xy_Pa * xy_Pa);
  }
};

namespace plane_law {

using Eigen::Matrix2d;

// Below this relative volume, the shear terms are those of a triangle of this volume: an inverted triangle is pushed
// back, and nothing is divided by zero. The solver counts it as inverted.
inline constexpr double kMinVolumeRatio = 0.05;

[[nodiscard]] inline Matrix2d cofactor(const Matrix2d &f) {
  return (Matrix2d() << f(1, 1), -f(1, 0), -f(0, 1), f(0, 0)).finished();
}

// Volume ratio: J = det F times the stretch of the thickness; for Hooke's law 1 + trace of the strain.
[[nodiscard]] inline double volume_ratio(const PlaneLaw &law, const Matrix2d &f, double thickness) {
  return law.law == tissue::Law::kLinear ? f(0, 0) + f(1, 1) + thickness - 2.0 : f.determinant() * thickness;
}

// Squares of the in-plane principal stretches, the larger first.
struct Squares {
  double first = 1.0;
  double second = 1.0;
};
[[nodiscard]] inline Squares principal_squares(const Matrix2d &f) {
  const double half_trace = 0.5 * f.squaredNorm();
  const double det = f.determinant();
  const double root = std::sqrt(std::max(half_trace * half_trace - det * det, 0.0));
  const double first = half_trace + root;
  return {first, std::max(det * det / first, 1e-6)};
}

// Kirchhoff's principal shear stresses: tau_i = 2 mu / alpha (lbar_i^alpha - mean), lbar = l J^(-1/3).
struct OgdenShear {
  double first = 0.0;
  double second = 0.0;
  double third = 0.0;
  double third_by_log = 0.0; // d third / d ln l3
};
[[nodiscard]] inline OgdenShear ogden_shear(const PlaneLaw &law, const Squares &squares, double thickness, double j) {
  const double volume_part = std::pow(j, -law.alpha / 3.0);
  const double a = volume_part * std::pow(squares.first, 0.5 * law.alpha);
  const double b = volume_part * std::pow(squares.second, 0.5 * law.alpha);
  const double c = volume_part * std::pow(thickness, law.alpha);
  const double mean = (a + b + c) / 3.0;
  const double k = 2.0 * law.shear_Pa / law.alpha;
  return {k * (a - mean), k * (b - mean), k * (c - mean), 2.0 * law.shear_Pa * (4.0 * c + a + b) / 9.0};
}

// First Piola-Kirchhoff stress of the plane, shear part; the pressure adds p thickness cof F (Hooke: p 1).
[[nodiscard]] inline Matrix2d shear_piola(const PlaneLaw &law, const Matrix2d &f, double thickness) {
  switch (law.law) {
  case tissue::Law::kLinear: {
    const double third = (f(0, 0) + f(1, 1) + thickness - 3.0) / 3.0;
    const double xy = law.shear_Pa * (f(0, 1) + f(1, 0));
    return (Matrix2d() << 2.0 * law.shear_Pa * (f(0, 0) - 1.0 - third), xy, xy,
            2.0 * law.shear_Pa * (f(1, 1) - 1.0 - third))
        .finished();
  }
  case tissue::Law::kOgden: {
    const double det = std::max(f.determinant(), kMinVolumeRatio);
    const Squares s = principal_squares(f);
    const OgdenShear tau = ogden_shear(law, s, thickness, det * thickness);
    // S = a 1 + b C has the principal values tau_i / l_i^2; no principal directions are needed.
    const double first = tau.first / s.first;
    const double second = tau.second / s.second;
    const double gap = s.first - s.second;
    const double b = gap > 1e-9 * s.first ? (first - second) / gap : 0.0;
    const double a = first - b * s.first;
    return a * f + b * f * (f.transpose() * f);
  }
  case tissue::Law::kNeoHookean:
    break;
  }
  const double det = std::max(f.determinant(), kMinVolumeRatio);
  const double j = det * thickness;
  const double g = law.shear_Pa / std::cbrt(j * j);
  const double third = (f.squaredNorm() + thickness * thickness) / 3.0;
  return g * f - (g * third / det) * cofactor(f);
}

// Cauchy's stress with pressure p (positive in tension).
[[nodiscard]] inline PlaneStress cauchy(const PlaneLaw &law, const Matrix2d &f, double thickness, double p) {
  const Matrix2d piola = shear_piola(law, f, thickness);
  if (law.law == tissue::Law::kLinear) {
    return {piola(0, 0) + p, piola(1, 1) + p, p - piola(0, 0) - piola(1, 1), piola(0, 1)};
  }
  const Matrix2d sigma = piola * f.transpose() / (std::max(f.determinant(), kMinVolumeRatio) * thickness);
  const double across = -sigma.trace(); // shear stresses have no trace
  return {sigma(0, 0) + p, sigma(1, 1) + p, across + p, 0.5 * (sigma(0, 1) + sigma(1, 0))};
}

// Plane stress: the stretch of the thickness at which the stress across the plane vanishes, by Newton's method in its
// logarithm, started from the previous stretch.
[[nodiscard]] inline double free_thickness(const PlaneLaw &law, const Matrix2d &f, double thickness) {
  if (law.law == tissue::Law::kLinear) {
    const double lambda = law.bulk_Pa - 2.0 / 3.0 * law.shear_Pa;
    return 1.0 - lambda / (lambda + 2.0 * law.shear_Pa) * (f(0, 0) + f(1, 1) - 2.0);
  }
  const double det = std::max(f.determinant(), kMinVolumeRatio);
  const Squares squares = law.law == tissue::Law::kOgden ? principal_squares(f) : Squares{};
  const double in_plane = f.squaredNorm();
  for (int k = 0; k < 20; ++k) {
    const double j = det * thickness;
    double value = law.bulk_Pa * (j - 1.0) * j;
    double slope = law.bulk_Pa * (2.0 * j - 1.0) * j;
    if (law.law == tissue::Law::kOgden) {
      const OgdenShear tau = ogden_shear(law, squares, thickness, j);
      value += tau.third;
      slope += tau.third_by_log;
    } else {
      const double g = law.shear_Pa / std::cbrt(j * j);
      const double square = thickness * thickness;
      value += g * (2.0 * square - in_plane) / 3.0;
      slope += g * (8.0 * square + 2.0 * in_plane) / 9.0;
    }
    // Under strong compression the slope is not reliable: the step falls back to a safe slope.
    const double step = std::clamp(-value / std::max(slope, 0.1 * law.bulk_Pa * j), -0.5, 0.5);
    thickness *= std::exp(step);
    if (std::abs(step) < 1e-12) {
      break;
    }
  }
  return thickness;
}

} // namespace plane_law
} // namespace bregma::tissue_plane
