// A case as the loops use it: built on the control thread, read by the loops, freed when no loop holds it any more.
#pragma once

#include <cstdint>
#include <memory>

#include "algorithms/planning/critical_structures.hpp"
#include "algorithms/registration/registration.hpp"
#include "algorithms/surface/surface_model.hpp"
#include "casefile/case.hpp"
#include "server/inputs/payload_check.hpp"

namespace bregma::server {

struct LoadedCase {
  // Throws std::invalid_argument that names the surface or tool that cannot be used.
  LoadedCase(std::shared_ptr<const casefile::Case> loaded, double correlation_length_mm, int max_surface_samples);

  std::shared_ptr<const casefile::Case> data;
  surface::SurfaceModel scalp;
  planning::CriticalStructures structures;
  inputs::KnownTools tools;
  registration::RegistrationEstimator estimator; // the registration loop's alone
};

// Tells a loop which case to use from now on; loaded is null when the case was closed. Generations count up, and a loop
// answers with the one it has taken, so that the control thread knows what can be freed.
struct CaseChanged {
  std::uint64_t generation;
  LoadedCase *loaded;
};

} // namespace bregma::server
