#include "algorithms/tissue/material/constitutive.hpp"

#include <cmath>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace bregma::tissue {
namespace {

Eigen::Matrix3d small_strain(const Eigen::Matrix3d &f) {
  return 0.5 * (f + f.transpose()) - Eigen::Matrix3d::Identity();
}

Eigen::Matrix3d deviator(const Eigen::Matrix3d &m) { return m - m.trace() / 3.0 * Eigen::Matrix3d::Identity(); }

Eigen::Matrix3d ogden(double shear_Pa, double alpha, const Eigen::Matrix3d &f) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(f.transpose() * f);
  const Eigen::Vector3d &squared = eigen.eigenvalues();
  const double isochoric = std::pow(f.determinant(), -2.0 / 3.0);
  const Eigen::Vector3d power = (squared * isochoric).array().pow(0.5 * alpha).matrix();
  const Eigen::Vector3d stress = ((power.array() - power.mean()) * (2.0 * shear_Pa / alpha) / squared.array()).matrix();
  return eigen.eigenvectors() * stress.asDiagonal() * eigen.eigenvectors().transpose();
}

} // namespace

Eigen::Matrix3d shear_stress_Pa(const Material &material, const Eigen::Matrix3d &f) {
  const double shear = material.shear_Pa();
  switch (material.law) {
  case Law::kLinear:
    return 2.0 * shear * deviator(small_strain(f));
  case Law::kOgden:
    return ogden(shear, material.ogden_alpha, f);
  case Law::kNeoHookean:
    break;
  }
  const Eigen::Matrix3d c = f.transpose() * f;
  return shear * std::pow(f.determinant(), -2.0 / 3.0) * (Eigen::Matrix3d::Identity() - c.trace() / 3.0 * c.inverse());
}

double pressure_Pa(const Material &material, const Eigen::Matrix3d &f) {
  const double change = material.law == Law::kLinear ? small_strain(f).trace() : f.determinant() - 1.0;
  return material.bulk_Pa() * change;
}

Eigen::Matrix3d cauchy_Pa(const Material &material, const Eigen::Matrix3d &f, const Eigen::Matrix3d &shear_stress_Pa,
                          double pressure_Pa) {
  const Eigen::Matrix3d pressure = pressure_Pa * Eigen::Matrix3d::Identity();
  if (material.law == Law::kLinear) {
    return shear_stress_Pa + pressure;
  }
  return f * shear_stress_Pa * f.transpose() / f.determinant() + pressure;
}

double von_mises_Pa(const Eigen::Matrix3d &cauchy_Pa) { return std::sqrt(1.5) * deviator(cauchy_Pa).norm(); }

} // namespace bregma::tissue
