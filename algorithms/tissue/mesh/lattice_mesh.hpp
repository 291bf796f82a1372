// A closed surface filled with tetrahedra: isosurface stuffing on a body-centred cubic lattice [Labelle 2007], and then
// smoothing for the time step of an explicit solver.
//
// The result has positive, conforming tetrahedra in one piece. Its boundary is a closed 2-manifold, all of whose nodes
// lie on the surface. Inside are the lattice's own identical tetrahedra. Creases of the surface, and details finer than
// the lattice, are rounded off. Frame and unit of the surface, mm. Deterministic: the same surface and options give
// the same mesh, bit for bit. Blocks for about half a second at 20,000 tetrahedra; safe from any thread.
#pragma once

#include <optional>

#include "algorithms/surface/triangle_mesh.hpp"
#include "algorithms/tissue/mesh/tet_mesh.hpp"

namespace bregma::tissue {

inline constexpr int kMinTetrahedra = 500;
inline constexpr int kMaxTetrahedra = 500'000;

struct LatticeMeshOptions {
  std::optional<double> edge_mm; // the lattice's long edge, a; the short edges are sqrt(3)/2 a. Default: by
  int tetrahedra = 20'000;       // approximate number (within 2 % where the surface is smooth at that scale)
  int smoothing_sweeps = 12;     // maximum; 0: no smoothing
};

struct LatticeMesh {
  TetMesh mesh;
  double edge_mm = 0.0;                  // long edge of the lattice
  double surface_mm3 = 0.0;              // volume inside the surface; the mesh's own volume is slightly smaller
  double stuffed_stable_length_mm = 0.0; // before smoothing (mesh_quality.hpp); smoothing never decreases it
  double lattice_stable_length_mm = 0.0; // after it
};

// Throws std::invalid_argument with the reason: a surface that is not closed, is oriented inwards, or that SurfaceModel
// refuses; an edge that is not positive, needs more than kMaxTetrahedra, or is too long for the surface, so that the
// mesh would be empty, in several pieces or pinched; a number of tetrahedra out of range.
[[nodiscard]] LatticeMesh fill_surface(const surface::TriangleMesh &surface, const LatticeMeshOptions &options = {});

} // namespace bregma::tissue
