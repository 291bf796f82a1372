// A closed surface filled with tetrahedra: isosurface stuffing on a body-centred cubic lattice (Labelle & Shewchuk,
// "Isosurface Stuffing: Fast Tetrahedral Meshes with Good Dihedral Angles", SIGGRAPH 2007), and then smoothing for the
// time step of an explicit solver.
//
// What comes out: positive, conforming tetrahedra in one piece; a boundary that is a closed 2-manifold, all of whose
// nodes lie on the surface; inside, the lattice's own tetrahedra, all alike. The surface's creases and what is finer
// than the lattice are rounded off. Frame and unit of the surface, mm. Deterministic: the same surface and options give
// the same mesh, bit for bit. Blocks for about half a second at 20,000 tetrahedra; safe from any thread.
#pragma once

#include <optional>

#include "algorithms/surface/triangle_mesh.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

inline constexpr int kMinTetrahedra = 500;
inline constexpr int kMaxTetrahedra = 500'000;

struct LatticeMeshOptions {
  std::optional<double> edge_mm; // the lattice's long edge, a; the short ones are sqrt(3)/2 a. Where it is not given:
  int tetrahedra = 20'000;       // about as many (to 2 % where the surface is smooth at that scale)
  int smoothing_sweeps = 12;     // at most; 0 leaves the mesh as it was stuffed
};

struct LatticeMesh {
  TetMesh mesh;
  double edge_mm = 0.0;                  // of the lattice
  double surface_mm3 = 0.0;              // that the surface encloses; the mesh's own volume is a little less
  double stuffed_stable_length_mm = 0.0; // before smoothing (mesh_quality.hpp); smoothing never lowers it
  double lattice_stable_length_mm = 0.0; // after it
};

// Throws std::invalid_argument that says what is wrong: a surface that is not closed, is inside out or that
// SurfaceModel refuses; an edge that is not positive, needs more than kMaxTetrahedra, or is too long for the surface,
// so that what is left is empty, in several pieces or pinched; a number of tetrahedra out of range.
[[nodiscard]] LatticeMesh fill_surface(const surface::TriangleMesh &surface, const LatticeMeshOptions &options = {});

} // namespace bregma::tissue
