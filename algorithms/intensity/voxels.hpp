// What the sources of this room share about the voxels of a volume.
#pragma once

#include <array>
#include <limits>

#include "algorithms/image/grid.hpp"

namespace bregma::intensity {

inline constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

// Distances in memory of two voxels that follow each other along each axis.
[[nodiscard]] inline std::array<int, 3> strides_of(const image::Grid<3> &grid) {
  return {1, grid.size[0], grid.size[0] * grid.size[1]};
}

} // namespace bregma::intensity
