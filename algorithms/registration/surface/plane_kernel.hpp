// The inner loops of surface registration over a grid of planes (surface_field.hpp), in vectors of floats: residuals,
// and the sums of one robust point-to-plane step.
//
// There is one version per vector length; the widest that the processor supports is selected at run time. Floats
// suffice for coordinates of a head (a hundredth of a micrometre at 200 mm), since the result is refined in doubles
// afterwards. Units: mm. Pure, reentrant, no allocation.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>

#include "algorithms/surface/plane_grid.hpp"

namespace bregma::registration {

inline constexpr std::size_t kPlaneLanes = 8; // lists must be readable up to the next multiple of this

struct PlaneQuery {
  surface::PlaneGrid grid;
  const float *x = nullptr, *y = nullptr, *z = nullptr; // samples in the source frame
  std::size_t count = 0;
  std::array<float, 9> rotation{}; // rotation of T_target_source, row-major
  std::array<float, 3> translation{};
};

// Jacobians J = (lever x normal, normal) with levers from a centre; weights and loss of [Geman 1985],
// r^2 / (r^2 + reach^2).
struct PlaneSums {
  std::array<float, 21> normal{}; // J'WJ, the lower triangle by rows
  std::array<float, 6> gradient{};
  float cost = 0.0F; // sum of the losses, each between 0 and 1
};

struct PlaneKernel {
  std::string_view name;
  // |r| of each sample; the rest of the last vector becomes infinite.
  void (*residuals)(const PlaneQuery &query, float *out);
  void (*sums)(const PlaneQuery &query, const std::array<float, 3> &centre, float reach2, PlaneSums &out);
  float (*cost)(const PlaneQuery &query, float reach2);
  // The element of this rank, from 0, of non-negative values in ascending order; exact. The rest of the last vector
  // must be infinite.
  float (*ranked)(const float *values, std::size_t count, std::size_t rank);
};
// Kernels that this processor can run, the widest first; at least one.
[[nodiscard]] std::span<const PlaneKernel> plane_kernels() noexcept;

} // namespace bregma::registration
