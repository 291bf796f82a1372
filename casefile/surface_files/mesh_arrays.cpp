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

std::string append_triangles(surface::TriangleMesh &mesh, std::span<const double> corners) {
  const auto vertices = static_cast<double>(mesh.vertices_mm.size());
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
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

std::string append_cells(surface::TriangleMesh &mesh, Cells kind, std::span<const double> corners,
                         std::span<const double> ends) {
  std::size_t begin = 0;
  for (std::size_t cell = 0; cell < ends.size(); ++cell) {
    const std::string name = (kind == Cells::kPolygons ? "polygon " : "strip ") + std::to_string(cell);
    const double least = static_cast<double>(begin) + 3.0;
    if (!(ends[cell] >= least && ends[cell] <= static_cast<double>(corners.size())) ||
        ends[cell] != std::floor(ends[cell])) {
      char shown[32];
      (void)std::snprintf(shown, sizeof shown, "%.10g", ends[cell]);
      return name + " ends at corner " + shown + ": must be from " + std::to_string(begin + 3) + " to " +
             std::to_string(corners.size());
    }
    const auto end = static_cast<std::size_t>(ends[cell]);
    for (std::size_t i = begin + 2; i < end; ++i) {
      const bool turned = kind == Cells::kStrips && (i - begin) % 2 != 0;
      const std::size_t first = kind == Cells::kStrips ? i - 2 : begin;
      const double triangle[] = {corners[first], corners[turned ? i : i - 1], corners[turned ? i - 1 : i]};
      if (auto problem = append_triangles(mesh, triangle); !problem.empty()) {
        return problem;
      }
    }
    begin = end;
  }
  return begin == corners.size() ? "" : std::to_string(corners.size() - begin) + " corners belong to no cell";
}

} // namespace bregma::casefile::detail
