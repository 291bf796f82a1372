// One robust point-to-plane step over the planes of a SurfaceField, in vectors of floats (plane_kernel.hpp): the inner
// loop of the searches, a few nanoseconds per sample. Its result is refined afterwards, in double precision and with
// exact closest points.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/surface/surface_field.hpp"

namespace bregma::registration {

// Samples for the kernels: a structure of arrays of floats, in the source frame.
class SampleLanes {
public:
  explicit SampleLanes(std::size_t capacity = 0) { reserve(capacity); }
  void reserve(std::size_t capacity);
  [[nodiscard]] std::size_t capacity() const noexcept { return capacity_; }
  // Up to the capacity.
  void set(std::size_t i, const Vector3d &p) noexcept {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      axes_[axis][i] = static_cast<float>(p[static_cast<Eigen::Index>(axis)]);
    }
  }
  [[nodiscard]] const float *axis(std::size_t i) const noexcept { return axes_[i].data(); }

private:
  std::size_t capacity_ = 0;
  std::array<std::vector<float>, 3> axes_; // padded to whole vectors
};

struct PlaneStep {
  Matrix6d normal = Matrix6d::Zero(); // J'WJ; twists about the given centre
  geometry::Vector6d gradient = geometry::Vector6d::Zero();
  double cost = 0.0; // sum of Geman and McClure's losses, each between 0 and 1
};

// Residuals of the first count samples, weighted as in [Geman 1985]: loss r^2 / (r^2 + reach^2).
[[nodiscard]] PlaneStep plane_step(const surface::SurfaceField &field, const SampleLanes &samples, std::size_t count,
                                   const PairedPose &T_target_source, const Vector3d &centre_mm,
                                   double reach_mm) noexcept;
// The cost alone.
[[nodiscard]] double plane_cost(const surface::SurfaceField &field, const SampleLanes &samples, std::size_t count,
                                const PairedPose &T_target_source, double reach_mm) noexcept;
// The median distance of the first count samples (at least one) from their planes; scratch: whole_lanes(count) floats.
[[nodiscard]] double plane_median_mm(const surface::SurfaceField &field, const SampleLanes &samples, std::size_t count,
                                     const PairedPose &T_target_source, float *scratch) noexcept;
[[nodiscard]] std::size_t whole_lanes(std::size_t count) noexcept;
// The element of this rank, from 0, of the first count non-negative values in ascending order. Values after them, up to
// whole_lanes(count), are set to infinity.
[[nodiscard]] float ranked(std::span<float> values, std::size_t count, std::size_t rank) noexcept;

// The twist that minimises the step's damped quadratic model: directions that the samples hardly determine change
// little. damping is relative to the weight of all samples; rotations are scaled by the lever. The motion at the lever
// is at most limit_mm.
[[nodiscard]] geometry::Vector6d solve_damped(const Matrix6d &normal, const geometry::Vector6d &gradient,
                                              double damping, double limit_mm) noexcept;

inline constexpr double kStepLimit_mm = 30.0; // maximum motion of the searches at the lever
inline constexpr double kHeadLever_mm = 80.0; // lever that scales rotations against translations

// The maximum motion of a point at the lever by a twist.
[[nodiscard]] inline double motion_at_lever_mm(const geometry::Vector6d &twist) {
  return kHeadLever_mm * twist.head<3>().norm() + twist.tail<3>().norm();
}

} // namespace bregma::registration
