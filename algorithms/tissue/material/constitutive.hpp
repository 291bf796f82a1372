// The laws of material.hpp for one point, in double precision: for stresses that are shown, and as a reference for the
// kernel. SI, thread-safe, no allocation.
#pragma once

#include <Eigen/Core>

#include "algorithms/tissue/material/material.hpp"

namespace bregma::tissue {

// Second Piola-Kirchhoff stress of W_iso (for Law::kLinear, the deviatoric stress of the small strain).
[[nodiscard]] Eigen::Matrix3d shear_stress_Pa(const Material &material, const Eigen::Matrix3d &deformation_gradient);

// kappa (J - 1); for Law::kLinear, kappa times the trace of the small strain.
[[nodiscard]] double pressure_Pa(const Material &material, const Eigen::Matrix3d &deformation_gradient);

// The Cauchy stress from a second Piola-Kirchhoff stress of the shear part and a pressure.
[[nodiscard]] Eigen::Matrix3d cauchy_Pa(const Material &material, const Eigen::Matrix3d &deformation_gradient,
                                        const Eigen::Matrix3d &shear_stress_Pa, double pressure_Pa);

// sqrt(3/2 s : s) of the deviator s.
[[nodiscard]] double von_mises_Pa(const Eigen::Matrix3d &cauchy_Pa);

} // namespace bregma::tissue
