// Interpolation of an image at many points under an affine map: the inner loop of every comparison of two images.
//
// Internal to the room. The kernel is compiled for several instruction sets and chosen at run time. Reentrant, no
// allocation, no exception.
#pragma once

#include <array>
#include <cstddef>

namespace bregma::intensity {

// Lists that a kernel reads or writes are padded to a multiple of this.
inline constexpr std::size_t kSamplePadding = 16;

struct SampleBlock {
  const float *x = nullptr, *y = nullptr, *z = nullptr; // index of each point in the reference
  std::size_t size = 0;                                 // multiple of kSamplePadding
};

struct SampledGrid {
  const float *values = nullptr; // the first axis runs fastest; NaN: no value there
  std::array<int, 3> size{};
};

struct SampledValues {
  float *value = nullptr;
  // Derivative with respect to the index in the sampled grid, 0 where there is no value; null: not wanted.
  float *dx = nullptr, *dy = nullptr, *dz = nullptr;
};

// T: the upper three rows of the map from the reference's index to the sampled grid's, row by row. A point outside the
// voxels' centres has the value `outside`; along an axis with one voxel, points within half a voxel are inside.
using SampleKernel = void (*)(const SampleBlock &, const std::array<float, 12> &T, const SampledGrid &, float outside,
                              const SampledValues &);

struct SampleKernels {
  SampleKernel nearest; // leaves the derivatives alone
  SampleKernel linear;
};
[[nodiscard]] SampleKernels sample_kernels() noexcept;

} // namespace bregma::intensity
