// What a case says about its brain as a deformable body, in the terms of the tissue model. Safe from any thread.
#pragma once

#include "algorithms/registration/surface_model.hpp"
#include "algorithms/tissue/material.hpp"
#include "algorithms/tissue/skull.hpp"
#include "casefile/case.hpp"

namespace bregma::casefile {

inline constexpr double kCraniotomyRadius_mm = 15.0; // where neither the case nor a configuration says another

// The named material with what the case changes in it; its source says so. Throws std::invalid_argument for a name that
// is not in the set, which a case that was loaded or checked does not have.
[[nodiscard]] tissue::Material material_of(const TissueChoice &choice);
[[nodiscard]] tissue::Material material_of(const Case &c, const tissue::Material &otherwise);

// On the surface of the case's brain, which `brain` is. Without a table the first trajectory's way into the brain is
// the centre; without a trajectory, or with the radius 0, there is none.
[[nodiscard]] tissue::Craniotomy craniotomy_of(const Case &c, const registration::SurfaceModel &brain,
                                               double otherwise_radius_mm);

} // namespace bregma::casefile
