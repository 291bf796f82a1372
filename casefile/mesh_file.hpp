// Surfaces of a case on disk: PLY, coordinates RAS in mm. Written binary little endian in single precision.
#pragma once

#include <filesystem>

#include "algorithms/surface/triangle_mesh.hpp"
#include "base/result.hpp"

namespace bregma::casefile {

// Finite vertices, indices in range, no triangle with a vertex twice.
[[nodiscard]] base::Result<surface::TriangleMesh> read_mesh(const std::filesystem::path &file);
[[nodiscard]] base::Result<void> write_mesh(const std::filesystem::path &file, const surface::TriangleMesh &mesh);

// Binary STL; its header states RAS as Slicer does. Single precision, without the vertices' numbers.
[[nodiscard]] base::Result<void> write_stl(const std::filesystem::path &file, const surface::TriangleMesh &mesh);

// Checks that the mesh is closed (every edge belongs to exactly two triangles, which run along it in opposite
// directions) and oriented outwards (positive volume). The message does not name the surface.
[[nodiscard]] base::Result<void> check_closed(const surface::TriangleMesh &mesh);

} // namespace bregma::casefile
