// One robust point-to-plane step over the planes of a SurfaceField, in single precision: the inner loop of the
// searches, some ten nanoseconds a sample. What it finds is made exact afterwards, in double precision and with exact
// closest points.
#pragma once

#include <span>

#include "algorithms/registration/paired_points.hpp"
#include "algorithms/registration/surface_field.hpp"

namespace bregma::registration {

struct PlaneStep {
  Matrix6d normal = Matrix6d::Zero(); // J'WJ; twists about the centre given
  geometry::Vector6d gradient = geometry::Vector6d::Zero();
  double cost = 0.0; // sum of Geman and McClure's losses, each between 0 and 1
};

// Residuals weighted after Geman & McClure 1985: loss r^2 / (r^2 + reach^2). samples_mm in the source frame.
[[nodiscard]] PlaneStep plane_step(const SurfaceField &field, std::span<const Eigen::Vector3f> samples_mm,
                                   const PairedPose &T_target_source, const Vector3d &centre_mm,
                                   double reach_mm) noexcept;
// The cost alone.
[[nodiscard]] double plane_cost(const SurfaceField &field, std::span<const Eigen::Vector3f> samples_mm,
                                const PairedPose &T_target_source, double reach_mm) noexcept;

// The twist that minimises the step's quadratic model, damped: directions that the samples hardly feel move little.
// damping is relative to the weight of all samples, rotations counted at the lever. At most limit_mm of motion at the
// lever.
[[nodiscard]] geometry::Vector6d solve_damped(const Matrix6d &normal, const geometry::Vector6d &gradient,
                                              double damping, double limit_mm) noexcept;

inline constexpr double kStepLimit_mm = 30.0; // of the searches, at the lever
inline constexpr double kHeadLever_mm = 80.0; // at which rotations are compared with translations

// The longest way that a twist moves a point at the lever.
[[nodiscard]] inline double motion_at_lever_mm(const geometry::Vector6d &twist) {
  return kHeadLever_mm * twist.head<3>().norm() + twist.tail<3>().norm();
}

} // namespace bregma::registration
