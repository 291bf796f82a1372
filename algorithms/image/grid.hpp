// Images on a regular grid, in the plane and in space: as files, the comparison of images and scanners exchange them.
//
// Pixels are points: a grid's pixel i, j(, k) lies at T_image_index (i, j(, k), 1). mm; the frame is that of the image
// (RAS for volumes). Plain values: safe to read from any thread.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <vector>

#include <Eigen/Core>

namespace bregma::image {

template <int D> struct Grid {
  using Vector = Eigen::Matrix<double, D, 1>;
  using Matrix = Eigen::Matrix<double, D + 1, D + 1>;

  std::array<int, D> size{};                 // pixels along each axis; the first runs fastest in memory
  Matrix T_image_index = Matrix::Identity(); // index of a pixel's centre to mm; affine, never singular

  // Columns: from one pixel to the next along each axis, mm.
  [[nodiscard]] Eigen::Matrix<double, D, D> axes() const { return T_image_index.template topLeftCorner<D, D>(); }
  [[nodiscard]] Vector origin_mm() const { return T_image_index.template topRightCorner<D, 1>(); }
  // Distance between neighbouring pixels along each axis, mm.
  [[nodiscard]] Vector spacing_mm() const { return axes().colwise().norm(); }

  [[nodiscard]] std::size_t pixels() const {
    std::size_t n = 1;
    for (const int s : size) {
      n *= static_cast<std::size_t>(s);
    }
    return n;
  }
  // The place in memory of a pixel.
  template <std::same_as<int>... Index>
  requires(sizeof...(Index) == D) [[nodiscard]] std::size_t offset(Index... index) const {
    const std::array<int, D> at{index...};
    std::size_t out = 0;
    for (std::size_t d = D; d-- > 0;) {
      out = out * static_cast<std::size_t>(size[d]) + static_cast<std::size_t>(at[d]);
    }
    return out;
  }
  // Where an index lies that need not be whole.
  [[nodiscard]] Vector point_mm(const Vector &index) const { return axes() * index + origin_mm(); }
  // Where the pixel at an offset in memory lies.
  [[nodiscard]] Vector pixel_mm(std::size_t offset) const {
    Vector index;
    for (std::size_t d = 0; d < static_cast<std::size_t>(D); ++d) {
      index[static_cast<Eigen::Index>(d)] = static_cast<double>(offset % static_cast<std::size_t>(size[d]));
      offset /= static_cast<std::size_t>(size[d]);
    }
    return point_mm(index);
  }
};

// A grid with a value at each pixel.
template <class Value, int D> struct Image : Grid<D> {
  std::vector<Value> voxels; // pixels() of them

  template <std::same_as<int>... Index> [[nodiscard]] Value at(Index... index) const {
    return voxels[this->offset(index...)];
  }
};

} // namespace bregma::image
