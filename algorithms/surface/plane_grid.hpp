// A grid of planes over a surface, as the inner loops read it: plain floats, so that they fit vector registers. mm.
#pragma once

#include <array>

namespace bregma::surface {

// Planes of voxels, x fastest; a point outside belongs to the nearest voxel. At least one voxel along each axis. Points
// into the SurfaceField that made it.
struct PlaneGrid {
  std::array<float, 3> low{}; // corner of the first voxel
  float per_mm = 1.0F;
  std::array<int, 3> size{};
  const float *planes = nullptr; // four per voxel: outward unit normal, offset
};

} // namespace bregma::surface
