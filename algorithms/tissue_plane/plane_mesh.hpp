// Triangle mesh of a plane section, the input of the two-dimensional tissue solver: mm, in the plane's own axes.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace bregma::tissue_plane {

struct PlaneMesh {
  std::vector<Eigen::Vector2d> nodes_mm;
  std::vector<Eigen::Vector3i> triangles; // counter-clockwise
};

} // namespace bregma::tissue_plane
