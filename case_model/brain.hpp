// The tissue model of a loaded case: tetrahedral mesh of the brain, craniotomy, material, and the model for a probe.
// The daemon and the command line use the same functions and get the same model, bit for bit. Safe from any thread.
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

inline constexpr double kCraniotomyRadius_mm = 15.0; // default if neither the case nor a configuration states one

struct BrainMeshOptions {
  tissue::LatticeMeshOptions lattice;
  // Maximum edge within 6 mm of a trajectory's entry through the craniotomy, where the tip presses; at least half of
  // the lattice's edge. 0: no refinement.
  double entry_edge_mm = 5.0;
};

// The mesh, and defaults for values that the case does not state.
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

// Blocks for about a second. Errors name the case's folder and the problem of the brain's surface or the options.
[[nodiscard]] base::Result<Brain> brain_of(const casefile::Case &c, const BrainSettings &settings);

// The model of that brain, which follows points_mm. Material, craniotomy and minimum step of the options are replaced
// by those of the brain. Errors name the case's folder.
[[nodiscard]] base::Result<std::unique_ptr<tissue::BrainModel>>
brain_model_of(const casefile::Case &c, const Brain &brain, std::span<const Eigen::Vector3d> points_mm,
               tissue::BrainModelOptions options = {});

// The single parts.

// The material of the case, or this default. Throws std::invalid_argument like casefile::material_of.
[[nodiscard]] tissue::Material material_of(const casefile::Case &c, const tissue::Material &otherwise);

// The craniotomy on the surface of the case's brain, `brain`. Without a table its centre is the first trajectory's
// entry into the brain. Without a trajectory, or with radius 0, there is none.
[[nodiscard]] tissue::Craniotomy craniotomy_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                               double otherwise_radius_mm);

// The tetrahedral mesh of the case's brain. Throws like tissue::fill_surface. Refined tetrahedra are in addition to the
// requested number; their nodes follow those of the lattice.
[[nodiscard]] tissue::LatticeMesh brain_mesh_of(const casefile::Case &c, const surface::SurfaceModel &brain,
                                                const tissue::Craniotomy &craniotomy, const BrainMeshOptions &options);

} // namespace bregma::case_model
