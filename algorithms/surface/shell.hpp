// A watertight shell of a part of a surface, for printing.
#pragma once

#include <functional>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::surface {

// The triangles all of whose corners are wanted, and the same moved inwards along the vertices' normals by the
// thickness, joined by walls along the rim: every edge belongs to two triangles that run along it in opposite
// directions. Of several pieces only the largest is kept. Empty if no triangle is wanted. mm.
[[nodiscard]] TriangleMesh shell_of(const TriangleMesh &mesh,
                                    const std::function<bool(const Eigen::Vector3d &)> &wanted, double thickness_mm);

// The shell of a head's face: in front of the head's middle and below its top quarter. The scalp in RAS.
[[nodiscard]] TriangleMesh face_shell(const TriangleMesh &scalp, double thickness_mm);

} // namespace bregma::surface
