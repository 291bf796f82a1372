// A triangle surface, as all rooms exchange it.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace bregma::surface {

struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices_mm;
  std::vector<Eigen::Vector3i> triangles; // indices of vertices, counter-clockwise seen from outside
};

} // namespace bregma::surface
