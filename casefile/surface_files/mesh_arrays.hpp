// A mesh from the flat lists of numbers of VTK's and GIFTI's files. Private to this library.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::casefile::detail {

// x, y, z of every vertex. Returns the error with the vertex and the value; empty if there is none.
[[nodiscard]] std::string append_vertices(surface::TriangleMesh &mesh, std::span<const double> coordinates);

// Triples of corners. The vertices must have been set.
[[nodiscard]] std::string append_triangles(surface::TriangleMesh &mesh, std::span<const double> corners);

// Cells of any number of corners: polygons, which become triangles around their first corner (exact for a flat convex
// one), or strips. ends: where each cell ends in `corners`; they must not decrease and end with the last corner.
enum class Cells { kPolygons, kStrips };
[[nodiscard]] std::string append_cells(surface::TriangleMesh &mesh, Cells kind, std::span<const double> corners,
                                       std::span<const double> ends);

// "must be a vertex, 0 to 41"
[[nodiscard]] std::string range_text(std::size_t vertices);

} // namespace bregma::casefile::detail
