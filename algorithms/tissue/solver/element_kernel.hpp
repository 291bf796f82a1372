// The inner loops of the explicit solver: eight tetrahedra at a time, in floats.
//
// Constant-strain tetrahedra whose pressure comes from the nodes: the volume change of a node is the mean of its
// tetrahedra's, its pressure kappa times that, and the pressure of a tetrahedron the mean of its four nodes' (average
// nodal pressure [Bonet 1998]). The forces are the gradient of an energy with one volume per node, so that nearly
// incompressible tissue does not lock and energy is conserved.
//
// There is one version per vector length; the widest that the processor supports is selected at run time. The input is
// displacements instead of positions: floats then resolve a strain of 1e-7. SI: m, Pa, N. Reentrant, no allocation.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "algorithms/tissue/material/material.hpp"

namespace bregma::tissue {

inline constexpr int kPack = 8; // tetrahedra

struct alignas(16) NodeVector {
  float x = 0.0F, y = 0.0F, z = 0.0F;
  float w = 0.0F; // in a displacement: the node's pressure (Pa), so that one load fetches both
};

// Tetrahedra that only pad a pack have no volume and no gradients, and refer to an existing node.
struct alignas(32) ElementPack {
  int node[4][kPack];
  float gradient[3][3][kPack]; // [i][d]: derivative along axis d of the shape function of node i + 1, at rest (1/m)
  float volume_m3[kPack];      // at rest
};

// Relaxation by one Prony term: the six components (xx yy zz yz xz xy) of the second Piola-Kirchhoff stress that has
// relaxed so far.
struct alignas(32) RelaxedPack {
  float stress_Pa[6][kPack];
};

struct PronyStep {    // coefficients of one term for one step
  float decay = 0.0F; // exp(-dt / tau)
  float gain = 0.0F;  // g (1 - decay)
};

inline constexpr std::size_t kMaxPronyTerms = 4;

struct ElementWork {
  std::span<const ElementPack> packs;
  const NodeVector *nodes = nullptr; // displacement (m), and the pressure that add_forces reads
  float shear_Pa = 0.0F;
  float bulk_Pa = 0.0F;
  float element_bulk_Pa =
      0.0F; // modulus of the pressure by the tetrahedron's own volume, in addition to the nodal pressure
  float ogden_alpha = 2.0F;

  float *volume_change_m3 = nullptr; // by node; add_volumes adds a quarter of each tetrahedron's
  NodeVector *force_N = nullptr;     // by node; add_forces adds the tetrahedra's forces

  RelaxedPack *relaxed = nullptr; // all terms of the first pack, then of the next; null: elastic
  std::span<const PronyStep> prony;
};

struct ElementSums {
  double elastic_J = 0.0; // energy of the shear part without relaxation, and of the tetrahedra's own pressures
  int inverted = 0;       // tetrahedra of less than kInvertedVolume of their volume at rest
};

// Below this relative volume the shear part is neo-Hookean in a form that restores the tetrahedron's orientation, and
// the tetrahedron has a pressure of its own in addition to the nodal one, which does the same.
inline constexpr float kInvertedVolume = 0.3F;

struct ElementKernel {
  std::string_view name;
  void (*add_volumes)(const ElementWork &work, Law law) = nullptr;
  ElementSums (*add_forces)(const ElementWork &work, Law law) = nullptr;
};

// Kernels that this processor can run, the fastest first; never empty.
[[nodiscard]] std::span<const ElementKernel> element_kernels() noexcept;

} // namespace bregma::tissue
