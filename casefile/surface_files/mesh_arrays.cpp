#include "casefile/surface_files/mesh_arrays.hpp"

#include <cmath>
#include <cstdio>

namespace bregma::casefile::detail {

std::string range_text(std::size_t vertices) {
  return vertices == 0 ? "the file has no vertices" : "must be a vertex, 0 to " + std::to_string(vertices - 1);
}

std::string append_vertices(surface::TriangleMesh &mesh, std::span<const double> coordinates) {
  for (std::size_t i = 0; i + 2 < coordinates.size(); i += 3) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!std::isfinite(coordinates[i + axis])) {
        return "vertex " + std::to_string(mesh.vertices_mm.size()) + ": " + static_cast<char>('x' + axis) + " = " +
               std::to_string(coordinates[i + axis]) + ": must be a finite number";
      }
    }
    mesh.vertices_mm.emplace_back(coordinates[i], coordinates[i + 1], coordinates[i + 2]);
  }
  return {};
}

std::string append_triangles(surface::TriangleMesh &mesh, std::span<const double> corners, std::size_t before) {
  const auto vertices = static_cast<double>(mesh.vertices_mm.size());
  for (std::size_t i = before; i + 2 < corners.size(); i += before + 3) {
    Eigen::Vector3i triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      const double value = corners[i + k];
      if (!(value >= 0.0 && value < vertices) || value != std::floor(value)) {
        char shown[32];
        std::snprintf(shown, sizeof shown, "%.10g", value);
        return "triangle " + std::to_string(mesh.triangles.size()) + ": corner = " + shown + ": " +
               range_text(mesh.vertices_mm.size());
      }
      triangle[static_cast<Eigen::Index>(k)] = static_cast<int>(value);
    }
    mesh.triangles.push_back(triangle);
  }
  return {};
}

} // namespace bregma::casefile::detail
