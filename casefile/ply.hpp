// PLY [Turk 1994]: elements vertex (x, y, z), face (a list of vertices; a polygon becomes triangles) and tristrips,
// ASCII or binary of either byte order; other elements and properties are skipped. Private to this library.
//
// VTK's reader (9.1) reads past the end of a truncated file. The daemon reads these files, and a damaged one must be an
// error and not a crash; hence this reader.
#pragma once

#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::casefile::detail {

// The mesh, or the error in the file. It may have no triangles: a cloud. Indices are not compared with the number of
// vertices.
[[nodiscard]] tl::expected<surface::TriangleMesh, std::string> parse_ply(std::string_view content);

[[nodiscard]] std::string to_ply(const surface::TriangleMesh &mesh); // binary little endian, single precision

} // namespace bregma::casefile::detail
