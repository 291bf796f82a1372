// Control points of a phantom of separate markers: bright balls or capsules in dark surroundings, in CT or MR.
//
// Local maxima of the smoothed image above its noise; the centre of each is the centroid of what rises above the
// background around it, in a window that follows the centre. A maximum that is not a marker (a couch, a wall, a bar) is
// bright beyond a marker's size as well. Which marker is which of another image: point_matching.hpp.
//
// Units: mm, in the frame of the image. Pure functions, any thread; seconds for 10^7 voxels.
#pragma once

#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "algorithms/geometry/points.hpp"
#include "algorithms/image/grid.hpp"

namespace bregma::mri {

struct MarkerOptions {
  double marker_mm = 10.0; // diameter of a marker as the image shows it; markers stand at least twice as far apart
  double min_height = 8.0; // of a marker in the smoothed image, in standard deviations of its noise
  int min_points = 12;     // fewer are no phantom
};

struct MarkerPoints {
  geometry::Points3 points_mm;
  geometry::Points3 not_separate_mm; // bright beyond a marker's size
  geometry::Points3 crowded_mm;      // as bright as a marker, and nearer to it than its diameter
  geometry::Points3 cut_off_mm;      // at the image's border: the centre is not known
};

// Otherwise a sentence: options out of range, an image without voxels or not finite, or fewer than min_points.
[[nodiscard]] tl::expected<MarkerPoints, std::string> find_marker_points(const image::Image<float, 3> &image,
                                                                         const MarkerOptions &options = {});

} // namespace bregma::mri
