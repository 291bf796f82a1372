// Slices at uneven gaps and shifted sideways, on a straight grid.
#include "casefile/volumes/slice_stack.hpp"

#include <algorithm>

#include <gtest/gtest.h>

namespace bregma::casefile {
namespace {

SliceStack stack_of(std::vector<double> depths_mm, double shift_per_mm) {
  SliceStack out{{20, 16}, {0.8, 1.25}, std::move(depths_mm), {}};
  for (const double depth : out.depths_mm) {
    out.offsets_mm.emplace_back(3.0, -7.0 + shift_per_mm * depth);
  }
  return out;
}

double linear(double x, double y, double z) { return 2.0 * x - 3.0 * y + 0.7 * z + 5.0; }

std::vector<float> linear_voxels(const SliceStack &stack) {
  std::vector<float> out;
  for (std::size_t k = 0; k < stack.depths_mm.size(); ++k) {
    for (int j = 0; j < stack.size[1]; ++j) {
      for (int i = 0; i < stack.size[0]; ++i) {
        out.push_back(
            static_cast<float>(linear(stack.offsets_mm[k].x() + i * stack.spacing_mm.x(),
                                      stack.offsets_mm[k].y() + j * stack.spacing_mm.y(), stack.depths_mm[k])));
      }
    }
  }
  return out;
}

// Every voxel that the slices cover has the function's value; the others have the value outside.
void expect_exact(const SliceStack &stack) {
  const EvenStack grid = even_grid_of(stack);
  const float outside = -1e6F;
  const std::vector<float> out = resampled(stack, linear_voxels(stack), grid, outside);
  ASSERT_EQ(out.size(), static_cast<std::size_t>(grid.size[0] * grid.size[1] * grid.size[2]));
  std::size_t at = 0;
  int exact = 0;
  for (int k = 0; k < grid.size[2]; ++k) {
    for (int j = 0; j < grid.size[1]; ++j) {
      for (int i = 0; i < grid.size[0]; ++i, ++at) {
        const float expected = static_cast<float>(linear(grid.offset_mm.x() + i * stack.spacing_mm.x(),
                                                         grid.offset_mm.y() + j * stack.spacing_mm.y(),
                                                         stack.depths_mm.front() + k * grid.gap_mm));
        if (out[at] > -1e3F) {
          EXPECT_NEAR(out[at], expected, 1e-3) << i << " " << j << " " << k;
          ++exact;
        }
      }
    }
  }
  const auto voxels = static_cast<double>(stack.size[0] * stack.size[1] * grid.size[2]);
  EXPECT_GT(exact, 0.8 * voxels) << "most of the slices' area";
}

TEST(SliceStack, ALinearFunctionIsExactOnUnevenAndTiltedSlices) {
  expect_exact(stack_of({10, 11, 13, 16, 20, 25}, 0.0));
  expect_exact(stack_of({10, 12, 14, 16, 18}, 0.35));
  expect_exact(stack_of({10, 11, 13, 16, 17, 22}, -0.35));
}

TEST(SliceStack, AnEvenStraightStackIsUnchanged) {
  const SliceStack stack = stack_of({1, 3, 5, 7}, 0.0);
  const EvenStack grid = even_grid_of(stack);
  EXPECT_EQ(grid.size, (std::array<std::int64_t, 3>{20, 16, 4}));
  EXPECT_DOUBLE_EQ(grid.gap_mm, 2.0);
  const std::vector<float> voxels = linear_voxels(stack);
  EXPECT_EQ(resampled(stack, voxels, grid, 0.0F), voxels);
}

TEST(SliceStack, TheGridHoldsTheFirstAndTheLastSliceAndEveryShiftedPixel) {
  const SliceStack stack = stack_of({10, 11, 13, 16, 20, 25}, 0.5);
  const EvenStack grid = even_grid_of(stack);
  EXPECT_DOUBLE_EQ(grid.gap_mm * static_cast<double>(grid.size[2] - 1), 15.0);
  EXPECT_DOUBLE_EQ(grid.gap_mm, 1.0);
  EXPECT_EQ(grid.size[0], 20);
  EXPECT_EQ(grid.size[1], 16 + 6); // 7.5 mm of 1.25
  EXPECT_DOUBLE_EQ(grid.offset_mm.y(), -2.0);
}

} // namespace
} // namespace bregma::casefile
