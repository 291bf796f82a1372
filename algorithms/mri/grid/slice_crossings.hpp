// Crossings of a grid's bars in one slice: the steps of [Tuna 2022, figure 3]. grid_points.hpp has the whole chain.
// Pure functions, any thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace bregma::mri {

struct SliceOptions {
  double cell_mm = 15.0, bar_mm = 2.0;
  bool bright = false;
};

// One step of the chain as a picture. The slice is enlarged.
struct CrossingStage {
  std::string name;
  int columns = 0, rows = 0;
  std::vector<std::uint8_t> pixels; // row-major
};

// values: row-major, columns * rows; pixel_mm: along a row, along a column. Results in pixels, whole at centres.
// stages: receives the pictures of the steps.
[[nodiscard]] std::vector<Eigen::Vector2d> slice_crossings(const std::vector<float> &values, int columns, int rows,
                                                           const Eigen::Vector2d &pixel_mm, const SliceOptions &options,
                                                           std::vector<CrossingStage> *stages = nullptr);

} // namespace bregma::mri
