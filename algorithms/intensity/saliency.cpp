#include "algorithms/intensity/saliency.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "algorithms/intensity/joint_histogram.hpp"

namespace bregma::intensity {

namespace {

constexpr int kGreys = 16;
constexpr int kMaxRadius = 3;

using Counts = std::array<float, kGreys>;

// Adds the voxels at this distance (largest of the three axes) from a voxel.
void add_ring(const std::vector<std::int8_t> &bins, const image::Grid<3> &grid, const std::array<int, 3> &at,
              int radius, Counts &counts) {
  const auto limits = [&](std::size_t d) {
    return std::pair(std::max(at[d] - radius, 0), std::min(at[d] + radius, grid.size[d] - 1));
  };
  const auto [i0, i1] = limits(0);
  const auto [j0, j1] = limits(1);
  const auto [k0, k1] = limits(2);
  for (int k = k0; k <= k1; ++k) {
    for (int j = j0; j <= j1; ++j) {
      const bool whole = std::max(std::abs(k - at[2]), std::abs(j - at[1])) == radius;
      for (int i = i0; i <= i1; ++i) {
        if (!whole && std::abs(i - at[0]) != radius) {
          continue;
        }
        const std::int8_t bin = bins[grid.offset(i, j, k)];
        if (bin >= 0) {
          counts[static_cast<std::size_t>(bin)] += 1.0F;
        }
      }
    }
  }
}

float saliency_at(const std::vector<std::int8_t> &bins, const image::Grid<3> &grid, const std::array<int, 3> &at) {
  Counts counts{};
  Counts before{};
  add_ring(bins, grid, at, 0, counts);
  float best = 0.0F;
  for (int radius = 1; radius <= kMaxRadius; ++radius) {
    float total_before = 0.0F;
    float total = 0.0F;
    before = counts;
    add_ring(bins, grid, at, radius, counts);
    for (std::size_t g = 0; g < kGreys; ++g) {
      total_before += before[g];
      total += counts[g];
    }
    if (!(total_before > 0.0F)) {
      continue;
    }
    float entropy = 0.0F;
    float change = 0.0F;
    for (std::size_t g = 0; g < kGreys; ++g) {
      const float p = counts[g] / total;
      entropy -= p > 0.0F ? p * std::log(p) : 0.0F;
      change += std::abs(p - before[g] / total_before);
    }
    const auto s = static_cast<float>(radius);
    best = std::max(best, entropy * change * s * s / (2.0F * s - 1.0F));
  }
  return best;
}

} // namespace

std::vector<float> saliency(const Volume &image, parallel::Team &team) {
  const GreyRange range = grey_range(image.voxels);
  const BinScale scale = bin_scale(range.low, range.high, kGreys, false);
  std::vector<std::int8_t> bins(image.voxels.size());
  std::transform(image.voxels.begin(), image.voxels.end(), bins.begin(),
                 [&](float v) { return static_cast<std::int8_t>(std::isfinite(v) ? bin_at(scale(v)) : -1); });
  std::vector<float> out(image.voxels.size());
  const int rows = image.size[1] * image.size[2];
  team.run([&](int thread) {
    for (int row = thread; row < rows; row += team.size()) {
      const int j = row % image.size[1];
      const int k = row / image.size[1];
      for (int i = 0; i < image.size[0]; ++i) {
        out[image.offset(i, j, k)] = saliency_at(bins, image, {i, j, k});
      }
    }
  });
  const float largest = grey_range(out).high;
  for (float &v : out) {
    v = largest > 0.0F ? v / largest : 0.0F;
  }
  return out;
}

} // namespace bregma::intensity
