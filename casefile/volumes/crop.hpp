// The part of a label image that has something in it.
#pragma once

#include <limits>

#include "casefile/volumes/volume.hpp"

namespace bregma::casefile {

// The bounding box of the voxels that `wanted` selects, at their place in Image; no voxels if it selects none.
template <class Wanted> [[nodiscard]] LabelVolume cropped(const LabelVolume &volume, const Wanted &wanted) {
  Eigen::Array3i first = Eigen::Array3i::Constant(std::numeric_limits<int>::max());
  Eigen::Array3i last = Eigen::Array3i::Constant(-1);
  for (int k = 0; k < volume.size[2]; ++k) {
    for (int j = 0; j < volume.size[1]; ++j) {
      for (int i = 0; i < volume.size[0]; ++i) {
        if (wanted(volume.at(i, j, k))) {
          first = first.min(Eigen::Array3i(i, j, k));
          last = last.max(Eigen::Array3i(i, j, k));
        }
      }
    }
  }
  if (last[0] < 0) {
    return {};
  }
  const Eigen::Array3i size = last - first + 1;
  LabelVolume part{{{size[0], size[1], size[2]}, volume.T_image_index}, {}};
  part.T_image_index.topRightCorner<3, 1>() = volume.point_mm(first.cast<double>());
  for (int k = first[2]; k <= last[2]; ++k) {
    for (int j = first[1]; j <= last[1]; ++j) {
      const auto row = volume.voxels.begin() + static_cast<std::ptrdiff_t>(volume.offset(first[0], j, k));
      part.voxels.insert(part.voxels.end(), row, row + size[0]);
    }
  }
  return part;
}

} // namespace bregma::casefile
