// Meshes of the tissue solver's verification problems. mm.
#pragma once

#include <vector>

#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::test {

// A block whose inner nodes are moved at random by up to `share` of a cell's edge (below 0.2: no inverted element).
[[nodiscard]] tissue::TetMesh jittered_block(const Eigen::Vector3i &cells, const Eigen::Vector3d &size_mm, double share,
                                             unsigned seed);

// The octant x, y, z >= 0 of a hollow sphere about the origin: three blocks, each over a third of the octant, with
// layers * along * along cells, thinner inside.
[[nodiscard]] tissue::TetMesh sphere_octant(double inner_mm, double outer_mm, int layers, int along);

// Nodes with this coordinate along the axis.
[[nodiscard]] std::vector<int> nodes_at(const tissue::TetMesh &mesh, int axis, double mm);
// Nodes at this distance from the origin.
[[nodiscard]] std::vector<int> nodes_at_radius(const tissue::TetMesh &mesh, double mm);

} // namespace bregma::test
