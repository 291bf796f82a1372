// A case as the stages use it: made by the session's stage, read by the others, freed when no stage holds it any more
// (case_store.hpp).
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "algorithms/planning/critical_structures.hpp"
#include "algorithms/registration/registration.hpp"
#include "algorithms/surface/surface_model.hpp"
#include "casefile/case.hpp"
#include "server/inputs/payload_check.hpp"

namespace bregma::tissue {
class BrainModel;
}

namespace bregma::server {

struct LoadedCase {
  // Throws std::invalid_argument that names the surface or tool that cannot be used.
  LoadedCase(std::shared_ptr<const casefile::Case> loaded, double correlation_length_mm, int max_surface_samples);
  ~LoadedCase();
  LoadedCase(const LoadedCase &) = delete;
  LoadedCase &operator=(const LoadedCase &) = delete;

  std::shared_ptr<const casefile::Case> data;
  surface::SurfaceModel scalp;
  planning::CriticalStructures structures;
  inputs::KnownTools tools;
  registration::RegistrationEstimator estimator; // the registration stage's alone
  // Made by the stage tissue model, then the deformation stage's alone.
  std::unique_ptr<tissue::BrainModel> tissue_model;
  std::vector<float> field_mm; // x, y, z per node of the model, for the topic DeformationField
};

// Tells a stage which case to use from now on; loaded is null when the case was closed. Generations count up.
struct CaseChanged {
  std::uint64_t generation;
  LoadedCase *loaded;
};

} // namespace bregma::server
