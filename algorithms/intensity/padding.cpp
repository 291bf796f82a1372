#include "algorithms/intensity/padding.hpp"

#include <algorithm>
#include <iterator>
#include <vector>

#include "algorithms/intensity/voxels.hpp"

namespace bregma::intensity {

Padding leave_out_padding(Volume &image) {
  constexpr double kMinFraction = 0.001; // of the voxels
  constexpr double kBetween = 0.005;     // of the padded voxels: interpolated at its edge
  constexpr float kMinGap = 0.2F;        // of the range of the other values
  const float low = grey_range(image.voxels).low;
  const auto padded = static_cast<double>(std::count(image.voxels.begin(), image.voxels.end(), low));
  if (!(low < 0.0F) || padded < kMinFraction * static_cast<double>(image.voxels.size())) {
    return {};
  }
  std::vector<float> others;
  std::copy_if(image.voxels.begin(), image.voxels.end(), std::back_inserter(others),
               [low](float v) { return v > low; });
  const auto between = static_cast<std::size_t>(kBetween * padded);
  if (others.size() <= between) {
    return {};
  }
  const float high = grey_range(others, kMinFraction).high;
  const auto end = others.begin() + static_cast<std::ptrdiff_t>(between + 1);
  std::partial_sort(others.begin(), end, others.end());
  if (others[between] - low < kMinGap * (high - others[between])) {
    return {};
  }
  // The scan begins above the widest gap.
  float next = others.front();
  float widest = next - low;
  for (std::size_t i = 1; i <= between; ++i) {
    if (const float gap = others[i] - others[i - 1]; gap > widest) {
      widest = gap;
      next = others[i];
    }
  }
  Padding out{low, 0};
  for (float &v : image.voxels) {
    if (v < next) {
      v = kNoValue;
      ++out.voxels;
    }
  }
  return out;
}

} // namespace bregma::intensity
