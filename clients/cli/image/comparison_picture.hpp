// Pictures of images: slices through a point, as grey values or as a checkerboard of two images.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/intensity/features.hpp"
#include "base/result.hpp"

namespace bregma::cli {

// The file of a picture ends in .png; empty: none is wanted. To be asked before the work.
[[nodiscard]] base::Result<void> check_picture(const std::string &option, const std::string &path);

// PNG: axial, coronal and sagittal slices side by side, to scale, right of the patient on the right. With `other` (on
// the same grid) squares alternate between both, so that edges continue across them where the images agree.
[[nodiscard]] base::Result<void> write_slices_picture(const std::string &path, const intensity::Volume &image,
                                                      const std::vector<float> *other,
                                                      const Eigen::Vector3d &through_mm);

} // namespace bregma::cli
