// Pictures of slices for the page: grey values, colour maps, marks. Pixels: whole at centres, x to the right, y down.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "casefile/volumes/render.hpp"

namespace bregma::cli::mri_report {

using casefile::Colour;
using casefile::Image;

inline constexpr Colour kMarkOrange{240, 120, 20}, kMarkBlue{40, 130, 220}, kMarkGreen{0, 170, 110};

// Values as grey, low black and high white; each pixel `times` as wide and high.
[[nodiscard]] Image grey(std::span<const float> values, int columns, int rows, float low, float high, int times = 1);
[[nodiscard]] Image grey(const std::vector<std::uint8_t> &values, int columns, int rows);

// Blue (low) over green to yellow (high), as perceptually even as five stops allow; values without a colour are grey.
struct ColourMap {
  double low = 0.0, high = 1.0;
  [[nodiscard]] Colour operator()(double value) const;
  [[nodiscard]] static std::vector<std::string> stops(); // "#rrggbb", from low to high
};
[[nodiscard]] Image coloured(int columns, int rows, const ColourMap &map,
                             const std::function<std::optional<double>(int column, int row)> &value);

void draw_circle(Image &image, const Eigen::Vector2d &centre, double radius, const Colour &colour);
void draw_cross(Image &image, const Eigen::Vector2d &centre, int arm, const Colour &colour);
// The rectangle [x, x + width) x [y, y + height), moved inside the image.
[[nodiscard]] Image cropped(const Image &image, int x, int y, int width, int height);

} // namespace bregma::cli::mri_report
