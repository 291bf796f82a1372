#include "tests/support/tissue_references.hpp"

#include <cmath>
#include <vector>

namespace bregma::test {

Eigen::Vector3d principal_cauchy_Pa(const tissue::Material &material, const Eigen::Vector3d &stretches) {
  const double volume = stretches.prod();
  const double alpha = material.law == tissue::Law::kOgden ? material.ogden_alpha : 2.0;
  const Eigen::Array3d power = (stretches * std::cbrt(1.0 / volume)).array().pow(alpha);
  const double pressure = material.bulk_Pa() * (volume - 1.0);
  return ((power - power.mean()) * (2.0 * material.shear_Pa() / (alpha * volume)) + pressure).matrix();
}

UniaxialReference uniaxial_reference(const tissue::Material &material, double along) {
  double low = 0.2;
  double high = 5.0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (principal_cauchy_Pa(material, {middle, middle, along}).x() > 0.0 ? high : low) = middle;
  }
  return {low, principal_cauchy_Pa(material, {low, low, along}).z() * low * low};
}

// ---- spheres ----

double LameSphere::radial_displacement_m(double r) const {
  const double a3 = inner_m * inner_m * inner_m;
  const double b3 = outer_m * outer_m * outer_m;
  return pressure_Pa * a3 / (young_Pa * (b3 - a3)) * ((1.0 - 2.0 * poisson) * r + 0.5 * (1.0 + poisson) * b3 / (r * r));
}

double LameSphere::radial_stress_Pa(double r) const {
  const double a3 = inner_m * inner_m * inner_m;
  const double b3 = outer_m * outer_m * outer_m;
  return pressure_Pa * a3 / (b3 - a3) * (1.0 - b3 / (r * r * r));
}

double LameSphere::hoop_stress_Pa(double r) const {
  const double a3 = inner_m * inner_m * inner_m;
  const double b3 = outer_m * outer_m * outer_m;
  return pressure_Pa * a3 / (b3 - a3) * (1.0 + 0.5 * b3 / (r * r * r));
}

double blown_sphere_pressure_Pa(double shear_Pa, double inner_m, double outer_m, double inner_now_m) {
  const double grown = std::pow(inner_now_m, 3) - std::pow(inner_m, 3);
  const double inside = inner_now_m / inner_m;
  const double outside = std::cbrt(std::pow(outer_m, 3) + grown) / outer_m;
  const auto term = [](double stretch) { return std::pow(stretch, -4) + 4.0 / stretch; };
  return 0.5 * shear_Pa * (term(outside) - term(inside));
}

// ---- beams ----

Eigen::Vector2d PlaneStrainBeam::displacement_m(double x, double y) const {
  const double young = young_Pa / (1.0 - poisson * poisson);
  const double nu = poisson / (1.0 - poisson);
  const double k = force_N_per_m / (6.0 * young * inertia_m3());
  const double d2 = height_m * height_m;
  return {k * y * ((6.0 * length_m - 3.0 * x) * x + (2.0 + nu) * (y * y - 0.25 * d2)),
          -k * (3.0 * nu * y * y * (length_m - x) + (4.0 + 5.0 * nu) * d2 * x / 4.0 + (3.0 * length_m - x) * x * x)};
}

double PlaneStrainBeam::axial_stress_Pa(double x, double y) const {
  return force_N_per_m * (length_m - x) * y / inertia_m3();
}

double PlaneStrainBeam::shear_stress_Pa(double y) const {
  return -force_N_per_m / (2.0 * inertia_m3()) * (0.25 * height_m * height_m - y * y);
}

double timoshenko_deflection_m(double force_N, double length_m, double width_m, double height_m, double young_Pa,
                               double poisson) {
  const double area = width_m * height_m;
  const double inertia = area * height_m * height_m / 12.0;
  const double shear = young_Pa / (2.0 * (1.0 + poisson));
  const double coefficient = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson);
  return force_N * length_m * length_m * length_m / (3.0 * young_Pa * inertia) +
         force_N * length_m / (coefficient * shear * area);
}

// ---- relaxation ----

double relaxing_bar_Pa(const tissue::Material &material, double strain, double time_s) {
  const double kappa = material.bulk_Pa();
  const double mu = material.shear_Pa();
  // d: axial minus lateral strain; h: relaxed part per term. Zero lateral stress: kappa tr = 2/3 mu (d - h).
  std::vector<double> taken(material.prony.size(), 0.0);
  const auto difference = [&] {
    double sum = 0.0;
    for (const double h : taken) {
      sum += h;
    }
    return std::pair((3.0 * kappa * strain + 2.0 / 3.0 * mu * sum) / (2.0 * kappa + 2.0 / 3.0 * mu), sum);
  };
  constexpr int kSteps = 200000;
  const double dt = time_s / kSteps;
  for (int i = 0; i < kSteps; ++i) {
    const double d = difference().first;
    for (std::size_t k = 0; k < taken.size(); ++k) {
      taken[k] += -std::expm1(-dt / material.prony[k].time_s) * (material.prony[k].fraction * d - taken[k]);
    }
  }
  const auto [d, sum] = difference();
  return 2.0 * mu * (d - sum);
}

} // namespace bregma::test
