// Operations on vectors of floats for the element kernel. Private to element_kernel.cpp.
#pragma once

#include "algorithms/simd/lanes.hpp"
#include "algorithms/tissue/solver/element_kernel.hpp"

namespace bregma::tissue {

using simd::load;
using simd::store;
using simd::Vector4;
using simd::Vector8;

// ---- nodes to lanes and back ----

// x, y, z, w of the lanes' nodes: whole rows are loaded and transposed.
BREGMA_INLINE void gather(const NodeVector *nodes, const int *index, Vector4::Float &x, Vector4::Float &y,
                          Vector4::Float &z, Vector4::Float &w) {
  Vector4::Float row[4];
  for (int l = 0; l < 4; ++l) {
    load(row[l], &nodes[index[l]].x);
  }
  const Vector4::Float xy01 = __builtin_shufflevector(row[0], row[1], 0, 4, 1, 5);
  const Vector4::Float xy23 = __builtin_shufflevector(row[2], row[3], 0, 4, 1, 5);
  const Vector4::Float zw01 = __builtin_shufflevector(row[0], row[1], 2, 6, 3, 7);
  const Vector4::Float zw23 = __builtin_shufflevector(row[2], row[3], 2, 6, 3, 7);
  x = __builtin_shufflevector(xy01, xy23, 0, 1, 4, 5);
  y = __builtin_shufflevector(xy01, xy23, 2, 3, 6, 7);
  z = __builtin_shufflevector(zw01, zw23, 0, 1, 4, 5);
  w = __builtin_shufflevector(zw01, zw23, 2, 3, 6, 7);
}

BREGMA_INLINE void gather(const NodeVector *nodes, const int *index, Vector8::Float &x, Vector8::Float &y,
                          Vector8::Float &z, Vector8::Float &w) {
  Vector8::Float row[4]; // lane l next to lane l + 4
  for (int l = 0; l < 4; ++l) {
    Vector4::Float low;
    Vector4::Float high;
    load(low, &nodes[index[l]].x);
    load(high, &nodes[index[l + 4]].x);
    row[l] = __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
  }
  const Vector8::Float xy01 = __builtin_shufflevector(row[0], row[1], 0, 8, 1, 9, 4, 12, 5, 13);
  const Vector8::Float xy23 = __builtin_shufflevector(row[2], row[3], 0, 8, 1, 9, 4, 12, 5, 13);
  const Vector8::Float zw01 = __builtin_shufflevector(row[0], row[1], 2, 10, 3, 11, 6, 14, 7, 15);
  const Vector8::Float zw23 = __builtin_shufflevector(row[2], row[3], 2, 10, 3, 11, 6, 14, 7, 15);
  x = __builtin_shufflevector(xy01, xy23, 0, 1, 8, 9, 4, 5, 12, 13);
  y = __builtin_shufflevector(xy01, xy23, 2, 3, 10, 11, 6, 7, 14, 15);
  z = __builtin_shufflevector(zw01, zw23, 0, 1, 8, 9, 4, 5, 12, 13);
  w = __builtin_shufflevector(zw01, zw23, 2, 3, 10, 11, 6, 7, 14, 15);
}

BREGMA_INLINE void add_row(NodeVector &node, const Vector4::Float &row) {
  Vector4::Float sum;
  load(sum, &node.x);
  sum += row;
  store(&node.x, sum);
}

BREGMA_INLINE void scatter(NodeVector *nodes, const int *index, const Vector4::Float &x, const Vector4::Float &y,
                           const Vector4::Float &z) {
  const Vector4::Float zero{};
  const Vector4::Float xy01 = __builtin_shufflevector(x, y, 0, 4, 1, 5);
  const Vector4::Float xy23 = __builtin_shufflevector(x, y, 2, 6, 3, 7);
  const Vector4::Float z01 = __builtin_shufflevector(z, zero, 0, 4, 1, 5);
  const Vector4::Float z23 = __builtin_shufflevector(z, zero, 2, 6, 3, 7);
  add_row(nodes[index[0]], __builtin_shufflevector(xy01, z01, 0, 1, 4, 5));
  add_row(nodes[index[1]], __builtin_shufflevector(xy01, z01, 2, 3, 6, 7));
  add_row(nodes[index[2]], __builtin_shufflevector(xy23, z23, 0, 1, 4, 5));
  add_row(nodes[index[3]], __builtin_shufflevector(xy23, z23, 2, 3, 6, 7));
}

BREGMA_INLINE void scatter(NodeVector *nodes, const int *index, const Vector8::Float &x, const Vector8::Float &y,
                           const Vector8::Float &z) {
  const auto half =
      [](const Vector8::Float &v, Vector4::Float &low, Vector4::Float &high) __attribute__((always_inline)) {
    low = __builtin_shufflevector(v, v, 0, 1, 2, 3);
    high = __builtin_shufflevector(v, v, 4, 5, 6, 7);
  };
  Vector4::Float low[3];
  Vector4::Float high[3];
  half(x, low[0], high[0]);
  half(y, low[1], high[1]);
  half(z, low[2], high[2]);
  scatter(nodes, index, low[0], low[1], low[2]);
  scatter(nodes, index + 4, high[0], high[1], high[2]);
}

// ---- functions of floats ----

// The same bits as another type.
template <class To, class From> BREGMA_INLINE void as_bits(const From &from, To &to) {
  static_assert(sizeof(From) == sizeof(To));
  __builtin_memcpy(&to, &from, sizeof(To));
}

// x^(-1/3) for x >= 0.3: a third of the exponent, then three steps of Newton's (relative error below 3e-7).
template <class V> BREGMA_INLINE void inverse_cube_root(const typename V::Float &x, typename V::Float &y) {
  using Float = typename V::Float;
  using Int = typename V::Int;
  Int bits;
  as_bits(x, bits);
  const Float third = __builtin_convertvector(bits, Float) * (1.0F / 3.0F);
  as_bits(__builtin_convertvector(1419967116.0F - third, Int), y);
  for (int i = 0; i < 3; ++i) {
    y = y * ((4.0F / 3.0F) - (x * (1.0F / 3.0F)) * (y * y * y));
  }
}

// x^(1/2) for x >= 1e-30, through x^(-1/2) in the same way.
template <class V> BREGMA_INLINE void square_root(const typename V::Float &x, typename V::Float &y) {
  using Int = typename V::Int;
  Int bits;
  as_bits(x, bits);
  as_bits(0x5f375a86 - (bits >> 1), y);
  for (int i = 0; i < 3; ++i) {
    y = y * (1.5F - (x * 0.5F) * (y * y));
  }
  y *= x;
}

// log2(1 + x) for x > -1: exponent, and the series of atanh for a mantissa in sqrt(1/2) to sqrt(2) (relative error
// below 3e-7, near x = 0 too).
template <class V> BREGMA_INLINE void log2_of_one_plus(const typename V::Float &x, typename V::Float &out) {
  using Float = typename V::Float;
  using Int = typename V::Int;
  const Float least = Float{} + 1e-6F;
  const Float whole = 1.0F + x;
  Int bits;
  as_bits(whole < least ? least : whole, bits);
  const Int exponent = (bits - 0x3f3504f3) >> 23;
  Float mantissa;
  as_bits(bits - (exponent << 23), mantissa);
  const Float t = exponent == Int{} ? x / (2.0F + x) : (mantissa - 1.0F) / (mantissa + 1.0F);
  const Float t2 = t * t;
  Float p = t2 * 0.18181818F + 0.22222222F;
  p = p * t2 + 0.28571429F;
  p = p * t2 + 0.4F;
  p = p * t2 + 0.66666667F;
  p = p * t2 + 2.0F;
  out = __builtin_convertvector(exponent, Float) + t * p * 1.44269504F;
}

// 2^x - 1 for |x| < 120: 2^n 2^f with |f| <= 1/2 and 2^f - 1 by its Taylor polynomial of degree 6. n is read off the
// last bits of a sum with 1.5 2^23, as in registration/clouds/gauss_kernel.cpp.
template <class V> BREGMA_INLINE void exp2_less_one(const typename V::Float &x, typename V::Float &out) {
  using Float = typename V::Float;
  using Int = typename V::Int;
  const Float shifted = x + 12582912.0F;
  const Float n = shifted - 12582912.0F;
  const Float f = x - n;
  Float p = f * 1.5403530e-4F + 1.3333558e-3F;
  p = p * f + 9.6181291e-3F;
  p = p * f + 5.5504109e-2F;
  p = p * f + 0.24022651F;
  p = p * f + 0.69314718F;
  p *= f;
  Int mantissa;
  Int exponent;
  as_bits(p + 1.0F, mantissa);
  as_bits(shifted, exponent);
  Float power;
  as_bits(mantissa + (exponent << 23), power);
  out = n == Float{} ? p : power - 1.0F;
}

} // namespace bregma::tissue
