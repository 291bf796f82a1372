#include "algorithms/registration/clouds/gauss_kernel.hpp"

#include "algorithms/simd/lanes.hpp"

#include <array>

namespace bregma::registration {

namespace {

using simd::load;
using simd::store;
using simd::total;
using simd::Vector16;
using simd::Vector4;
using simd::Vector8;

// v becomes exp(v) for v <= 0: 2^n 2^f with |f| <= 1/2 and 2^f by its Taylor polynomial of degree 6 (relative error
// below 2e-7 in floats). n comes from the last bits of a sum with 1.5 2^23.
template <class Vector> BREGMA_INLINE void exponential(typename Vector::Float &v) {
  using Float = typename Vector::Float;
  using Int = typename Vector::Int;
  const Float low = Float{} - 87.0F;
  v = v < low ? low : v;
  const Float scaled = v * 1.44269504F;
  const Float shifted = scaled + 12582912.0F;
  const Float f = scaled - (shifted - 12582912.0F);
  Float p = f * 1.5403530e-4F + 1.3333558e-3F;
  p = p * f + 9.6181291e-3F;
  p = p * f + 5.5504109e-2F;
  p = p * f + 0.24022651F;
  p = p * f + 0.69314718F;
  p = p * f + 1.0F;
  v = reinterpret_cast<Float>(reinterpret_cast<Int>(p) + (reinterpret_cast<Int>(shifted) << 23));
}

template <class Vector>
BREGMA_INLINE void add_rows(const GaussBlock &block, GaussRow *rows, float inverse_two_sigma_squared,
                            float outlier_constant) {
  using Float = typename Vector::Float;
  constexpr std::size_t kLanes = sizeof(Float) / sizeof(float);
  std::array<float, kGaussRows> inverse{};
  for (std::size_t r = 0; r < kGaussRows; ++r) {
    Float kernel{};
    Float squares{};
    for (std::size_t i = 0; i < block.size; i += kLanes) {
      Float x;
      Float y;
      Float z;
      load(x, block.x + i);
      load(y, block.y + i);
      load(z, block.z + i);
      x = rows[r].x - x;
      y = rows[r].y - y;
      z = rows[r].z - z;
      const Float d2 = x * x + y * y + z * z;
      Float k = d2 * -inverse_two_sigma_squared;
      exponential<Vector>(k);
      kernel += k;
      squares += k * d2;
      store(block.scratch + r * block.size + i, k);
    }
    rows[r].kernel = total(kernel);
    rows[r].kernel_squares = total(squares);
    const float divisor = rows[r].kernel + outlier_constant;
    inverse[r] = divisor > 1e-30F ? rows[r].used / divisor : 0.0F;
  }
  // Four rows at a time: the sums are loaded and stored once for all of them.
  for (std::size_t i = 0; i < block.size; i += kLanes) {
    Float x;
    Float y;
    Float z;
    Float weight;
    Float pull_x;
    Float pull_y;
    Float pull_z;
    load(x, block.x + i);
    load(y, block.y + i);
    load(z, block.z + i);
    load(weight, block.weight + i);
    load(pull_x, block.pull_x + i);
    load(pull_y, block.pull_y + i);
    load(pull_z, block.pull_z + i);
    for (std::size_t r = 0; r < kGaussRows; ++r) {
      Float p;
      load(p, block.scratch + r * block.size + i);
      p *= inverse[r];
      weight += p;
      pull_x += p * (rows[r].x - x);
      pull_y += p * (rows[r].y - y);
      pull_z += p * (rows[r].z - z);
    }
    store(block.weight + i, weight);
    store(block.pull_x + i, pull_x);
    store(block.pull_y + i, pull_y);
    store(block.pull_z + i, pull_z);
  }
}

void add_rows_4(const GaussBlock &block, GaussRow *rows, float inverse_two_sigma_squared, float outlier_constant) {
  add_rows<Vector4>(block, rows, inverse_two_sigma_squared, outlier_constant);
}

#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) void add_rows_8(const GaussBlock &block, GaussRow *rows,
                                                    float inverse_two_sigma_squared, float outlier_constant) {
  add_rows<Vector8>(block, rows, inverse_two_sigma_squared, outlier_constant);
}
__attribute__((target("avx512f,avx512dq,avx2,fma"))) void
add_rows_16(const GaussBlock &block, GaussRow *rows, float inverse_two_sigma_squared, float outlier_constant) {
  add_rows<Vector16>(block, rows, inverse_two_sigma_squared, outlier_constant);
}
#endif

} // namespace

std::span<const GaussKernel> gauss_kernels() noexcept {
#if defined(__x86_64__)
  static constexpr std::array kKernels{GaussKernel{"AVX-512", add_rows_16}, GaussKernel{"AVX2", add_rows_8},
                                       GaussKernel{"four floats", add_rows_4}};
  return std::span(kKernels).subspan(simd::has_avx512() ? 0U : simd::has_avx2() ? 1U : 2U);
#else
  static constexpr std::array kKernels{GaussKernel{"four floats", add_rows_4}};
  return kKernels;
#endif
}

} // namespace bregma::registration
