#include "casefile/volumes/slice_stack.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace bregma::casefile {
namespace {

// Differences below this part of a pixel or gap are rounding of the positions in the files.
constexpr double kSame = 1e-3;

double snapped(double index) {
  const double whole = std::round(index);
  return std::abs(index - whole) < kSame ? whole : index;
}

class Resampling {
public:
  Resampling(const SliceStack &stack, std::span<const float> voxels, float outside)
      : stack_(stack), voxels_(voxels), outside_(outside) {}

  // Adds weight times slice k to the slice of the grid.
  void add(std::size_t k, float weight, const EvenStack &grid, std::span<float> out) const {
    const Eigen::Vector2d shift = (grid.offset_mm - stack_.offsets_mm[k]).cwiseQuotient(stack_.spacing_mm);
    const Eigen::Vector2d from(snapped(shift.x()), snapped(shift.y()));
    std::size_t at = 0;
    for (std::int64_t row = 0; row < grid.size[1]; ++row) {
      for (std::int64_t column = 0; column < grid.size[0]; ++column, ++at) {
        out[at] += weight * value(k, from.x() + static_cast<double>(column), from.y() + static_cast<double>(row));
      }
    }
  }

private:
  [[nodiscard]] float pixel(std::size_t k, std::int64_t column, std::int64_t row) const {
    if (column < 0 || row < 0 || column >= stack_.size[0] || row >= stack_.size[1]) {
      return outside_;
    }
    return voxels_[static_cast<std::size_t>((static_cast<std::int64_t>(k) * stack_.size[1] + row) * stack_.size[0] +
                                            column)];
  }

  [[nodiscard]] float value(std::size_t k, double column, double row) const {
    const double left = std::floor(column);
    const double top = std::floor(row);
    const auto across = static_cast<float>(column - left);
    const auto down = static_cast<float>(row - top);
    const auto i = static_cast<std::int64_t>(left);
    const auto j = static_cast<std::int64_t>(top);
    float out = (1.0F - across) * (1.0F - down) * pixel(k, i, j);
    out += across > 0.0F ? across * (1.0F - down) * pixel(k, i + 1, j) : 0.0F;
    out += down > 0.0F ? (1.0F - across) * down * pixel(k, i, j + 1) : 0.0F;
    out += across > 0.0F && down > 0.0F ? across * down * pixel(k, i + 1, j + 1) : 0.0F;
    return out;
  }

  const SliceStack &stack_;
  std::span<const float> voxels_;
  float outside_;
};

} // namespace

EvenStack even_grid_of(const SliceStack &stack) {
  std::vector<double> gaps;
  for (std::size_t k = 1; k < stack.depths_mm.size(); ++k) {
    gaps.push_back(stack.depths_mm[k] - stack.depths_mm[k - 1]);
  }
  std::sort(gaps.begin(), gaps.end());
  const double length = stack.depths_mm.back() - stack.depths_mm.front();
  const double least = std::max(gaps.front(), 0.25 * gaps[gaps.size() / 2]);
  const double slices = std::ceil(length / least - 0.1); // the last one lies in the last slice

  EvenStack out;
  out.gap_mm = length / slices;
  out.size[2] = static_cast<std::int64_t>(slices) + 1;
  Eigen::Vector2d first = stack.offsets_mm.front();
  Eigen::Vector2d last = first;
  for (const Eigen::Vector2d &offset : stack.offsets_mm) {
    first = first.cwiseMin(offset);
    last = last.cwiseMax(offset);
  }
  out.offset_mm = first;
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const auto along = static_cast<Eigen::Index>(axis);
    const double more = (last[along] - first[along]) / stack.spacing_mm[along];
    out.size[axis] = stack.size[axis] + static_cast<std::int64_t>(std::ceil(more - kSame));
  }
  return out;
}

std::vector<float> resampled(const SliceStack &stack, std::span<const float> voxels, const EvenStack &grid,
                             float outside) {
  const Resampling resampling(stack, voxels, outside);
  const auto slice = static_cast<std::size_t>(grid.size[0] * grid.size[1]);
  std::vector<float> out(slice * static_cast<std::size_t>(grid.size[2]), 0.0F);
  for (std::size_t k = 0; k < static_cast<std::size_t>(grid.size[2]); ++k) {
    const double depth = stack.depths_mm.front() + static_cast<double>(k) * grid.gap_mm;
    const auto after = std::upper_bound(stack.depths_mm.begin() + 1, stack.depths_mm.end() - 1, depth);
    const auto above = static_cast<std::size_t>(after - stack.depths_mm.begin());
    const double between = (depth - stack.depths_mm[above - 1]) / (stack.depths_mm[above] - stack.depths_mm[above - 1]);
    const auto weight = static_cast<float>(std::clamp(snapped(between), 0.0, 1.0));
    const std::span<float> to(out.data() + k * slice, slice);
    if (weight < 1.0F) {
      resampling.add(above - 1, 1.0F - weight, grid, to);
    }
    if (weight > 0.0F) {
      resampling.add(above, weight, grid, to);
    }
  }
  return out;
}

} // namespace bregma::casefile
