// The section of a closed surface by a plane: the outline that the two-dimensional mesher fills with triangles.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::tissue_plane {

// A closed polygon in the plane's own axes, mm; the last point is joined to the first. A counter-clockwise loop has the
// material inside.
using Loop = std::vector<Eigen::Vector2d>;

struct SectionPlane {
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero(); // (0, 0) of the section; frame of the surface
  Eigen::Vector3d u = Eigen::Vector3d::UnitX();        // the section's x, orthonormal to v
  Eigen::Vector3d v = Eigen::Vector3d::UnitY();        // the section's y; seen from u x v, the axes are right-handed
};

struct Outline {
  Loop outer;                   // counter-clockwise
  std::vector<Loop> holes = {}; // clockwise, inside outer
};

// All closed curves of the section: counter-clockwise around the interior, clockwise around holes. A vertex in the
// plane counts as above it, so that no curve branches. Empty where the plane misses the surface. Throws
// std::invalid_argument when the surface is open at the plane.
[[nodiscard]] std::vector<Loop> section_of(const surface::TriangleMesh &surface, const SectionPlane &plane);

// The loop of largest area, with the holes inside it; all other loops are omitted. Throws std::invalid_argument when no
// loop is counter-clockwise.
[[nodiscard]] Outline largest_outline(const std::vector<Loop> &loops);

// Positive for a counter-clockwise loop.
[[nodiscard]] double area_mm2(const Loop &loop);
[[nodiscard]] double area_mm2(const Outline &outline);
// By the parity of crossings; for points on the curve itself either result is possible.
[[nodiscard]] bool contains(const Loop &loop, const Eigen::Vector2d &point_mm);
[[nodiscard]] bool contains(const Outline &outline, const Eigen::Vector2d &point_mm);

} // namespace bregma::tissue_plane
