// The inner loop of coherent point drift: Gaussians between a few points and many, in vectors of floats.
//
// There is one version per vector length. The widest that the processor supports is selected at run time, so that a
// binary for x86-64-v2 uses AVX2 or AVX-512 where available. Floats suffice because every coordinate is relative to a
// centre near the data and every sum is short: see kGaussRelativeError. Pure, reentrant, no allocation.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

namespace bregma::registration {

inline constexpr std::size_t kGaussRows = 4;   // targets per call
inline constexpr std::size_t kGaussLanes = 16; // block lengths are multiples of this, for every version

// Error of one exponential for arguments above -87 (below, the result is 1e-38 instead of less).
inline constexpr double kGaussRelativeError = 1e-6;

// Sources as a structure of arrays, with their sums. Length `size`, a multiple of kGaussLanes; padding sources are so
// far away (kGaussFar) that their Gaussians vanish.
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
  float used = 1.0F;                  // 0 for padding rows
  float kernel = 0.0F;                // out: sum of exp(-d^2 / 2 sigma^2) over the block
  float kernel_squares = 0.0F;        // out: sum of the same times d^2
};

// Adds P = exp(-d^2 / 2 sigma^2) / (their sum over the block + outlier_constant) to the block's sums; 0 where the
// divisor is 0.
using AddGaussRows = void (*)(const GaussBlock &block, GaussRow *rows, float inverse_two_sigma_squared,
                              float outlier_constant);

struct GaussKernel {
  std::string_view name;
  AddGaussRows add_rows = nullptr;
};

// Kernels that this processor can run, the fastest first; never empty.
[[nodiscard]] std::span<const GaussKernel> gauss_kernels() noexcept;

} // namespace bregma::registration
