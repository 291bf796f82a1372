// A case for the stages: made by the session's stage, read by the others, freed when no stage holds it any more
// (case_store.hpp).
#pragma once

#include <cstdint>
#include <memory>

#include "algorithms/planning/critical_structures.hpp"
#include "algorithms/registration/registration.hpp"
#include "algorithms/surface/surface_model.hpp"
#include "casefile/case.hpp"
#include "server/inputs/payload_check.hpp"

namespace bregma::tissue {
class BrainModel;
}

namespace bregma::server {

class NodalFields;

struct LoadedCase {
  // Throws std::invalid_argument with the name of an unusable surface or tool.
  LoadedCase(std::shared_ptr<const casefile::Case> loaded, double correlation_length_mm, int max_surface_samples);
  ~LoadedCase();
  LoadedCase(const LoadedCase &) = delete;
  LoadedCase &operator=(const LoadedCase &) = delete;

  std::shared_ptr<const casefile::Case> data;
  surface::SurfaceModel scalp;
  planning::CriticalStructures structures;
  inputs::KnownTools tools;
  registration::RegistrationEstimator estimator; // used only by the registration stage
  // Made by the stage tissue model, then used only by the deformation stage.
  std::unique_ptr<tissue::BrainModel> tissue_model;
  std::unique_ptr<NodalFields> nodal_fields; // of the tissue model
};

// Gives a stage its current case. loaded is null if the case was closed. Generations increase.
struct CaseChanged {
  std::uint64_t generation;
  LoadedCase *loaded;
};

} // namespace bregma::server
