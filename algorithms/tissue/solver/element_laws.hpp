// One tetrahedron per lane: its deformation, and the laws of its shear part. Private to element_kernel.cpp.
#pragma once

#include "algorithms/tissue/solver/lanes.hpp"

namespace bregma::tissue {

// ---- kinematics ----

template <class V> struct Element {
  typename V::Float h[3][3];  // displacement gradient: h[r][c] = d u_r / d X_c
  typename V::Float b[3][3];  // gradients of the shape functions of nodes 1 to 3
  typename V::Float pressure; // mean of the nodes'
};

template <class V>
BREGMA_INLINE void read(const ElementPack &pack, int lane, const NodeVector *displacement, Element<V> &element) {
  using Float = typename V::Float;
  Float base[3];
  gather(displacement, pack.node[0] + lane, base[0], base[1], base[2], element.pressure);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      element.h[r][c] = Float{};
      load(element.b[r][c], pack.gradient[r][c] + lane);
    }
  }
  for (int i = 0; i < 3; ++i) {
    Float u[3];
    Float pressure;
    gather(displacement, pack.node[i + 1] + lane, u[0], u[1], u[2], pressure);
    element.pressure += pressure;
    for (int r = 0; r < 3; ++r) {
      u[r] -= base[r];
      for (int c = 0; c < 3; ++c) {
        element.h[r][c] += u[r] * element.b[i][c];
      }
    }
  }
  element.pressure *= 0.25F;
}

// cofactors of m; the determinant is m's first row times theirs.
template <class Float> BREGMA_INLINE void cofactors(const Float (&m)[3][3], Float (&cof)[3][3]) {
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      const int r1 = (r + 1) % 3;
      const int r2 = (r + 2) % 3;
      const int c1 = (c + 1) % 3;
      const int c2 = (c + 2) % 3;
      cof[r][c] = m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1];
    }
  }
}

// J - 1, for Hooke's law the trace of the strain, without subtracting numbers near one.
template <class V, Law kLaw>
BREGMA_INLINE void volume_change(const typename V::Float (&h)[3][3], typename V::Float &change) {
  change = h[0][0] + h[1][1] + h[2][2];
  if constexpr (kLaw != Law::kLinear) {
    typename V::Float cof[3][3];
    cofactors(h, cof);
    change += cof[0][0] + cof[1][1] + cof[2][2];
    change += h[0][0] * cof[0][0] + h[0][1] * cof[0][1] + h[0][2] * cof[0][2];
  }
}

// ---- laws: the shear part ----

// A symmetric matrix by its six numbers.
template <class Float> struct Symmetric { Float xx, yy, zz, yz, xz, xy; };

template <class V> struct Deformation {
  typename V::Float f[3][3];
  typename V::Float cof[3][3];
  typename V::Float volume; // J, no smaller than kInvertedVolume
};

// 2 E = C - 1 = H + H^T + H^T H, which subtracts no numbers near one.
template <class Float> BREGMA_INLINE void twice_strain(const Float (&h)[3][3], Symmetric<Float> &e) {
  e.xx = 2.0F * h[0][0] + (h[0][0] * h[0][0] + h[1][0] * h[1][0] + h[2][0] * h[2][0]);
  e.yy = 2.0F * h[1][1] + (h[0][1] * h[0][1] + h[1][1] * h[1][1] + h[2][1] * h[2][1]);
  e.zz = 2.0F * h[2][2] + (h[0][2] * h[0][2] + h[1][2] * h[1][2] + h[2][2] * h[2][2]);
  e.yz = h[1][2] + h[2][1] + (h[0][1] * h[0][2] + h[1][1] * h[1][2] + h[2][1] * h[2][2]);
  e.xz = h[0][2] + h[2][0] + (h[0][0] * h[0][2] + h[1][0] * h[1][2] + h[2][0] * h[2][2]);
  e.xy = h[0][1] + h[1][0] + (h[0][0] * h[0][1] + h[1][0] * h[1][1] + h[2][0] * h[2][1]);
}

// Both laws give Mandel's stress M = C S, symmetric for an isotropic law: the first Piola-Kirchhoff stress is then
// cof(F) M / J, without an inverse.

// M = mu J^(-2/3) dev(2 E).
template <class V>
BREGMA_INLINE void neo_hookean(const Element<V> &element, const Deformation<V> &d, float shear,
                               Symmetric<typename V::Float> &m, typename V::Float &energy) {
  using Float = typename V::Float;
  twice_strain(element.h, m);
  Float isochoric;
  inverse_cube_root<V>(d.volume, isochoric);
  const Float r2 = isochoric * isochoric;
  const Float trace = m.xx + m.yy + m.zz;
  const Float a = r2 * shear;
  energy = (r2 * (trace + 3.0F) - 3.0F) * (0.5F * shear);
  m.xx = a * (m.xx - trace * (1.0F / 3.0F));
  m.yy = a * (m.yy - trace * (1.0F / 3.0F));
  m.zz = a * (m.zz - trace * (1.0F / 3.0F));
  m.yz *= a;
  m.xz *= a;
  m.xy *= a;
}

// One Jacobi rotation: makes the element (p, q) zero and rotates the columns of v. r is the third axis.
template <class V, class Float = typename V::Float>
BREGMA_INLINE void jacobi_rotation(Float &mpp, Float &mqq, Float &mpq, Float &mrp, Float &mrq, Float (&v)[3][3], int p,
                                   int q) {
  // tan(2 angle) = 2 mpq / (mqq - mpp); the smaller root, safe where mpq is 0.
  const Float zero{};
  const Float difference = mqq - mpp;
  const Float size = difference < zero ? -difference : difference;
  Float root;
  square_root<V>(difference * difference + 4.0F * mpq * mpq + 1e-30F, root);
  const Float signed_mpq = difference < zero ? -mpq : mpq;
  const Float t = 2.0F * signed_mpq / (size + root);
  Float c;
  square_root<V>(1.0F / (1.0F + t * t), c);
  const Float s = t * c;
  mpp -= t * mpq;
  mqq += t * mpq;
  mpq = zero;
  const Float rp = mrp;
  mrp = c * rp - s * mrq;
  mrq = s * rp + c * mrq;
  for (auto &row : v) {
    const Float vp = row[p];
    row[p] = c * vp - s * row[q];
    row[q] = s * vp + c * row[q];
  }
}

// M = sum_i beta_i N_i N_i with beta_i = 2 mu / alpha (lbar_i^alpha - mean of lbar^alpha), computed from 2 E and
// logarithms, so that small strains keep their precision.
template <class V>
BREGMA_INLINE void ogden(const Element<V> &element, float shear, float alpha, Symmetric<typename V::Float> &m,
                         typename V::Float &energy) {
  using Float = typename V::Float;
  const Float zero{};
  twice_strain(element.h, m);
  Float v[3][3] = {{zero + 1.0F, zero, zero}, {zero, zero + 1.0F, zero}, {zero, zero, zero + 1.0F}};
  for (int sweep = 0; sweep < 4; ++sweep) {
    jacobi_rotation<V>(m.xx, m.yy, m.xy, m.xz, m.yz, v, 0, 1);
    jacobi_rotation<V>(m.xx, m.zz, m.xz, m.xy, m.yz, v, 0, 2);
    jacobi_rotation<V>(m.yy, m.zz, m.yz, m.xy, m.xz, v, 1, 2);
  }
  Float stretch[3] = {m.xx, m.yy, m.zz}; // squared, less one; then log2 of the stretch; then lbar^alpha - 1
  Float mean = zero;
  for (auto &l : stretch) {
    log2_of_one_plus<V>(l, l);
    mean += l * (1.0F / 6.0F);
  }
  Float power_mean = zero;
  for (auto &l : stretch) {
    l = (0.5F * l - mean) * alpha;
    l = l > 100.0F ? zero + 100.0F : l;
    l = l < -100.0F ? zero - 100.0F : l;
    exp2_less_one<V>(l, l);
    power_mean += l * (1.0F / 3.0F);
  }
  energy = power_mean * (6.0F * shear / (alpha * alpha));
  m = {zero, zero, zero, zero, zero, zero};
  for (int i = 0; i < 3; ++i) {
    const Float beta = (stretch[i] - power_mean) * (2.0F * shear / alpha);
    m.xx += beta * v[0][i] * v[0][i];
    m.yy += beta * v[1][i] * v[1][i];
    m.zz += beta * v[2][i] * v[2][i];
    m.yz += beta * v[1][i] * v[2][i];
    m.xz += beta * v[0][i] * v[2][i];
    m.xy += beta * v[0][i] * v[1][i];
  }
}

// Hooke's law: 2 mu dev(small strain).
template <class V>
BREGMA_INLINE void linear(const Element<V> &element, float shear, Symmetric<typename V::Float> &s,
                          typename V::Float &energy) {
  using Float = typename V::Float;
  const auto &h = element.h;
  const Float third = (h[0][0] + h[1][1] + h[2][2]) * (1.0F / 3.0F);
  const float two = 2.0F * shear;
  s.xx = (h[0][0] - third) * two;
  s.yy = (h[1][1] - third) * two;
  s.zz = (h[2][2] - third) * two;
  s.yz = (h[1][2] + h[2][1]) * shear;
  s.xz = (h[0][2] + h[2][0]) * shear;
  s.xy = (h[0][1] + h[1][0]) * shear;
  energy =
      (s.xx * s.xx + s.yy * s.yy + s.zz * s.zz + 2.0F * (s.yz * s.yz + s.xz * s.xz + s.xy * s.xy)) * (0.25F / shear);
}

template <class V> BREGMA_INLINE bool any(const typename V::Int &mask) {
  int out = 0;
  for (int l = 0; l < V::kLanes; ++l) {
    out |= mask[l];
  }
  return out != 0;
}

// p = left * right.
template <class Float>
BREGMA_INLINE void multiply(const Float (&left)[3][3], const Symmetric<Float> &right, Float (&p)[3][3]) {
  for (int r = 0; r < 3; ++r) {
    p[r][0] = left[r][0] * right.xx + left[r][1] * right.xy + left[r][2] * right.xz;
    p[r][1] = left[r][0] * right.xy + left[r][1] * right.yy + left[r][2] * right.yz;
    p[r][2] = left[r][0] * right.xz + left[r][1] * right.yz + left[r][2] * right.zz;
  }
}

// S = C^-1 M: the two have the same principal axes, so the product is symmetric. C^-1 = cof^T cof / J^2.
template <class V> BREGMA_INLINE void pull_back(const Deformation<V> &d, Symmetric<typename V::Float> &m) {
  using Float = typename V::Float;
  const auto &q = d.cof;
  const Float k = 1.0F / (d.volume * d.volume);
  const Float xx = k * (q[0][0] * q[0][0] + q[1][0] * q[1][0] + q[2][0] * q[2][0]);
  const Float yy = k * (q[0][1] * q[0][1] + q[1][1] * q[1][1] + q[2][1] * q[2][1]);
  const Float zz = k * (q[0][2] * q[0][2] + q[1][2] * q[1][2] + q[2][2] * q[2][2]);
  const Float yz = k * (q[0][1] * q[0][2] + q[1][1] * q[1][2] + q[2][1] * q[2][2]);
  const Float xz = k * (q[0][0] * q[0][2] + q[1][0] * q[1][2] + q[2][0] * q[2][2]);
  const Float xy = k * (q[0][0] * q[0][1] + q[1][0] * q[1][1] + q[2][0] * q[2][1]);
  m = {xx * m.xx + xy * m.xy + xz * m.xz, xy * m.xy + yy * m.yy + yz * m.yz, xz * m.xz + yz * m.yz + zz * m.zz,
       xy * m.xz + yy * m.yz + yz * m.zz, xx * m.xz + xy * m.yz + xz * m.zz, xx * m.xy + xy * m.yy + xz * m.yz};
}

// Tetrahedra that are nearly flat or inverted, for every law: the neo-Hookean energy mu / 2 (g(J) tr C - 3) + pressure,
// where g continues along the tangent of J^(-2/3) below J0 = kInvertedVolume. This energy decreases from any inverted
// shape to an upright one. A law of C alone would take a mirrored tetrahedron for one at rest.
template <class V>
BREGMA_INLINE void straighten(const Element<V> &e, const Deformation<V> &d, const typename V::Float &j,
                              const typename V::Int &inverted, float shear, typename V::Float (&p)[3][3],
                              typename V::Float &energy) {
  using Float = typename V::Float;
  Symmetric<Float> m;
  Float upright;
  neo_hookean<V>(e, d, shear, m, upright);
  const Float zero{};
  const Float below = zero + 1.0F - j * (1.0F / kInvertedVolume);
  Float isochoric;
  inverse_cube_root<V>(d.volume, isochoric);
  const Float a = isochoric * isochoric * shear;
  Float trace = zero;
  for (const auto &row : d.f) {
    trace += row[0] * row[0] + row[1] * row[1] + row[2] * row[2];
  }
  // cof(F) M / J0 would be the gradient if J were J0; the rest of it is along F.
  const Float per_volume = zero + 1.0F / kInvertedVolume;
  Float q[3][3];
  multiply(d.cof, m, q);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      const Float turned = q[r][c] * per_volume + (5.0F / 3.0F) * below * a * d.f[r][c] + e.pressure * d.cof[r][c];
      p[r][c] = inverted != 0 ? turned : p[r][c];
    }
  }
  energy = inverted != 0 ? upright + (1.0F / 3.0F) * below * a * trace : energy;
}

} // namespace bregma::tissue
