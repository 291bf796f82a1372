#include "tests/unit/tissue/shapes.hpp"

#include <cmath>
#include <filesystem>
#include <numbers>
#include <stdexcept>

#include <Eigen/Geometry>

#include "casefile/surface_files/surface_file.hpp"

namespace bregma::test {

using Eigen::Vector3d;
using surface::TriangleMesh;

TriangleMesh make_torus(double ring_mm, double tube_mm, int around_ring, int around_tube) {
  TriangleMesh mesh;
  const auto at = [&](int i, int j) { return (i % around_ring) * around_tube + j % around_tube; };
  for (int i = 0; i < around_ring; ++i) {
    const double u = 2.0 * std::numbers::pi * i / around_ring;
    for (int j = 0; j < around_tube; ++j) {
      const double v = 2.0 * std::numbers::pi * j / around_tube;
      const double radius = ring_mm + tube_mm * std::cos(v);
      mesh.vertices_mm.emplace_back(radius * std::cos(u), radius * std::sin(u), tube_mm * std::sin(v));
      mesh.triangles.emplace_back(at(i, j), at(i + 1, j), at(i + 1, j + 1));
      mesh.triangles.emplace_back(at(i, j), at(i + 1, j + 1), at(i, j + 1));
    }
  }
  return mesh;
}

TriangleMesh make_box(const Vector3d &low_mm, const Vector3d &high_mm) {
  TriangleMesh mesh;
  for (unsigned i = 0; i < 8; ++i) {
    mesh.vertices_mm.emplace_back((i & 1U) != 0 ? high_mm.x() : low_mm.x(), (i & 2U) != 0 ? high_mm.y() : low_mm.y(),
                                  (i & 4U) != 0 ? high_mm.z() : low_mm.z());
  }
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

double enclosed_mm3(const TriangleMesh &surface) {
  double sum = 0.0;
  for (const Eigen::Vector3i &t : surface.triangles) {
    const auto vertex = [&](int i) { return surface.vertices_mm[static_cast<std::size_t>(t[i])]; };
    sum += vertex(0).dot(vertex(1).cross(vertex(2))) / 6.0;
  }
  return sum;
}

std::optional<TriangleMesh> colin27_brain() {
  const std::filesystem::path file =
      std::filesystem::path(BREGMA_SOURCE_DIR) / "../shared/data/meshes/colin27/colin27_brain_surface.asc";
  if (!std::filesystem::exists(file)) {
    return std::nullopt;
  }
  auto read = casefile::read_surface(file);
  if (!read) {
    throw std::runtime_error(read.error().message);
  }
  return std::move(read->mesh);
}

} // namespace bregma::test
