// References for the tissue solver: analytic solutions, and one-dimensional problems that are solved to full precision.
// Independent of algorithms/tissue/material/constitutive.hpp: principal stretches and closed forms. SI units unless a
// name states another unit.
#pragma once

#include <Eigen/Core>

#include "algorithms/tissue/material/material.hpp"

namespace bregma::test {

// Principal Cauchy stresses of principal stretches.
[[nodiscard]] Eigen::Vector3d principal_cauchy_Pa(const tissue::Material &material, const Eigen::Vector3d &stretches);

// A bar stretched along one axis, with free sides.
struct UniaxialReference {
  double across = 1.0;     // stretch
  double nominal_Pa = 0.0; // force per area at rest
};
[[nodiscard]] UniaxialReference uniaxial_reference(const tissue::Material &material, double along);

// Lame's solution: a hollow sphere under inner pressure, small strain.
struct LameSphere {
  double inner_m, outer_m, pressure_Pa, young_Pa, poisson;
  [[nodiscard]] double radial_displacement_m(double radius_m) const;
  [[nodiscard]] double radial_stress_Pa(double radius_m) const;
  [[nodiscard]] double hoop_stress_Pa(double radius_m) const;
};

// The pressure that expands a hollow, incompressible neo-Hookean sphere from inner_m to inner_now_m [Green 1954,
// section 3.10]: mu / 2 (b^-4 + 4 / b - a^-4 - 4 / a) for hoop stretches a inside and b outside.
[[nodiscard]] double blown_sphere_pressure_Pa(double shear_Pa, double inner_m, double outer_m, double inner_now_m);

// [Timoshenko 1951, section 21]: a cantilever 0 <= x <= length, |y| <= height / 2 under the shear force at its end, in
// plane strain; the end at x = 0 is displaced as in the solution [Augarde 2008].
struct PlaneStrainBeam {
  double length_m, height_m, force_N_per_m, young_Pa, poisson;
  [[nodiscard]] Eigen::Vector2d displacement_m(double x_m, double y_m) const;
  [[nodiscard]] double axial_stress_Pa(double x_m, double y_m) const;
  [[nodiscard]] double shear_stress_Pa(double y_m) const;

private:
  [[nodiscard]] double inertia_m3() const { return height_m * height_m * height_m / 12.0; }
};

// Deflection of the end of a slender cantilever of rectangular section (Timoshenko beam; shear coefficient
// [Cowper 1966]).
[[nodiscard]] double timoshenko_deflection_m(double force_N, double length_m, double width_m, double height_m,
                                             double young_Pa, double poisson);

// The nominal stress of a viscoelastic bar with free sides at time_s after a small step strain. The shear part relaxes,
// the bulk part does not.
[[nodiscard]] double relaxing_bar_Pa(const tissue::Material &material, double strain, double time_s);

} // namespace bregma::test
