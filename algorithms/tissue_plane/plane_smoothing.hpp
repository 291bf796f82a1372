// The mesher's last step: smoothing that improves the triangles.
#pragma once

#include <optional>

#include "algorithms/tissue_plane/plane_mesh.hpp"
#include "algorithms/tissue_plane/plane_section.hpp"

namespace bregma::tissue_plane {

// Interior nodes move to the area-weighted centroid of their triangles. Boundary nodes move along the outline to the
// middle of their neighbours, and nodes on y = cut_y_mm stay on that line. A move that degrades the worst triangle
// around a node is halved, and omitted when that does not help. The worst quality around a node therefore never
// decreases.
void smooth(PlaneMesh &mesh, const Outline &outline, const std::optional<double> &cut_y_mm, int sweeps);

} // namespace bregma::tissue_plane
