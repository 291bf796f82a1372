#include "algorithms/planning/surface_entry.hpp"

#include <algorithm>

namespace bregma::planning {

std::optional<Eigen::Vector3d> surface_entry(const surface::SurfaceModel &surface, const Eigen::Vector3d &from_mm,
                                             const Eigen::Vector3d &to_mm) noexcept {
  // The distance to the nearest point is a step that cannot miss the surface (sphere tracing [Hart 1996]). Steps below
  // this minimum would only approach it.
  constexpr double kMinLength_mm = 1e-3;
  const Eigen::Vector3d way = to_mm - from_mm;
  const double length = way.norm();
  surface::SurfacePoint nearest = surface.closest(from_mm);
  for (double gone = 0.0;;) {
    const Eigen::Vector3d at = gone < length ? Eigen::Vector3d(from_mm + gone / length * way) : to_mm;
    nearest = surface.closest(at, nearest.triangle);
    if (nearest.signed_mm <= 0.0) {
      return at;
    }
    if (gone >= length) {
      return std::nullopt;
    }
    gone += std::max(nearest.distance_mm, kMinLength_mm);
  }
}

} // namespace bregma::planning
