// What a loaded case becomes for the tissue models: its brain in tetrahedra, the opening of its skull, its material,
// and the model that a probe moves. The daemon and the command line use this one recipe and get the same model, bit for
// bit. Safe from any thread.
#pragma once

#include <memory>
#include <span>

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/brain_model.hpp"
#include "algorithms/tissue/contact/skull.hpp"
#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue/mesh/lattice_mesh.hpp"
#include "base/result.hpp"
#include "casefile/case.hpp"

namespace bregma::case_model {

inline constexpr double kCraniotomyRadius_mm = 15.0; // where neither the case nor a configuration says another

struct BrainMeshOptions {
  tissue::LatticeMeshOptions lattice;
  // Within 6 mm of where a trajectory enters the brain through the craniotomy edges are no longer than this, or than
  // half of the lattice's if that is more: there the tip presses. 0: the lattice as it is.
  double entry_edge_mm = 5.0;
};

// The mesh, and what a configuration says where the case does not.
struct BrainSettings {
  BrainMeshOptions mesh;
  tissue::Material material = tissue::named_materials().front();
  double craniotomy_radius_mm = kCraniotomyRadius_mm;
};

struct Brain {
  tissue::LatticeMesh filled;
  tissue::Craniotomy craniotomy;
  tissue::Material material;
};

// Blocks for about a second. Errors name the case's folder and what is wrong with the brain's surface or the options.
[[nodiscard]] base::Result<Brain> brain_of(const casefile::Case &c, const BrainSettings &settings);

// The model of that brain which follows points_mm. Material, craniotomy and smallest step of the options are replaced
// by the brain's. Errors name the case's folder.
[[nodiscard]] base::Result<std::unique_ptr<tissue::BrainModel>>
brain_model_of(const casefile::Case &c, const Brain &brain, std::span<const Eigen::Vector3d> points_mm,
               tissue::BrainModelOptions options = {});

// The parts of the recipe.

// The material that the case names, or else this one. Throws std::invalid_argument as casefile::material_of.
[[nodiscard]] tissue::Material material_of(const casefile::Case &c, const tissue::Material &otherwise);

// On the surface of the case's brain, which `brain` is. Without a table the centre is where the first trajectory enters
// the brain; without a trajectory, or with the radius 0, there is none.
[[nodiscard]] tissue::Craniotomy craniotomy_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                               double otherwise_radius_mm);

// The case's brain in tetrahedra. Throws as tissue::fill_surface. Refined tetrahedra are added to those that the
// lattice was asked for, their nodes behind the lattice's.
[[nodiscard]] tissue::LatticeMesh brain_mesh_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                                const tissue::Craniotomy &craniotomy, const BrainMeshOptions &options);

} // namespace bregma::case_model
