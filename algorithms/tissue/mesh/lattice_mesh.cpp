#include "algorithms/tissue/mesh/lattice_mesh.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <utility>

#include <Eigen/Geometry>

#include "algorithms/tissue/mesh/lattice_stuffing.hpp"
#include "algorithms/tissue/mesh/mesh_quality.hpp"
#include "algorithms/tissue/mesh/mesh_smoothing.hpp"
#include "algorithms/tissue/mesh/mesh_topology.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;
using surface::SurfaceModel;

// Number of tetrahedra per cube of the lattice, a^3.
constexpr double kTetrahedraPerCube = 12.0;
// Search for a number of tetrahedra: tolerance, and number of lattices after which the best is taken.
constexpr double kCountTolerance = 0.02;
constexpr int kSearchSteps = 5;
// A long, thin or hollow surface may contain few tetrahedra in a large box.
constexpr double kMaxLatticePoints = 2e7;

std::string text(const char *format, double value) {
  std::array<char, 64> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, value);
  return buffer.data();
}

double enclosed_mm3(const surface::TriangleMesh &surface) {
  double sum = 0.0;
  for (const Eigen::Vector3i &t : surface.triangles) {
    const auto vertex = [&](int i) -> const Vector3d & { return surface.vertices_mm[static_cast<std::size_t>(t[i])]; };
    sum += vertex(0).dot(vertex(1).cross(vertex(2))) / 6.0;
  }
  return sum;
}

void check_size(const SurfaceModel &surface, double volume_mm3, double edge_mm) {
  const double count = kTetrahedraPerCube * volume_mm3 / (edge_mm * edge_mm * edge_mm);
  if (count > kMaxTetrahedra) {
    throw std::invalid_argument("edge length " + text("%g mm", edge_mm) + ": gives about " + text("%.0f", count) +
                                " tetrahedra, at most " + std::to_string(kMaxTetrahedra) + " are made");
  }
  if (const double points = lattice_points(surface, edge_mm); points > kMaxLatticePoints) {
    throw std::invalid_argument("edge length " + text("%g mm", edge_mm) + ": needs a lattice of " +
                                text("%.2g", points) + " points around the surface, at most " +
                                text("%.0e", kMaxLatticePoints) + " are allowed");
  }
}

// Where a cleft or a bridge is as thin as the lattice, two parts may touch at a single node, depending on the lattice's
// position. Then another position is tried.
TetMesh stuff_soundly(const SurfaceModel &surface, double edge_mm) {
  std::string problem;
  for (const double shift : {0.0, 0.25, 0.5, 0.125, 0.375}) {
    TetMesh mesh = stuff(surface, edge_mm, shift * Vector3d(1.0, 0.8, 0.6));
    problem = topology_problem(mesh);
    if (problem.empty()) {
      return mesh;
    }
  }
  const Vector3d size = surface.high_mm() - surface.low_mm();
  throw std::invalid_argument("edge length " + text("%g mm", edge_mm) + ": is too long for this surface of " +
                              text("%.1f", size.x()) + " x " + text("%.1f", size.y()) + " x " +
                              text("%.1f mm", size.z()) + ": " + problem);
}

// The number of tetrahedra is proportional to the inverse cube of the edge, except at the boundary.
std::pair<TetMesh, double> search(const SurfaceModel &surface, double volume_mm3, int wanted) {
  std::pair<TetMesh, double> best;
  double best_error = 2.0;
  double edge_mm = std::cbrt(kTetrahedraPerCube * volume_mm3 / wanted);
  for (int step = 0; step < kSearchSteps && best_error > kCountTolerance; ++step) {
    check_size(surface, 0.0, edge_mm);
    TetMesh mesh = stuff_soundly(surface, edge_mm);
    const double ratio = static_cast<double>(mesh.tetrahedra.size()) / wanted;
    if (const double error = std::abs(ratio - 1.0); error < best_error) {
      best_error = error;
      best = {std::move(mesh), edge_mm};
    }
    edge_mm *= std::cbrt(ratio);
  }
  return best;
}

} // namespace

LatticeMesh fill_surface(const surface::TriangleMesh &surface, const LatticeMeshOptions &options) {
  const SurfaceModel model(surface);
  if (!model.is_closed()) {
    throw std::invalid_argument("the surface is not closed: it has no inside to fill");
  }
  const double volume = enclosed_mm3(surface);
  if (!(volume > 0.0)) {
    throw std::invalid_argument("the surface is oriented inwards: it encloses " + text("%g mm^3", volume));
  }
  LatticeMesh out;
  out.surface_mm3 = volume;
  if (options.edge_mm) {
    if (!(*options.edge_mm > 0.0) || !std::isfinite(*options.edge_mm)) {
      throw std::invalid_argument("edge length " + text("%g mm", *options.edge_mm) + ": must be positive");
    }
    check_size(model, volume, *options.edge_mm);
    out.mesh = stuff_soundly(model, *options.edge_mm);
    out.edge_mm = *options.edge_mm;
  } else {
    if (options.tetrahedra < kMinTetrahedra || options.tetrahedra > kMaxTetrahedra) {
      throw std::invalid_argument(std::to_string(options.tetrahedra) + " tetrahedra: must be between " +
                                  std::to_string(kMinTetrahedra) + " and " + std::to_string(kMaxTetrahedra));
    }
    std::tie(out.mesh, out.edge_mm) = search(model, volume, options.tetrahedra);
  }
  out.stuffed_stable_length_mm = stable_length_mm(out.mesh);
  smooth(out.mesh, model, out.edge_mm, options.smoothing_sweeps);
  out.lattice_stable_length_mm = stable_length_mm(out.mesh);
  return out;
}

} // namespace bregma::tissue
