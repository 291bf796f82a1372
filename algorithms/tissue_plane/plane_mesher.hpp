// Fills an outline with triangles: a lattice of equilateral triangles, warped and cut to the outline, then smoothed.
// This is the two-dimensional case of isosurface stuffing [Labelle 2007]: every outline gets a valid mesh; details and
// corners finer than an edge are rounded.
#pragma once

#include <optional>

#include "algorithms/tissue/material/material.hpp"
#include "algorithms/tissue_plane/plane_mesh.hpp"
#include "algorithms/tissue_plane/plane_section.hpp"

namespace bregma::tissue_plane {

struct PlaneMeshing {
  double edge_mm = 0.0;   // edge of the lattice; 0: chosen for the number of `triangles`
  int triangles = 20'000; // reached within a few per cent
  // Edges run along the line y = cut_y_mm from one side of the outline to the other, so that it can be cut open there.
  std::optional<double> cut_y_mm = std::nullopt;
  int smoothing_sweeps = 12;
};

// The largest piece that is connected by edges; every node belongs to one fan of triangles. Throws
// std::invalid_argument with the value that is wrong: an outline of fewer than three points, not finite or not
// counter-clockwise, a negative edge, fewer than ten triangles, or an edge that is too long for any triangle.
[[nodiscard]] PlaneMesh fill(const Outline &outline, const PlaneMeshing &meshing = {});

// A rectangle with a corner at the origin: cells x cells squares, each cut along a diagonal, with alternating
// diagonals. For tests and benchmarks.
[[nodiscard]] PlaneMesh rectangle_mesh(const Eigen::Vector2i &cells, const Eigen::Vector2d &size_mm);

// Edges that belong to one triangle only, with the mesh on their left, in no particular order.
[[nodiscard]] std::vector<Eigen::Vector2i> boundary_of(const PlaneMesh &mesh);

// Throws std::invalid_argument with the index and value of what is wrong: no triangles, a node that is not finite, a
// triangle with an invalid node index or without positive area, a node without a triangle.
void check(const PlaneMesh &mesh);

[[nodiscard]] double area_mm2(const PlaneMesh &mesh);

struct PlaneQuality {
  double min_angle_deg = 0.0;
  double max_angle_deg = 0.0;
  double mean_min_angle_deg = 0.0; // mean over all triangles of the smallest angle
  double smallest_height_mm = 0.0; // over all triangles
  double shortest_edge_mm = 0.0;
  double longest_edge_mm = 0.0;
};
[[nodiscard]] PlaneQuality quality_of(const PlaneMesh &mesh);

// The stable step of an explicit scheme with the material's own density: the smallest height over the speed of pressure
// waves.
[[nodiscard]] double stable_step_s(const PlaneQuality &quality, const tissue::Material &material);

} // namespace bregma::tissue_plane
