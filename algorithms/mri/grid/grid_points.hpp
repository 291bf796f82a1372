// Control points of a grid phantom: crossings of its bars, in CT (bright bars) or MR (dark bars in water).
//
// Slice by slice, as in [Tuna 2022, section III-B, figure 3]: adaptive threshold, closing, dilation, skeleton, branch
// points, their dilation and centroids. Slices that show one plane of bars are a group; their points are averaged with
// the paper's weights: a slice's number of points (over that of all intersections, which cancels). What the paper mends
// by hand follows:
//
// - sub-voxel: across each bar that leaves the crossing, at some distance from it, the centroid of its profile; the
//   median over the bars gives each coordinate. The bars are followed as their crossings bend them. A bubble or a
//   broken bar spoils one bar of several. A crossing one of whose coordinates no bar shows is left out and listed.
// - the lattice: points closer than half a cell are one point; where a neighbour is missing it is looked for in the
//   image; points without neighbours at the lattice's steps are left out and listed. point_matching.hpp finds what is
//   left.
//
// Units: mm, in the frame of the image. Pure functions, any thread; seconds for 10^7 voxels.
#pragma once

#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "algorithms/geometry/points.hpp"
#include "algorithms/image/grid.hpp"

namespace bregma::mri {

struct GridOptions {
  double cell_mm = 15.0; // distance of neighbouring bars, roughly: crossings show it, and are searched with it again
  double bar_mm = 2.0;   // width of a bar
  bool bright = false;   // the bars are brighter than what surrounds them (CT)
  int axis = -1;         // of the image, along which its slices follow; -1: each is tried
  int min_points = 27;   // fewer are no phantom
};

struct GridPoints {
  geometry::Points3 points_mm;
  double cell_mm = 0.0;          // distance of neighbouring crossings, as found
  std::vector<double> bars;      // share of the bars at each point that agreed, 0 to 1
  int axis = 2;                  // slices followed along it
  int planes = 0;                // groups of slices
  int merged = 0;                // points that were doubled
  int completed = 0;             // points that only the lattice showed: corners, crossings of broken bars
  geometry::Points3 chain_mm;    // what the paper's chain alone finds: without sub-voxel search and lattice
  geometry::Points3 left_out_mm; // without neighbours in the lattice, or without bars
};

// Otherwise a sentence: options out of range, an image that is smaller than two cells, has voxels larger than half a
// cell or is not finite, or fewer than min_points (the image shows no such grid).
[[nodiscard]] tl::expected<GridPoints, std::string> find_grid_points(const image::Image<float, 3> &image,
                                                                     const GridOptions &options = {});

} // namespace bregma::mri
