// Where a planned way goes into an organ.
#pragma once

#include <optional>

#include <Eigen/Core>

#include "algorithms/surface/surface_model.hpp"

namespace bregma::planning {

// The first point of the straight way from one point to another that is not outside the closed surface, to 1e-3 mm
// beyond it; the start itself where that lies inside, nothing where the way stays outside. Frame of the surface, mm.
// Thread-safe, does not allocate.
[[nodiscard]] std::optional<Eigen::Vector3d> surface_entry(const surface::SurfaceModel &surface,
                                                           const Eigen::Vector3d &from_mm,
                                                           const Eigen::Vector3d &to_mm) noexcept;

} // namespace bregma::planning
