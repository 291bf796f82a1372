#include "algorithms/tissue_plane/plane_section.hpp"

#include <algorithm>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>

namespace bregma::tissue_plane {
namespace {

using Edge = std::uint64_t; // the surface's edge without direction: smaller vertex, larger vertex

Edge edge_of(int a, int b) {
  const auto [low, high] = std::minmax(a, b);
  return (static_cast<Edge>(low) << 32U) | static_cast<Edge>(high);
}

} // namespace

std::vector<Loop> section_of(const surface::TriangleMesh &surface, const SectionPlane &plane) {
  const Eigen::Vector3d normal = plane.u.cross(plane.v);
  std::vector<double> height(surface.vertices_mm.size());
  for (std::size_t i = 0; i < height.size(); ++i) {
    height[i] = normal.dot(surface.vertices_mm[i] - plane.origin_mm);
  }

  // Each cut triangle connects the edge that passes down through the plane to the one that passes up, with the inside
  // on the left. Neighbours traverse their edge in opposite directions, so an upward edge of one is downward in the
  // other.
  std::map<Edge, Edge> next; // ordered: the loops do not depend on a hash
  for (const Eigen::Vector3i &t : surface.triangles) {
    Edge down = 0;
    Edge up = 0;
    int crossings = 0;
    for (int k = 0; k < 3; ++k) {
      const int a = t[k];
      const int b = t[(k + 1) % 3];
      const bool a_above = height[static_cast<std::size_t>(a)] >= 0.0;
      const bool b_above = height[static_cast<std::size_t>(b)] >= 0.0;
      if (a_above != b_above) {
        (b_above ? up : down) = edge_of(a, b);
        ++crossings;
      }
    }
    if (crossings > 0 && !next.emplace(down, up).second) {
      throw std::invalid_argument("section_of: an edge of the surface has more than two triangles, or they disagree");
    }
  }

  const auto point_of = [&](Edge edge) -> Eigen::Vector2d {
    const auto a = static_cast<std::size_t>(edge >> 32U);
    const auto b = static_cast<std::size_t>(edge & 0xffffffffU);
    const double fraction = height[a] / (height[a] - height[b]);
    const Eigen::Vector3d p =
        surface.vertices_mm[a] + fraction * (surface.vertices_mm[b] - surface.vertices_mm[a]) - plane.origin_mm;
    return {plane.u.dot(p), plane.v.dot(p)};
  };
  std::vector<Loop> loops;
  while (!next.empty()) {
    const Edge first = next.begin()->first;
    Loop loop;
    for (Edge edge = first;;) {
      const auto step = next.find(edge);
      if (step == next.end()) {
        throw std::invalid_argument("section_of: the surface is open where the plane cuts it");
      }
      const Eigen::Vector2d p = point_of(edge);
      if (loop.empty() || p != loop.back()) {
        loop.push_back(p);
      }
      edge = step->second;
      next.erase(step);
      if (edge == first) {
        break;
      }
    }
    while (loop.size() > 1 && loop.back() == loop.front()) {
      loop.pop_back();
    }
    if (loop.size() > 2) { // a vertex that only touches the plane leaves a point
      loops.push_back(std::move(loop));
    }
  }
  return loops;
}

double area_mm2(const Loop &loop) {
  double twice = 0.0;
  for (std::size_t i = 0; i < loop.size(); ++i) {
    const Eigen::Vector2d &a = loop[i];
    const Eigen::Vector2d &b = loop[(i + 1) % loop.size()];
    twice += a.x() * b.y() - a.y() * b.x();
  }
  return 0.5 * twice;
}

double area_mm2(const Outline &outline) {
  double sum = area_mm2(outline.outer);
  for (const Loop &hole : outline.holes) {
    sum += area_mm2(hole);
  }
  return sum;
}

bool contains(const Loop &loop, const Eigen::Vector2d &point_mm) {
  bool inside = false;
  for (std::size_t i = 0, j = loop.size() - 1; i < loop.size(); j = i++) {
    const Eigen::Vector2d &a = loop[i];
    const Eigen::Vector2d &b = loop[j];
    if ((a.y() > point_mm.y()) != (b.y() > point_mm.y()) &&
        point_mm.x() < a.x() + (point_mm.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x())) {
      inside = !inside;
    }
  }
  return inside;
}

bool contains(const Outline &outline, const Eigen::Vector2d &point_mm) {
  return contains(outline.outer, point_mm) && std::none_of(outline.holes.begin(), outline.holes.end(),
                                                           [&](const Loop &hole) { return contains(hole, point_mm); });
}

Outline largest_outline(const std::vector<Loop> &loops) {
  Outline out;
  double largest = 0.0;
  for (const Loop &loop : loops) {
    if (const double area = area_mm2(loop); area > largest) {
      largest = area;
      out.outer = loop;
    }
  }
  if (out.outer.empty()) {
    throw std::invalid_argument("largest_outline: none of " + std::to_string(loops.size()) +
                                " loops is counter-clockwise");
  }
  for (const Loop &loop : loops) {
    if (area_mm2(loop) < 0.0 && contains(out.outer, loop.front())) {
      out.holes.push_back(loop);
    }
  }
  return out;
}

} // namespace bregma::tissue_plane
