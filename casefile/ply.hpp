// PLY as case files use it (Turk, "The PLY polygon file format", 1994): elements vertex (x, y, z) and face (a list of
// vertices), ASCII or binary little endian; other elements and properties are passed over. Private to this library.
//
// Read here and not with VTK, whose reader (9.1) walks past the end of a file that was cut short; the daemon reads
// these files, and a damaged one must be an error and not a crash.
#pragma once

#include <string>
#include <string_view>

#include <tl/expected.hpp>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::casefile::detail {

// The mesh, or what is wrong with the file. Indices are not checked against the vertices.
[[nodiscard]] tl::expected<surface::TriangleMesh, std::string> parse_ply(std::string_view content);

[[nodiscard]] std::string to_ply(const surface::TriangleMesh &mesh); // binary little endian, single precision

} // namespace bregma::casefile::detail
