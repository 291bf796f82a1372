// A mesh out of flat lists of numbers, as VTK's and GIFTI's files hold it. Private to this library.
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::casefile::detail {

// x, y, z of every vertex. What is wrong, with the vertex and the value; empty where nothing is.
[[nodiscard]] std::string append_vertices(surface::TriangleMesh &mesh, std::span<const double> coordinates);

// Triples of corners, each after `before` numbers that are left out. The vertices must be there.
[[nodiscard]] std::string append_triangles(surface::TriangleMesh &mesh, std::span<const double> corners,
                                           std::size_t before = 0);

// "must be a vertex, 0 to 41"
[[nodiscard]] std::string range_text(std::size_t vertices);

} // namespace bregma::casefile::detail
