// An image that is warped by a spline onto the grid of another, and the similarity of the two before and after.
#pragma once

#include <string>
#include <vector>

#include "algorithms/registration/splines/thin_plate_spline.hpp"
#include "base/result.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::cli {

struct ImageSimilarity {
  double rmse = 0.0;               // in units of the intensities
  double mutual_information = 0.0; // nats
};

struct WarpedImage {
  casefile::Volume image;        // on the target's grid; 0 outside the source image
  ImageSimilarity before, after; // over the voxels that the source covers before and after
  double grid_error_mm = 0.0;    // largest difference between the spline and the grid that approximates it
};

// to_source: from the target's frame into the source's (resampling direction). Blocks for seconds.
// notes: receives what the images do not state and was assumed.
[[nodiscard]] base::Result<WarpedImage> warp_image(const std::string &source_file, const std::string &target_file,
                                                   const registration::ThinPlateSpline<3> &to_source,
                                                   std::vector<std::string> &notes);

} // namespace bregma::cli
