#include "algorithms/tissue/solver/element_kernel.hpp"

#include <array>

#include "algorithms/tissue/solver/element_laws.hpp"

namespace bregma::tissue {
namespace {

// ---- the two passes ----

template <class V, Law kLaw> BREGMA_INLINE void add_volumes(const ElementWork &work) {
  using Float = typename V::Float;
  for (const ElementPack &pack : work.packs) {
    for (int lane = 0; lane < kPack; lane += V::kLanes) {
      Element<V> e;
      read<V>(pack, lane, work.nodes, e);
      Float change;
      volume_change<V, kLaw>(e.h, change);
      Float quarter;
      load(quarter, pack.volume_m3 + lane);
      quarter *= change * 0.25F;
      for (int l = 0; l < V::kLanes; ++l) {
        for (const auto &corner : pack.node) {
          work.volume_change_m3[corner[lane + l]] += quarter[l];
        }
      }
    }
  }
}

template <class V>
BREGMA_INLINE void relax(const ElementWork &work, RelaxedPack *relaxed, int lane, Symmetric<typename V::Float> &s) {
  using Float = typename V::Float;
  Float *const components[6] = {&s.xx, &s.yy, &s.zz, &s.yz, &s.xz, &s.xy};
  for (int i = 0; i < 6; ++i) {
    Float &stress = *components[i];
    const Float instantaneous = stress;
    for (std::size_t k = 0; k < work.prony.size(); ++k) {
      Float taken;
      load(taken, relaxed[k].stress_Pa[i] + lane);
      taken = taken * work.prony[k].decay + instantaneous * work.prony[k].gain;
      store(relaxed[k].stress_Pa[i] + lane, taken);
      stress -= taken;
    }
  }
}

// First Piola-Kirchhoff stress and energy per volume without that of the pressure; 1 for each lane whose tetrahedron is
// nearly flat or inverted.
template <class V, Law kLaw>
BREGMA_INLINE void stress(const ElementWork &work, RelaxedPack *relaxed, int lane, Element<V> &e,
                          typename V::Float (&p)[3][3], typename V::Float &energy, typename V::Float &inverted) {
  using Float = typename V::Float;
  const Float zero{};
  inverted = zero;
  Symmetric<Float> s;
  if constexpr (kLaw == Law::kLinear) {
    linear<V>(e, work.shear_Pa, s, energy);
    if (relaxed != nullptr) {
      relax<V>(work, relaxed, lane, s);
    }
    p[0][0] = s.xx + e.pressure;
    p[1][1] = s.yy + e.pressure;
    p[2][2] = s.zz + e.pressure;
    p[0][1] = p[1][0] = s.xy;
    p[0][2] = p[2][0] = s.xz;
    p[1][2] = p[2][1] = s.yz;
  } else {
    Deformation<V> d;
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        d.f[r][c] = e.h[r][c] + (r == c ? 1.0F : 0.0F);
      }
    }
    cofactors(d.f, d.cof);
    const Float j = d.f[0][0] * d.cof[0][0] + d.f[0][1] * d.cof[0][1] + d.f[0][2] * d.cof[0][2];
    const Float least = zero + kInvertedVolume;
    const typename V::Int inverted_here = j < least;
    d.volume = j < least ? least : j;
    e.pressure += work.bulk_Pa * (j - d.volume);
    if constexpr (kLaw == Law::kNeoHookean) {
      neo_hookean<V>(e, d, work.shear_Pa, s, energy);
    } else {
      ogden<V>(e, work.shear_Pa, work.ogden_alpha, s, energy);
    }
    if (relaxed != nullptr) {
      pull_back<V>(d, s);
      relax<V>(work, relaxed, lane, s);
      multiply(d.f, s, p);
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) {
          p[r][c] += e.pressure * d.cof[r][c];
        }
      }
    } else {
      const Float per_volume = 1.0F / d.volume;
      s = {s.xx * per_volume + e.pressure,
           s.yy * per_volume + e.pressure,
           s.zz * per_volume + e.pressure,
           s.yz * per_volume,
           s.xz * per_volume,
           s.xy * per_volume};
      multiply(d.cof, s, p);
    }
    if (any<V>(inverted_here)) {
      straighten<V>(e, d, j, inverted_here, work.shear_Pa, p, energy);
      inverted = inverted_here != 0 ? zero + 1.0F : zero;
    }
  }
}

template <class V, class Float = typename V::Float>
BREGMA_INLINE void push_nodes(const ElementWork &work, const ElementPack &pack, int lane, const Float (&b)[3][3],
                              const Float (&p)[3][3], const Float &volume) {
  Float base[3] = {Float{}, Float{}, Float{}}; // the forces of a tetrahedron sum to zero
  for (int i = 0; i < 3; ++i) {
    Float force[3];
    for (int r = 0; r < 3; ++r) {
      force[r] = -volume * (p[r][0] * b[i][0] + p[r][1] * b[i][1] + p[r][2] * b[i][2]);
      base[r] -= force[r];
    }
    scatter(work.force_N, pack.node[i + 1] + lane, force[0], force[1], force[2]);
  }
  scatter(work.force_N, pack.node[0] + lane, base[0], base[1], base[2]);
}

template <class V, Law kLaw> BREGMA_INLINE ElementSums add_forces(const ElementWork &work) {
  using Float = typename V::Float;
  double elastic = 0.0;
  int inverted = 0;
  RelaxedPack *relaxed = work.relaxed;
  for (const ElementPack &pack : work.packs) {
    Float energy_sum{};
    Float inverted_sum{};
    for (int lane = 0; lane < kPack; lane += V::kLanes) {
      Element<V> e;
      read<V>(pack, lane, work.nodes, e);
      Float own_change{};
      if (work.element_bulk_Pa != 0.0F) {
        volume_change<V, kLaw>(e.h, own_change);
        e.pressure += work.element_bulk_Pa * own_change;
      }
      Float p[3][3];
      Float energy;
      Float inverted_here;
      stress<V, kLaw>(work, relaxed, lane, e, p, energy, inverted_here);
      Float volume;
      load(volume, pack.volume_m3 + lane);
      energy_sum += (energy + (0.5F * work.element_bulk_Pa) * own_change * own_change) * volume;
      inverted_sum += inverted_here;
      push_nodes<V>(work, pack, lane, e.b, p, volume);
    }
    float pack_energy = 0.0F;
    float pack_inverted = 0.0F;
    for (int l = 0; l < V::kLanes; ++l) {
      pack_energy += energy_sum[l];
      pack_inverted += inverted_sum[l];
    }
    elastic += static_cast<double>(pack_energy);
    inverted += static_cast<int>(pack_inverted);
    if (relaxed != nullptr) {
      relaxed += work.prony.size();
    }
  }
  return {elastic, inverted};
}

template <class V> BREGMA_INLINE void add_volumes_of(const ElementWork &work, Law law) {
  if (law == Law::kLinear) {
    add_volumes<V, Law::kLinear>(work);
  } else {
    add_volumes<V, Law::kNeoHookean>(work); // the same for all laws but Hooke's
  }
}

template <class V> BREGMA_INLINE ElementSums add_forces_of(const ElementWork &work, Law law) {
  switch (law) {
  case Law::kLinear:
    return add_forces<V, Law::kLinear>(work);
  case Law::kOgden:
    return add_forces<V, Law::kOgden>(work);
  case Law::kNeoHookean:
    break;
  }
  return add_forces<V, Law::kNeoHookean>(work);
}

void add_volumes_4(const ElementWork &work, Law law) { add_volumes_of<Vector4>(work, law); }
ElementSums add_forces_4(const ElementWork &work, Law law) { return add_forces_of<Vector4>(work, law); }

#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) void add_volumes_8(const ElementWork &work, Law law) {
  add_volumes_of<Vector8>(work, law);
}
__attribute__((target("avx2,fma"))) ElementSums add_forces_8(const ElementWork &work, Law law) {
  return add_forces_of<Vector8>(work, law);
}
#endif

} // namespace

std::span<const ElementKernel> element_kernels() noexcept {
#if defined(__x86_64__)
  static constexpr std::array kKernels{ElementKernel{"AVX2", add_volumes_8, add_forces_8},
                                       ElementKernel{"four floats", add_volumes_4, add_forces_4}};
  return std::span(kKernels).subspan(simd::has_avx2() ? 0U : 1U);
#else
  static constexpr std::array kKernels{ElementKernel{"four floats", add_volumes_4, add_forces_4}};
  return kKernels;
#endif
}

} // namespace bregma::tissue
