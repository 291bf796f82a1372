#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <stdexcept>
#include <string>

#include "algorithms/tissue_plane/plane_mesher.hpp"

namespace bregma::tissue_plane {
namespace {

double twice_area(const Eigen::Vector2d &a, const Eigen::Vector2d &b, const Eigen::Vector2d &c) {
  return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
}

const Eigen::Vector2d &node_of(const PlaneMesh &mesh, const Eigen::Vector3i &t, int corner) {
  return mesh.nodes_mm[static_cast<std::size_t>(t[corner % 3])];
}

double twice_area(const PlaneMesh &mesh, const Eigen::Vector3i &t) {
  return twice_area(node_of(mesh, t, 0), node_of(mesh, t, 1), node_of(mesh, t, 2));
}

} // namespace

PlaneMesh rectangle_mesh(const Eigen::Vector2i &cells, const Eigen::Vector2d &size_mm) {
  PlaneMesh out;
  for (int j = 0; j <= cells.y(); ++j) {
    for (int i = 0; i <= cells.x(); ++i) {
      out.nodes_mm.emplace_back(size_mm.x() * i / cells.x(), size_mm.y() * j / cells.y());
    }
  }
  for (int j = 0; j < cells.y(); ++j) {
    for (int i = 0; i < cells.x(); ++i) {
      const int a = j * (cells.x() + 1) + i;
      const int b = a + 1;
      const int d = a + cells.x() + 1;
      const int c = d + 1;
      if ((i + j) % 2 == 0) {
        out.triangles.emplace_back(a, b, c);
        out.triangles.emplace_back(a, c, d);
      } else {
        out.triangles.emplace_back(a, b, d);
        out.triangles.emplace_back(b, c, d);
      }
    }
  }
  return out;
}

std::vector<Eigen::Vector2i> boundary_of(const PlaneMesh &mesh) {
  std::map<std::pair<int, int>, int> seen; // edge as its triangle runs along it
  for (const Eigen::Vector3i &t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) {
      ++seen[{t[k], t[(k + 1) % 3]}];
    }
  }
  std::vector<Eigen::Vector2i> out;
  for (const auto &[edge, count] : seen) {
    if (seen.find({edge.second, edge.first}) == seen.end()) {
      out.emplace_back(edge.first, edge.second);
    }
  }
  return out;
}

void check(const PlaneMesh &mesh) {
  if (mesh.triangles.empty()) {
    throw std::invalid_argument("mesh without triangles");
  }
  for (std::size_t i = 0; i < mesh.nodes_mm.size(); ++i) {
    if (!mesh.nodes_mm[i].allFinite()) {
      throw std::invalid_argument("node " + std::to_string(i) + " is not finite");
    }
  }
  std::vector<bool> used(mesh.nodes_mm.size(), false);
  for (std::size_t e = 0; e < mesh.triangles.size(); ++e) {
    for (const int node : mesh.triangles[e]) {
      if (node < 0 || node >= static_cast<int>(mesh.nodes_mm.size())) {
        throw std::invalid_argument("triangle " + std::to_string(e) + " names node " + std::to_string(node) + " of " +
                                    std::to_string(mesh.nodes_mm.size()));
      }
      used[static_cast<std::size_t>(node)] = true;
    }
    const double area = 0.5 * twice_area(mesh, mesh.triangles[e]);
    if (!(area > 0.0)) {
      throw std::invalid_argument("triangle " + std::to_string(e) + " has an area of " + std::to_string(area) +
                                  " mm^2, must be positive");
    }
  }
  if (const auto it = std::find(used.begin(), used.end(), false); it != used.end()) {
    throw std::invalid_argument("node " + std::to_string(it - used.begin()) + " belongs to no triangle");
  }
}

double area_mm2(const PlaneMesh &mesh) {
  double sum = 0.0;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    sum += 0.5 * twice_area(mesh, t);
  }
  return sum;
}

PlaneQuality quality_of(const PlaneMesh &mesh) {
  constexpr double kDegrees = 180.0 / std::numbers::pi;
  PlaneQuality out;
  out.min_angle_deg = 180.0;
  out.smallest_height_mm = INFINITY;
  out.shortest_edge_mm = INFINITY;
  for (const Eigen::Vector3i &t : mesh.triangles) {
    const double area2 = twice_area(mesh, t);
    double smallest = 180.0;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector2d to_next = node_of(mesh, t, k + 1) - node_of(mesh, t, k);
      const Eigen::Vector2d to_last = node_of(mesh, t, k + 2) - node_of(mesh, t, k);
      const double angle = kDegrees * std::atan2(area2, to_next.dot(to_last));
      const double edge = to_next.norm();
      smallest = std::min(smallest, angle);
      out.max_angle_deg = std::max(out.max_angle_deg, angle);
      out.shortest_edge_mm = std::min(out.shortest_edge_mm, edge);
      out.longest_edge_mm = std::max(out.longest_edge_mm, edge);
      out.smallest_height_mm = std::min(out.smallest_height_mm, area2 / edge);
    }
    out.min_angle_deg = std::min(out.min_angle_deg, smallest);
    out.mean_min_angle_deg += smallest / static_cast<double>(mesh.triangles.size());
  }
  return out;
}

double stable_step_s(const PlaneQuality &quality, const tissue::Material &material) {
  return 1e-3 * quality.smallest_height_mm / std::sqrt(material.wave_modulus_Pa() / material.density_kg_m3);
}

} // namespace bregma::tissue_plane
