// Vector types of GCC and Clang: the same code becomes SSE, AVX2 or AVX-512 by the target of its caller, which is
// selected at run time.
//
// Everything is inlined into that caller and passed by reference, since vectors as arguments depend on the instruction
// set. For the .cpp files of kernels only: vectors must not leave them.
#pragma once

#include <cstddef>

#define BREGMA_INLINE [[gnu::always_inline]] inline

namespace bregma::simd {

template <std::size_t Lanes> struct Vector {
  using Float [[gnu::vector_size(4 * Lanes)]] = float;
  using Int [[gnu::vector_size(4 * Lanes)]] = int;
  static constexpr int kLanes = static_cast<int>(Lanes);
};
using Vector4 = Vector<4>;
using Vector8 = Vector<8>;
using Vector16 = Vector<16>;

template <std::size_t Lanes> struct DoubleVector { using Double [[gnu::vector_size(8 * Lanes)]] = double; };

template <class V, class Number> BREGMA_INLINE void load(V &v, const Number *from) {
  __builtin_memcpy(&v, from, sizeof(V));
}
template <class V, class Number> BREGMA_INLINE void store(Number *to, const V &v) {
  __builtin_memcpy(to, &v, sizeof(V));
}

// The sum over the lanes, in order.
template <class V> BREGMA_INLINE auto total(const V &v) {
  auto sum = v[0];
  for (std::size_t i = 1; i < sizeof(V) / sizeof(sum); ++i) {
    sum += v[i];
  }
  return sum;
}

// Support of this machine; false where the build is not for x86-64.
inline bool has_avx2() noexcept {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0;
#else
  return false;
#endif
}
inline bool has_avx512() noexcept {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512dq") != 0;
#else
  return false;
#endif
}

} // namespace bregma::simd
