// Closed surfaces for tests of meshers, and the brain of Colin27 if it is available.
#pragma once

#include <optional>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::test {

[[nodiscard]] surface::TriangleMesh make_torus(double ring_mm, double tube_mm, int around_ring, int around_tube);
[[nodiscard]] surface::TriangleMesh make_box(const Eigen::Vector3d &low_mm, const Eigen::Vector3d &high_mm);

[[nodiscard]] double enclosed_mm3(const surface::TriangleMesh &surface);

// From ../shared/data next to the source tree; empty if that does not exist.
[[nodiscard]] std::optional<surface::TriangleMesh> colin27_brain();

} // namespace bregma::test
