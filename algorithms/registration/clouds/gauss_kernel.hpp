// The inner loop of coherent point drift: Gaussians between a few points and many, in vectors of floats.
//
// One version for each vector length; the widest that the processor has is chosen at run time, so that a binary for
// x86-64-v2 uses AVX2 or AVX-512 where they are. Floats are enough because every coordinate is relative to a centre
// near the data and every sum is short: see kGaussRelativeError. Pure, reentrant, no allocation.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

namespace bregma::registration {

inline constexpr std::size_t kGaussRows = 4;   // targets that are added at once
inline constexpr std::size_t kGaussLanes = 16; // block lengths are multiples of it, for every version

// Of one exponential, for arguments above -87 (below, it is 1e-38 instead of less).
inline constexpr double kGaussRelativeError = 1e-6;

// Sources as a structure of arrays, with the sums that belong to them. Length `size`, a multiple of kGaussLanes;
// sources that only fill it up lie so far away (kGaussFar) that their Gaussians vanish.
struct GaussBlock {
  std::size_t size = 0;
  const float *x = nullptr, *y = nullptr, *z = nullptr;
  float *weight = nullptr;                                       // += sum of P
  float *pull_x = nullptr, *pull_y = nullptr, *pull_z = nullptr; // += sum of P (target - source)
  float *scratch = nullptr;                                      // kGaussRows * size
};
inline constexpr float kGaussFar = 1e6F; // coordinates are of the order of one

struct GaussRow {
  float x = 0.0F, y = 0.0F, z = 0.0F; // the target
  float used = 1.0F;                  // 0 for rows that only fill up
  float kernel = 0.0F;                // out: sum of exp(-d^2 / 2 sigma^2) over the block
  float kernel_squares = 0.0F;        // out: the same times d^2
};

// P = exp(-d^2 / 2 sigma^2) / (their sum over the block + outlier_constant), added to the block's sums; 0 where the
// divisor is.
using AddGaussRows = void (*)(const GaussBlock &block, GaussRow *rows, float inverse_two_sigma_squared,
                              float outlier_constant);

struct GaussKernel {
  std::string_view name;
  AddGaussRows add_rows = nullptr;
};

// What this processor can run, the fastest first; never empty.
[[nodiscard]] std::span<const GaussKernel> gauss_kernels() noexcept;

} // namespace bregma::registration
