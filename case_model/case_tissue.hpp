// What a case says about its brain as a deformable body, in the terms of the tissue model. Safe from any thread.
#pragma once

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/contact/skull.hpp"
#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue/mesh/lattice_mesh.hpp"
#include "casefile/case.hpp"

namespace bregma::case_model {

inline constexpr double kCraniotomyRadius_mm = 15.0; // where neither the case nor a configuration says another

// The material that the case names, or else this one.
[[nodiscard]] tissue::Material material_of(const casefile::Case &c, const tissue::Material &otherwise);

// On the surface of the case's brain, which `brain` is. Without a table the first trajectory's way into the brain is
// the centre; without a trajectory, or with the radius 0, there is none.
[[nodiscard]] tissue::Craniotomy craniotomy_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                               double otherwise_radius_mm);

struct BrainMeshOptions {
  tissue::LatticeMeshOptions lattice;
  // Within 6 mm of where a trajectory enters the brain through the craniotomy edges are no longer than this, or than
  // half of the lattice's if that is more: there the tip presses. 0: the lattice as it is.
  double entry_edge_mm = 5.0;
};

// The case's brain in tetrahedra. As tissue::fill_surface, whose errors are its own; refined ones are added to those
// that the lattice was asked for, their nodes behind the lattice's.
[[nodiscard]] tissue::LatticeMesh brain_mesh_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                                const tissue::Craniotomy &craniotomy, const BrainMeshOptions &options);

// The step below which the model of such a mesh makes tetrahedra heavier: what was refined then costs no more steps
// than the lattice, by a few grams of mass at the entry.
[[nodiscard]] double least_step_s(const tissue::LatticeMesh &mesh, const tissue::Material &material);

} // namespace bregma::case_model
