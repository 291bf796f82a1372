// The mesher's last step: nodes move to where their triangles are best.
#pragma once

#include <optional>

#include "algorithms/tissue_plane/plane_mesh.hpp"
#include "algorithms/tissue_plane/plane_section.hpp"

namespace bregma::tissue_plane {

// Nodes within go to the area-weighted centroid of their triangles, nodes on the boundary along the outline to the
// middle of their neighbours, nodes on y = cut_y_mm stay on it. A move that makes the worst triangle around a node
// worse is halved, and given up when that does not help: no triangle's quality falls below what it was around that
// node.
void smooth(PlaneMesh &mesh, const Outline &outline, const std::optional<double> &cut_y_mm, int sweeps);

} // namespace bregma::tissue_plane
