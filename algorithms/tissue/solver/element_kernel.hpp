// The inner loops of the explicit solver: eight tetrahedra at a time, in floats.
//
// Constant-strain tetrahedra whose pressure comes from the nodes: the volume change of a node is the mean of its
// tetrahedra's, its pressure kappa times that, and the pressure of a tetrahedron the mean of its four nodes' (average
// nodal pressure: Bonet & Burton, Commun Numer Methods Eng 14 (1998) 437). This is the gradient of an energy with one
// volume per node, so that nearly incompressible tissue does not lock and energy is conserved.
//
// One version for each vector length; the widest that the processor has is chosen at run time. Displacements enter, not
// positions: floats then resolve a strain of 1e-7. SI: m, Pa, N. Reentrant, no allocation.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "algorithms/tissue/material/material.hpp"

namespace bregma::tissue {

inline constexpr int kPack = 8; // tetrahedra

struct alignas(16) NodeVector {
  float x = 0.0F, y = 0.0F, z = 0.0F;
  float w = 0.0F; // of a displacement: the node's pressure (Pa), so that one load brings both
};

// Tetrahedra that only fill a pack up have no volume and no gradients, and name a node that is there.
struct alignas(32) ElementPack {
  int node[4][kPack];
  float gradient[3][3][kPack]; // [i][d]: derivative along axis d of the shape function of node i + 1, at rest (1/m)
  float volume_m3[kPack];      // at rest
};

// Relaxation of one Prony term: the six components (xx yy zz yz xz xy) of the second Piola-Kirchhoff stress that it has
// taken away so far.
struct alignas(32) RelaxedPack {
  float stress_Pa[6][kPack];
};

struct PronyStep {    // of one term, for one step
  float decay = 0.0F; // exp(-dt / tau)
  float gain = 0.0F;  // share (1 - decay)
};

inline constexpr std::size_t kMaxPronyTerms = 4;

struct ElementWork {
  std::span<const ElementPack> packs;
  const NodeVector *nodes = nullptr; // displacement (m), and the pressure that add_forces reads
  float shear_Pa = 0.0F;
  float bulk_Pa = 0.0F;
  float element_bulk_Pa = 0.0F; // of a pressure that a tetrahedron has by its own volume, beside its nodes'
  float ogden_alpha = 2.0F;

  float *volume_change_m3 = nullptr; // by node; add_volumes adds a quarter of each tetrahedron's
  NodeVector *force_N = nullptr;     // by node; add_forces adds what the tetrahedra pull

  RelaxedPack *relaxed = nullptr; // terms a pack, beginning with the first pack's; null: elastic
  std::span<const PronyStep> prony;
};

struct ElementSums {
  double elastic_J = 0.0; // of the shear part, as if nothing had relaxed, and of the tetrahedra's own pressures
  int inverted = 0;       // tetrahedra of less than kInvertedVolume of their volume at rest
};

// Below it a tetrahedron's shear part is neo-Hookean, made so that it turns the tetrahedron right again, and it gets a
// pressure of its own beside its nodes', which does so too.
inline constexpr float kInvertedVolume = 0.3F;

struct ElementKernel {
  std::string_view name;
  void (*add_volumes)(const ElementWork &work, Law law) = nullptr;
  ElementSums (*add_forces)(const ElementWork &work, Law law) = nullptr;
};

// What this processor can run, the fastest first; never empty.
[[nodiscard]] std::span<const ElementKernel> element_kernels() noexcept;

} // namespace bregma::tissue
