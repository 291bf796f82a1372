#include "algorithms/registration/surface/plane_kernel.hpp"

#include "algorithms/simd/lanes.hpp"

#include <array>
#include <limits>

namespace bregma::registration {

namespace {

using simd::load;
using simd::total;
using Lanes4 = simd::Vector4;
using Lanes8 = simd::Vector8;
using Float4 = Lanes4::Float;

template <class Lanes> constexpr std::size_t kCount = sizeof(typename Lanes::Float) / sizeof(float);

// Mapped samples and the planes of their voxels.
template <class Lanes> struct Located { typename Lanes::Float x, y, z, normal_x, normal_y, normal_z, offset; };

// Four planes of four numbers, transposed.
BREGMA_INLINE void load_planes(const float *planes, const int *voxel, Float4 &nx, Float4 &ny, Float4 &nz,
                               Float4 &offset) {
  std::array<Float4, 4> row;
  for (std::size_t i = 0; i < 4; ++i) {
    load(row[i], planes + 4 * static_cast<std::ptrdiff_t>(voxel[i]));
  }
  const Float4 low01 = __builtin_shufflevector(row[0], row[1], 0, 4, 1, 5);
  const Float4 low23 = __builtin_shufflevector(row[2], row[3], 0, 4, 1, 5);
  const Float4 high01 = __builtin_shufflevector(row[0], row[1], 2, 6, 3, 7);
  const Float4 high23 = __builtin_shufflevector(row[2], row[3], 2, 6, 3, 7);
  nx = __builtin_shufflevector(low01, low23, 0, 1, 4, 5);
  ny = __builtin_shufflevector(low01, low23, 2, 3, 6, 7);
  nz = __builtin_shufflevector(high01, high23, 0, 1, 4, 5);
  offset = __builtin_shufflevector(high01, high23, 2, 3, 6, 7);
}

BREGMA_INLINE void take_planes(const float *planes, const std::array<int, 4> &voxel, Located<Lanes4> &at) {
  load_planes(planes, voxel.data(), at.normal_x, at.normal_y, at.normal_z, at.offset);
}
BREGMA_INLINE void take_planes(const float *planes, const std::array<int, 8> &voxel, Located<Lanes8> &at) {
  std::array<Float4, 4> low;
  std::array<Float4, 4> high;
  load_planes(planes, voxel.data(), low[0], low[1], low[2], low[3]);
  load_planes(planes, voxel.data() + 4, high[0], high[1], high[2], high[3]);
  at.normal_x = __builtin_shufflevector(low[0], high[0], 0, 1, 2, 3, 4, 5, 6, 7);
  at.normal_y = __builtin_shufflevector(low[1], high[1], 0, 1, 2, 3, 4, 5, 6, 7);
  at.normal_z = __builtin_shufflevector(low[2], high[2], 0, 1, 2, 3, 4, 5, 6, 7);
  at.offset = __builtin_shufflevector(low[3], high[3], 0, 1, 2, 3, 4, 5, 6, 7);
}

// Voxel indices along one axis; NaN maps to the first.
template <class Lanes>
BREGMA_INLINE void voxels(const typename Lanes::Float &p, float low, float per_mm, int size, typename Lanes::Int &out) {
  using Float = typename Lanes::Float;
  Float at = (p - low) * per_mm;
  const Float none{};
  const Float last = none + static_cast<float>(size - 1);
  at = at > none ? at : none;
  at = at < last ? at : last;
  out = __builtin_convertvector(at, typename Lanes::Int);
}

template <class Lanes> BREGMA_INLINE void locate(const PlaneQuery &q, std::size_t i, Located<Lanes> &at) {
  using Float = typename Lanes::Float;
  using Int = typename Lanes::Int;
  Float x;
  Float y;
  Float z;
  load(x, q.x + i);
  load(y, q.y + i);
  load(z, q.z + i);
  const auto &R = q.rotation;
  at.x = x * R[0] + y * R[1] + z * R[2] + q.translation[0];
  at.y = x * R[3] + y * R[4] + z * R[5] + q.translation[1];
  at.z = x * R[6] + y * R[7] + z * R[8] + q.translation[2];
  Int column;
  Int row;
  Int slice;
  voxels<Lanes>(at.x, q.grid.low[0], q.grid.per_mm, q.grid.size[0], column);
  voxels<Lanes>(at.y, q.grid.low[1], q.grid.per_mm, q.grid.size[1], row);
  voxels<Lanes>(at.z, q.grid.low[2], q.grid.per_mm, q.grid.size[2], slice);
  const Int number = column + q.grid.size[0] * (row + q.grid.size[1] * slice); // no more than 50 million
  std::array<int, kCount<Lanes>> voxel;
  __builtin_memcpy(voxel.data(), &number, sizeof(Int));
  take_planes(q.grid.planes, voxel, at);
}

template <class Lanes> BREGMA_INLINE void residual(const Located<Lanes> &at, typename Lanes::Float &r) {
  r = at.normal_x * at.x + at.normal_y * at.y + at.normal_z * at.z + at.offset;
}

// value where the sample exists, otherwise `none`.
template <class Lanes> BREGMA_INLINE void keep_first(typename Lanes::Float &value, std::size_t samples, float none) {
  if (samples < kCount<Lanes>) {
    for (std::size_t lane = samples; lane < kCount<Lanes>; ++lane) {
      value[lane] = none;
    }
  }
}

template <class Lanes> BREGMA_INLINE void residuals(const PlaneQuery &q, float *out) {
  using Float = typename Lanes::Float;
  for (std::size_t i = 0; i < q.count; i += kCount<Lanes>) {
    Located<Lanes> at;
    locate<Lanes>(q, i, at);
    Float r;
    residual<Lanes>(at, r);
    r = r < Float{} ? -r : r;
    keep_first<Lanes>(r, q.count - i, std::numeric_limits<float>::infinity());
    __builtin_memcpy(out + i, &r, sizeof(Float));
  }
  // Lists end at a multiple of the widest vector, whichever is used.
  for (std::size_t i = (q.count + kCount<Lanes> - 1) / kCount<Lanes> * kCount<Lanes>; i % kPlaneLanes != 0; ++i) {
    out[i] = std::numeric_limits<float>::infinity();
  }
}

template <class Lanes>
BREGMA_INLINE void sums(const PlaneQuery &q, const std::array<float, 3> &centre, float reach2, PlaneSums &out) {
  using Float = typename Lanes::Float;
  std::array<Float, 21> normal{};
  std::array<Float, 6> gradient{};
  Float cost{};
  for (std::size_t i = 0; i < q.count; i += kCount<Lanes>) {
    Located<Lanes> at;
    locate<Lanes>(q, i, at);
    Float r;
    residual<Lanes>(at, r);
    Float falloff = reach2 / (reach2 + r * r);
    Float loss = 1.0F - falloff;
    keep_first<Lanes>(falloff, q.count - i, 0.0F);
    keep_first<Lanes>(loss, q.count - i, 0.0F);
    cost += loss;
    const Float x = at.x - centre[0];
    const Float y = at.y - centre[1];
    const Float z = at.z - centre[2];
    const std::array<Float, 6> J{y * at.normal_z - z * at.normal_y,
                                 z * at.normal_x - x * at.normal_z,
                                 x * at.normal_y - y * at.normal_x,
                                 at.normal_x,
                                 at.normal_y,
                                 at.normal_z};
    for (std::size_t a = 0, k = 0; a < 6; ++a) {
      const Float weighted = falloff * falloff * J[a];
      gradient[a] += weighted * r;
      for (std::size_t b = 0; b <= a; ++b, ++k) {
        normal[k] += weighted * J[b];
      }
    }
  }
  for (std::size_t k = 0; k < normal.size(); ++k) {
    out.normal[k] = total(normal[k]);
  }
  for (std::size_t a = 0; a < gradient.size(); ++a) {
    out.gradient[a] = total(gradient[a]);
  }
  out.cost = total(cost);
}

template <class Lanes> BREGMA_INLINE float cost(const PlaneQuery &q, float reach2) {
  using Float = typename Lanes::Float;
  Float sum{};
  for (std::size_t i = 0; i < q.count; i += kCount<Lanes>) {
    Located<Lanes> at;
    locate<Lanes>(q, i, at);
    Float r;
    residual<Lanes>(at, r);
    Float loss = 1.0F - reach2 / (reach2 + r * r);
    keep_first<Lanes>(loss, q.count - i, 0.0F);
    sum += loss;
  }
  return total(sum);
}

// Bisection over the bit patterns: for non-negative floats they have the order of the floats, and counting has no
// branches.
template <class Lanes> BREGMA_INLINE float ranked(const float *values, std::size_t count, std::size_t rank) {
  using Int = typename Lanes::Int;
  const auto wanted = static_cast<int>(rank); // number of values that are not larger
  int low = 0;
  int high = 0x7F800000; // infinity
  while (low < high) {
    const int middle = low + (high - low) / 2;
    Int above{};
    for (std::size_t i = 0; i < count; i += kCount<Lanes>) {
      Int bits;
      __builtin_memcpy(&bits, values + i, sizeof(Int));
      above += bits > middle; // -1 per lane
    }
    int no_larger = static_cast<int>((count + kCount<Lanes> - 1) / kCount<Lanes> * kCount<Lanes>);
    for (std::size_t lane = 0; lane < kCount<Lanes>; ++lane) {
      no_larger += above[lane];
    }
    if (no_larger > wanted) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  float out = 0.0F;
  __builtin_memcpy(&out, &low, sizeof out);
  return out;
}

void residuals_4(const PlaneQuery &q, float *out) { residuals<Lanes4>(q, out); }
void sums_4(const PlaneQuery &q, const std::array<float, 3> &centre, float reach2, PlaneSums &out) {
  sums<Lanes4>(q, centre, reach2, out);
}
float cost_4(const PlaneQuery &q, float reach2) { return cost<Lanes4>(q, reach2); }
float ranked_4(const float *values, std::size_t count, std::size_t rank) { return ranked<Lanes4>(values, count, rank); }

#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) void residuals_8(const PlaneQuery &q, float *out) { residuals<Lanes8>(q, out); }
__attribute__((target("avx2,fma"))) void sums_8(const PlaneQuery &q, const std::array<float, 3> &centre, float reach2,
                                                PlaneSums &out) {
  sums<Lanes8>(q, centre, reach2, out);
}
__attribute__((target("avx2,fma"))) float cost_8(const PlaneQuery &q, float reach2) { return cost<Lanes8>(q, reach2); }
__attribute__((target("avx2,fma"))) float ranked_8(const float *values, std::size_t count, std::size_t rank) {
  return ranked<Lanes8>(values, count, rank);
}
#endif

} // namespace

std::span<const PlaneKernel> plane_kernels() noexcept {
#if defined(__x86_64__)
  static constexpr std::array kKernels{PlaneKernel{"AVX2", residuals_8, sums_8, cost_8, ranked_8},
                                       PlaneKernel{"four floats", residuals_4, sums_4, cost_4, ranked_4}};
  return std::span(kKernels).subspan(simd::has_avx2() ? 0U : 1U);
#else
  static constexpr std::array kKernels{PlaneKernel{"four floats", residuals_4, sums_4, cost_4, ranked_4}};
  return kKernels;
#endif
}

} // namespace bregma::registration
