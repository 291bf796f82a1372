// Whether a label image belongs to an image, and its names to its labels.
#pragma once

#include <string>
#include <vector>

#include "casefile/volumes/label_names.hpp"
#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

// Sentences on what is doubtful about the labels of an image, to be continued from "the labels": another grid, labels
// outside of the image, and regions on the other side than their names say, as in an image that is mirrored.
[[nodiscard]] std::vector<std::string> label_doubts(const LabelVolume &labels, const LabelNames &names,
                                                    const Volume &image);

// Both have the same voxels in the same places, to a tenth of a voxel.
template <class A, class B> [[nodiscard]] bool same_grid(const image::Image<A, 3> &a, const image::Image<B, 3> &b) {
  if (a.size != b.size) {
    return false;
  }
  const Eigen::Matrix4d difference = a.T_image_index - b.T_image_index;
  const Eigen::Vector4d last(a.size[0] - 1, a.size[1] - 1, a.size[2] - 1, 1.0); // farthest from the first voxel
  const double limit = 0.1 * a.spacing_mm().minCoeff();
  return difference.col(3).norm() < limit && (difference.cwiseAbs() * last).norm() < 2.0 * limit;
}

} // namespace bregma::casefile
