// Private to casefile/volumes: slices at uneven gaps, or shifted sideways by a tilted gantry, on a straight and even
// grid. Linear within a slice and along the normal between two: exact for every linear function.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace bregma::casefile {

// Slices of one orientation, size and pixel spacing.
struct SliceStack {
  std::array<std::int64_t, 2> size{};                   // columns, rows
  Eigen::Vector2d spacing_mm = Eigen::Vector2d::Ones(); // between columns, between rows
  std::vector<double> depths_mm;                        // along the normal, ascending
  std::vector<Eigen::Vector2d> offsets_mm;              // of the first pixel, along row and column
};

struct EvenStack {
  std::array<std::int64_t, 3> size{};
  double gap_mm = 0.0;                                 // the first slice is the first of the stack
  Eigen::Vector2d offset_mm = Eigen::Vector2d::Zero(); // of the first pixel
};

// The grid that holds every pixel of the stack, with the stack's smallest gap (at least a quarter of the median).
[[nodiscard]] EvenStack even_grid_of(const SliceStack &stack);

// voxels: those of the stack, slice by slice. outside: the value where there is no slice.
[[nodiscard]] std::vector<float> resampled(const SliceStack &stack, std::span<const float> voxels,
                                           const EvenStack &grid, float outside);

} // namespace bregma::casefile
