// A mesh from the flat lists of numbers of VTK's and GIFTI's files. Private to this library.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::casefile::detail {

// x, y, z of every vertex. Returns the error with the vertex and the value; empty if there is none.
[[nodiscard]] std::string append_vertices(surface::TriangleMesh &mesh, std::span<const double> coordinates);

// Triples of corners, each after `before` numbers that are skipped. The vertices must have been set.
[[nodiscard]] std::string append_triangles(surface::TriangleMesh &mesh, std::span<const double> corners,
                                           std::size_t before = 0);

// "must be a vertex, 0 to 41"
[[nodiscard]] std::string range_text(std::size_t vertices);

} // namespace bregma::casefile::detail
