// Private to algorithms/mri/grid: crossings in one slice.
#pragma once

#include <vector>

#include <Eigen/Core>

namespace bregma::mri {

struct SliceOptions {
  double cell_mm = 15.0, bar_mm = 2.0;
  bool bright = false;
};

// values: row-major, columns * rows; pixel_mm: along a row, along a column. Results in pixels, whole at centres.
[[nodiscard]] std::vector<Eigen::Vector2d> slice_crossings(const std::vector<float> &values, int columns, int rows,
                                                           const Eigen::Vector2d &pixel_mm,
                                                           const SliceOptions &options);

} // namespace bregma::mri
