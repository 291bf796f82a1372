// The entry of a planned path into an organ.
#pragma once

#include <optional>

#include <Eigen/Core>

#include "algorithms/surface/surface_model.hpp"

namespace bregma::planning {

// The first point on the straight line between two points that is not outside the closed surface, up to 1e-3 mm beyond
// it. If the start is inside, the start itself; no result if the line stays outside. Frame of the surface, mm.
// Thread-safe, does not allocate.
[[nodiscard]] std::optional<Eigen::Vector3d> surface_entry(const surface::SurfaceModel &surface,
                                                           const Eigen::Vector3d &from_mm,
                                                           const Eigen::Vector3d &to_mm) noexcept;

} // namespace bregma::planning
