// Saliency of the voxels, for Q-MI: how unpredictable their neighbourhood is, at the scale where that is largest
// [Kadir 2001; Luan 2008]. Internal to the room.
#pragma once

#include <vector>

#include "algorithms/intensity/features.hpp"

namespace bregma::intensity {

// 0 to 1. Largest over the scales, in cubes of radius 1 to 3 voxels, of the entropy of the grey values (16 bins) times
// their change from the next smaller scale.
[[nodiscard]] std::vector<float> saliency(const Volume &image, parallel::Team &team);

} // namespace bregma::intensity
