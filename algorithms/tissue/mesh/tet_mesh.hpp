// Tetrahedral mesh of an organ, as the tissue rooms exchange it. Frame: that of the surface it was made from (usually
// Image), mm. The solver works in SI internally; meshes are in mm.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace bregma::tissue {

struct TetMesh {
  std::vector<Eigen::Vector3d> nodes_mm;
  std::vector<Eigen::Vector4i> tetrahedra; // nodes a, b, c, d with (b - a) x (c - a) . (d - a) > 0
};

// The mesh's own surface: triangles of nodes, counter-clockwise seen from outside, and the nodes on it, ascending.
struct TetBoundary {
  std::vector<Eigen::Vector3i> triangles;
  std::vector<int> tetrahedron; // the tetrahedron of each triangle
  std::vector<int> nodes;
};

[[nodiscard]] TetBoundary boundary_of(const TetMesh &mesh);

[[nodiscard]] double volume_mm3(const TetMesh &mesh);

// Mean over the edges of all tetrahedra; a shared edge counts once per tetrahedron.
[[nodiscard]] double mean_edge_mm(const TetMesh &mesh);

// Throws std::invalid_argument with the index and value of what is wrong: no tetrahedra, a node that is not finite, a
// tetrahedron with an invalid node index or without positive volume, a node without a tetrahedron.
void check(const TetMesh &mesh);

// A block of nx x ny x nz cubes of edge_mm, its corner at the origin, each cut into six tetrahedra around a diagonal
// (Kuhn); diagonals match across faces. For tests and benchmarks.
[[nodiscard]] TetMesh block_mesh(const Eigen::Vector3i &cells, const Eigen::Vector3d &size_mm);

} // namespace bregma::tissue
