#include "clients/cli/mri/report/run_pictures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace bregma::cli::mri_report {

namespace {

// Of the map "viridis" [van der Walt 2015].
constexpr std::array<Colour, 5> kMapStops{{{68, 1, 84}, {59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {253, 231, 37}}};
constexpr Colour kUnknownGrey{205, 205, 205};

Image blank(int width, int height) {
  Image out;
  out.width = width;
  out.height = height;
  out.rgb.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  return out;
}

void put(Image &image, int x, int y, const Colour &colour) {
  if (x >= 0 && y >= 0 && x < image.width && y < image.height) {
    const std::size_t at =
        3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x));
    std::copy(colour.begin(), colour.end(), image.rgb.begin() + static_cast<std::ptrdiff_t>(at));
  }
}

} // namespace

Image grey(std::span<const float> values, int columns, int rows, float low, float high, int times) {
  Image out = blank(columns * times, rows * times);
  for (int y = 0; y < out.height; ++y) {
    for (int x = 0; x < out.width; ++x) {
      const float value = values[static_cast<std::size_t>(y / times) * static_cast<std::size_t>(columns) +
                                 static_cast<std::size_t>(x / times)];
      const auto level = static_cast<std::uint8_t>(255.0F * std::clamp((value - low) / (high - low), 0.0F, 1.0F));
      put(out, x, y, {level, level, level});
    }
  }
  return out;
}

Image grey(const std::vector<std::uint8_t> &values, int columns, int rows) {
  const std::vector<float> numbers(values.begin(), values.end());
  return grey(numbers, columns, rows, 0.0F, 255.0F);
}

Colour ColourMap::operator()(double value) const {
  const double place = std::clamp((value - low) / (high - low), 0.0, 1.0) * (kMapStops.size() - 1);
  const auto below = std::min(static_cast<std::size_t>(place), kMapStops.size() - 2);
  const double part = place - static_cast<double>(below);
  Colour out{};
  for (std::size_t i = 0; i < 3; ++i) {
    out[i] =
        static_cast<std::uint8_t>(std::lround((1.0 - part) * kMapStops[below][i] + part * kMapStops[below + 1][i]));
  }
  return out;
}

std::vector<std::string> ColourMap::stops() {
  std::vector<std::string> out;
  for (const Colour &c : kMapStops) {
    char text[8];
    std::snprintf(text, sizeof text, "#%02x%02x%02x", c[0], c[1], c[2]);
    out.emplace_back(text);
  }
  return out;
}

Image coloured(int columns, int rows, const ColourMap &map,
               const std::function<std::optional<double>(int column, int row)> &value) {
  Image out = blank(columns, rows);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const auto v = value(x, y);
      put(out, x, y, v ? map(*v) : kUnknownGrey);
    }
  }
  return out;
}

void draw_circle(Image &image, const Eigen::Vector2d &centre, double radius, const Colour &colour) {
  const int points = std::max(24, static_cast<int>(8.0 * radius));
  for (int i = 0; i < points; ++i) {
    const double angle = 2.0 * M_PI * i / points;
    for (const double r : {radius, radius + 0.7}) {
      put(image, static_cast<int>(std::lround(centre.x() + r * std::cos(angle))),
          static_cast<int>(std::lround(centre.y() + r * std::sin(angle))), colour);
    }
  }
}

void draw_cross(Image &image, const Eigen::Vector2d &centre, int arm, const Colour &colour) {
  const int x = static_cast<int>(std::lround(centre.x())), y = static_cast<int>(std::lround(centre.y()));
  for (int i = -arm; i <= arm; ++i) {
    put(image, x + i, y, colour);
    put(image, x, y + i, colour);
  }
}

Image cropped(const Image &image, int x, int y, int width, int height) {
  width = std::min(width, image.width);
  height = std::min(height, image.height);
  x = std::clamp(x, 0, image.width - width);
  y = std::clamp(y, 0, image.height - height);
  Image out = blank(width, height);
  for (int row = 0; row < height; ++row) {
    const auto from = image.rgb.begin() + 3 * (static_cast<std::ptrdiff_t>(y + row) * image.width + x);
    std::copy(from, from + 3 * static_cast<std::ptrdiff_t>(width),
              out.rgb.begin() + 3 * static_cast<std::ptrdiff_t>(row) * width);
  }
  return out;
}

} // namespace bregma::cli::mri_report
