#include "algorithms/intensity/sample_kernel.hpp"

#include <algorithm>

#include "algorithms/simd/lanes.hpp"

namespace bregma::intensity {

namespace {

using simd::load;
using simd::store;
using simd::Vector4;
using simd::Vector8;

constexpr float kEdgeTolerance = 1e-3F; // rounding of an index at the last voxel

struct Axis {
  float slack, last;
  int count, stride; // stride 0 along an axis with one voxel
};

std::array<Axis, 3> axes_of(const SampledGrid &grid) {
  std::array<Axis, 3> out{};
  int stride = 1;
  for (std::size_t d = 0; d < 3; ++d) {
    const int n = grid.size[d];
    out[d] = {n > 1 ? kEdgeTolerance : 0.5F, static_cast<float>(n - 1), n, n > 1 ? stride : 0};
    stride *= n;
  }
  return out;
}

// Index along one axis under the map; `inside` becomes 0 where it lies outside.
template <class Vector>
BREGMA_INLINE void place(typename Vector::Float &at, typename Vector::Int &inside, const Axis &axis) {
  using Float = typename Vector::Float;
  const Float low = Float{} - axis.slack;
  const Float high = Float{} + (axis.last + axis.slack);
  inside &= (at >= low) & (at <= high);
  const Float first{};
  const Float last = Float{} + axis.last;
  at = at > first ? at : first; // false for NaN as well
  at = at < last ? at : last;
}

// at becomes the fraction between the voxel `base` and the next one.
template <class Vector>
BREGMA_INLINE void split(typename Vector::Float &at, typename Vector::Int &base, const Axis &axis) {
  using Float = typename Vector::Float;
  using Int = typename Vector::Int;
  base = __builtin_convertvector(at, Int);
  const Int limit = Int{} + std::max(axis.count - 2, 0);
  base = base < limit ? base : limit;
  at -= __builtin_convertvector(base, Float);
}

template <class Vector> struct Point {
  typename Vector::Float x, y, z;
  typename Vector::Int inside;
};

template <class Vector>
BREGMA_INLINE void map_points(Point<Vector> &p, const SampleBlock &block, std::size_t i, const std::array<float, 12> &T,
                              const std::array<Axis, 3> &axis) {
  using Float = typename Vector::Float;
  Float x;
  Float y;
  Float z;
  load(x, block.x + i);
  load(y, block.y + i);
  load(z, block.z + i);
  p.x = x * T[0] + y * T[1] + z * T[2] + T[3];
  p.y = x * T[4] + y * T[5] + z * T[6] + T[7];
  p.z = x * T[8] + y * T[9] + z * T[10] + T[11];
  p.inside = typename Vector::Int{} - 1;
  place<Vector>(p.x, p.inside, axis[0]);
  place<Vector>(p.y, p.inside, axis[1]);
  place<Vector>(p.z, p.inside, axis[2]);
}

template <class Vector>
BREGMA_INLINE void sample_nearest(const SampleBlock &block, const std::array<float, 12> &T, const SampledGrid &grid,
                                  float outside, const SampledValues &out) {
  using Float = typename Vector::Float;
  using Int = typename Vector::Int;
  constexpr std::size_t kLanes = Vector::kLanes;
  const std::array<Axis, 3> axis = axes_of(grid);
  for (std::size_t i = 0; i < block.size; i += kLanes) {
    Point<Vector> p;
    map_points<Vector>(p, block, i, T, axis);
    const Int offset = __builtin_convertvector(p.x + 0.5F, Int) * axis[0].stride +
                       __builtin_convertvector(p.y + 0.5F, Int) * axis[1].stride +
                       __builtin_convertvector(p.z + 0.5F, Int) * axis[2].stride;
    Float value;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      value[lane] = grid.values[offset[lane]];
    }
    value = p.inside ? value : Float{} + outside;
    store(out.value + i, value);
  }
}

template <class Vector>
BREGMA_INLINE void sample_linear(const SampleBlock &block, const std::array<float, 12> &T, const SampledGrid &grid,
                                 float outside, const SampledValues &out) {
  using Float = typename Vector::Float;
  using Int = typename Vector::Int;
  constexpr std::size_t kLanes = Vector::kLanes;
  const std::array<Axis, 3> axis = axes_of(grid);
  const int sx = axis[0].stride;
  const int sy = axis[1].stride;
  const int sz = axis[2].stride;
  for (std::size_t i = 0; i < block.size; i += kLanes) {
    Point<Vector> p;
    map_points<Vector>(p, block, i, T, axis);
    Int bx;
    Int by;
    Int bz;
    split<Vector>(p.x, bx, axis[0]);
    split<Vector>(p.y, by, axis[1]);
    split<Vector>(p.z, bz, axis[2]);
    const Int offset = bx * sx + by * sy + bz * sz;
    std::array<std::array<float, kLanes>, 8> corner;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const float *at = grid.values + offset[lane];
      corner[0][lane] = at[0];
      corner[1][lane] = at[sx];
      corner[2][lane] = at[sy];
      corner[3][lane] = at[sx + sy];
      corner[4][lane] = at[sz];
      corner[5][lane] = at[sx + sz];
      corner[6][lane] = at[sy + sz];
      corner[7][lane] = at[sx + sy + sz];
    }
    std::array<Float, 8> c;
    for (std::size_t k = 0; k < 8; ++k) {
      load(c[k], corner[k].data());
    }
    const Float along_x00 = c[1] - c[0];
    const Float along_x10 = c[3] - c[2];
    const Float along_x01 = c[5] - c[4];
    const Float along_x11 = c[7] - c[6];
    const Float row00 = c[0] + p.x * along_x00;
    const Float row10 = c[2] + p.x * along_x10;
    const Float row01 = c[4] + p.x * along_x01;
    const Float row11 = c[6] + p.x * along_x11;
    const Float plane0 = row00 + p.y * (row10 - row00);
    const Float plane1 = row01 + p.y * (row11 - row01);
    Float value = plane0 + p.z * (plane1 - plane0);
    value = p.inside ? value : Float{} + outside;
    store(out.value + i, value);
    if (out.dx != nullptr) {
      const Float x0 = along_x00 + p.y * (along_x10 - along_x00);
      const Float x1 = along_x01 + p.y * (along_x11 - along_x01);
      const Float y0 = row10 - row00;
      const Float y1 = row11 - row01;
      const Float zero{};
      // Beside a voxel without a value there is no derivative: NaN differs from itself.
      const Int known = p.inside & (value == value); // NOLINT(misc-redundant-expression)
      const Float dx = known ? x0 + p.z * (x1 - x0) : zero;
      const Float dy = known ? y0 + p.z * (y1 - y0) : zero;
      const Float dz = known ? plane1 - plane0 : zero;
      store(out.dx + i, dx);
      store(out.dy + i, dy);
      store(out.dz + i, dz);
    }
  }
}

void nearest_4(const SampleBlock &block, const std::array<float, 12> &T, const SampledGrid &grid, float outside,
               const SampledValues &out) {
  sample_nearest<Vector4>(block, T, grid, outside, out);
}
void linear_4(const SampleBlock &block, const std::array<float, 12> &T, const SampledGrid &grid, float outside,
              const SampledValues &out) {
  sample_linear<Vector4>(block, T, grid, outside, out);
}

#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) void nearest_8(const SampleBlock &block, const std::array<float, 12> &T,
                                                   const SampledGrid &grid, float outside, const SampledValues &out) {
  sample_nearest<Vector8>(block, T, grid, outside, out);
}
__attribute__((target("avx2,fma"))) void linear_8(const SampleBlock &block, const std::array<float, 12> &T,
                                                  const SampledGrid &grid, float outside, const SampledValues &out) {
  sample_linear<Vector8>(block, T, grid, outside, out);
}
#endif

} // namespace

SampleKernels sample_kernels() noexcept {
#if defined(__x86_64__)
  if (simd::has_avx2()) {
    return {nearest_8, linear_8};
  }
#endif
  return {nearest_4, linear_4};
}

} // namespace bregma::intensity
