// The fused ordinal feature of LLE-HE: which side of each voxel is brighter, in several directions, reduced to one
// value by locally linear embedding [Li 2011; Roweis 2000]. Internal to the room.
#pragma once

#include <vector>

#include "algorithms/intensity/features.hpp"

namespace bregma::intensity {

inline constexpr int kOrdinalLevels = 8;

// Level of each voxel, 0 to kOrdinalLevels - 1, about equally frequent where the image is not uniform. Responses of
// sum-difference filters along four directions in the plane, seven in space; the embedding is computed for 400 voxels,
// and extended to the others by the same weights of their neighbours among these.
[[nodiscard]] std::vector<float> ordinal_feature(const Volume &image, parallel::Team &team);

} // namespace bregma::intensity
