#include "clients/cli/image/comparison_picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>

#include <Eigen/LU>

#include "casefile/volumes/render.hpp"

namespace bregma::cli {

namespace {

constexpr int kSliceHeight = 360; // pixels
constexpr int kSquares = 8;       // of the checkerboard along a slice

struct GreyScale {
  intensity::GreyRange range;
  [[nodiscard]] std::uint8_t operator()(float value) const {
    if (!std::isfinite(value) || range.constant()) {
      return 0;
    }
    const float fraction = std::clamp((value - range.low) / (range.high - range.low), 0.0F, 1.0F);
    return static_cast<std::uint8_t>(255.0F * fraction);
  }
};
GreyScale scale_of(const std::vector<float> &values) {
  constexpr double kTail = 0.005;
  return {intensity::grey_range(values, kTail)};
}

} // namespace

base::Result<void> check_picture(const std::string &option, const std::string &path) {
  return path.empty() || path.ends_with(".png")
             ? base::Result<void>()
             : base::failure(option + " " + path + ": pictures are written as .png only");
}

base::Result<void> write_slices_picture(const std::string &path, const intensity::Volume &image,
                                        const std::vector<float> *other, const Eigen::Vector3d &through_mm) {
  // The grid's axes are those of the frame, nearly: volumes are read in RAS order.
  const Eigen::Vector3d index = (image.axes().inverse() * (through_mm - image.origin_mm())).array().round();
  std::array<int, 3> at{};
  double tallest_mm = 0.0;
  for (std::size_t d = 0; d < 3; ++d) {
    at[d] = std::clamp(static_cast<int>(index[static_cast<Eigen::Index>(d)]), 0, image.size[d] - 1);
  }
  constexpr std::array<std::array<std::size_t, 2>, 3> kAxes{{{0, 1}, {0, 2}, {1, 2}}}; // across, up
  const auto length_mm = [&](std::size_t d) {
    return image.size[d] * image.spacing_mm()[static_cast<Eigen::Index>(d)];
  };
  for (const auto &axes : kAxes) {
    tallest_mm = std::max(tallest_mm, length_mm(axes[1]));
  }
  const double pixel_mm = tallest_mm / kSliceHeight;
  casefile::Image picture;
  picture.height = kSliceHeight;
  std::array<int, 3> width{};
  for (std::size_t s = 0; s < 3; ++s) {
    width[s] = std::max(static_cast<int>(length_mm(kAxes[s][0]) / pixel_mm), 1);
    picture.width += width[s];
  }
  picture.rgb.assign(3 * static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height), 0);
  const GreyScale first = scale_of(image.voxels);
  const GreyScale second = other != nullptr ? scale_of(*other) : first;
  int left = 0;
  for (std::size_t s = 0; s < 3; ++s) {
    const auto [across, up] = kAxes[s];
    const int height = static_cast<int>(length_mm(up) / pixel_mm);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width[s]; ++x) {
        std::array<int, 3> voxel = at;
        voxel[across] = std::min(x * image.size[across] / width[s], image.size[across] - 1);
        voxel[up] = std::min((height - 1 - y) * image.size[up] / height, image.size[up] - 1);
        const bool odd = other != nullptr && (x * kSquares / width[s] + y * kSquares / height) % 2 != 0;
        const std::size_t offset = image.offset(voxel[0], voxel[1], voxel[2]);
        const std::uint8_t grey = odd ? second((*other)[offset]) : first(image.voxels[offset]);
        const std::size_t pixel = 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) +
                                       static_cast<std::size_t>(left + x));
        std::fill_n(picture.rgb.begin() + static_cast<std::ptrdiff_t>(pixel), 3, grey);
      }
    }
    left += width[s];
  }
  const auto png = casefile::encode_png(picture);
  if (!png) {
    return tl::unexpected(png.error());
  }
  std::ofstream file(path, std::ios::binary);
  for (const std::uint8_t byte : *png) {
    file.put(static_cast<char>(byte));
  }
  file.close();
  return file ? base::Result<void>() : base::failure(path + ": cannot be written");
}

} // namespace bregma::cli
