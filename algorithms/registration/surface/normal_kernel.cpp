#include "algorithms/registration/surface/normal_kernel.hpp"

#include "algorithms/simd/lanes.hpp"

#include <array>

namespace bregma::registration {

using geometry::Matrix6d;
using geometry::Vector6d;

namespace {

constexpr std::size_t kWidest = 4;

using simd::load;
using simd::total;
using Double2 = simd::DoubleVector<2>::Double;
using Double4 = simd::DoubleVector<4>::Double;

template <class Double>
BREGMA_INLINE void sums(const NormalRows &rows, std::size_t count, bool squared, NormalSums &out) {
  std::array<Double, 21> normal{};
  std::array<Double, 6> gradient{};
  for (std::size_t i = 0; i < count; i += sizeof(Double) / sizeof(double)) {
    std::array<Double, 6> J;
    for (std::size_t k = 0; k < 6; ++k) {
      load(J[k], rows.column(k) + i);
    }
    Double weight;
    Double residual;
    load(weight, rows.weights() + i);
    load(residual, rows.residuals() + i);
    weight = squared ? weight * weight : weight;
    for (std::size_t a = 0, k = 0; a < 6; ++a) {
      const Double weighted = weight * J[a];
      gradient[a] += weighted * residual;
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
}

void sums_2(const NormalRows &rows, std::size_t count, bool squared, NormalSums &out) {
  sums<Double2>(rows, count, squared, out);
}
#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) void sums_4(const NormalRows &rows, std::size_t count, bool squared,
                                                NormalSums &out) {
  sums<Double4>(rows, count, squared, out);
}
#endif

NormalSums widest(const NormalRows &rows, std::size_t count, bool squared) noexcept {
  NormalSums out;
  normal_kernels().front().sums(rows, count, squared, out);
  return out;
}

Matrix6d symmetric(const std::array<double, 21> &lower) {
  Matrix6d out;
  for (Eigen::Index a = 0, k = 0; a < 6; ++a) {
    for (Eigen::Index b = 0; b <= a; ++b, ++k) {
      out(a, b) = out(b, a) = lower[static_cast<std::size_t>(k)];
    }
  }
  return out;
}

} // namespace

NormalRows::NormalRows(std::size_t capacity) {
  const std::size_t whole = (capacity + kWidest - 1) / kWidest * kWidest;
  for (std::vector<double> &column : jacobian_) {
    column.resize(whole);
  }
  weight_.resize(whole);
  residual_.resize(whole);
}

void NormalRows::pad(std::size_t count) noexcept {
  for (std::size_t i = count; i % kWidest != 0; ++i) {
    set(i, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(), 0.0);
    weight_[i] = 0.0;
  }
}

Vector6d NormalRows::jacobian(std::size_t i) const noexcept {
  Vector6d out;
  for (std::size_t k = 0; k < 6; ++k) {
    out[static_cast<Eigen::Index>(k)] = jacobian_[k][i];
  }
  return out;
}

std::span<const NormalKernel> normal_kernels() noexcept {
#if defined(__x86_64__)
  static constexpr std::array kKernels{NormalKernel{"AVX2", sums_4}, NormalKernel{"two doubles", sums_2}};
  return std::span(kKernels).subspan(simd::has_avx2() ? 0U : 1U);
#else
  static constexpr std::array kKernels{NormalKernel{"two doubles", sums_2}};
  return kKernels;
#endif
}

void add_rows(const NormalRows &rows, std::size_t count, Matrix6d &normal, Vector6d &gradient) noexcept {
  const NormalSums sums = widest(rows, count, false);
  normal += symmetric(sums.normal);
  gradient += Vector6d::Map(sums.gradient.data());
}

Matrix6d squared_weight_sum(const NormalRows &rows, std::size_t count) noexcept {
  return symmetric(widest(rows, count, true).normal);
}

} // namespace bregma::registration
