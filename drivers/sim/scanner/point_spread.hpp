// The point spread of a Cartesian acquisition with a Hamming window, applied to samples twice as dense as pixels.
//
// Private to this library.
#pragma once

#include <array>
#include <cmath>
#include <vector>

namespace bregma::sim::scanner::detail {

inline constexpr int kDense = 2;               // samples per pixel and direction
inline constexpr int kTaps = 8 * kDense / 2;   // on each side: four pixels
inline constexpr int kMargin = kTaps + kDense; // dense samples beyond the image on each side

// The window's transform is 0.54 sinc(x) + 0.23 (sinc(x - 1) + sinc(x + 1)).
[[nodiscard]] inline std::array<float, 2 * kTaps + 1> point_spread() {
  const auto sinc = [](double x) { return std::abs(x) < 1e-9 ? 1.0 : std::sin(M_PI * x) / (M_PI * x); };
  std::array<float, 2 * kTaps + 1> out{};
  double sum = 0.0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double x = (static_cast<double>(i) - kTaps) / kDense;
    const double value = 0.54 * sinc(x) + 0.23 * (sinc(x - 1.0) + sinc(x + 1.0));
    out[i] = static_cast<float>(value);
    sum += value;
  }
  for (float &value : out) {
    value = static_cast<float>(value / sum);
  }
  return out;
}

// dense: (kDense * columns + 2 kMargin) by the same of rows; pixel (c, r) lies at dense (kDense c + kMargin, ...).
template <class Value>
void spread(const std::vector<Value> &dense, int columns, int rows, Value *pixels, std::vector<Value> &scratch) {
  static const std::array<float, 2 *kTaps + 1> kernel = point_spread();
  const int wide = kDense * columns + 2 * kMargin;
  const int high = kDense * rows + 2 * kMargin;
  scratch.assign(static_cast<std::size_t>(columns) * static_cast<std::size_t>(high), Value{});
  for (int y = 0; y < high; ++y) {
    const Value *line = &dense[static_cast<std::size_t>(y) * static_cast<std::size_t>(wide)];
    for (int c = 0; c < columns; ++c) {
      const Value *first = line + kDense * c + kMargin - kTaps;
      Value sum{};
      for (std::size_t t = 0; t < kernel.size(); ++t) {
        sum += kernel[t] * first[t];
      }
      scratch[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(c)] = sum;
    }
  }
  for (int r = 0; r < rows; ++r) {
    Value *out = pixels + static_cast<std::size_t>(r) * static_cast<std::size_t>(columns);
    for (std::size_t t = 0; t < kernel.size(); ++t) {
      const int y = kDense * r + kMargin - kTaps + static_cast<int>(t);
      const Value *line = &scratch[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns)];
      for (int c = 0; c < columns; ++c) {
        out[c] += kernel[t] * line[c];
      }
    }
  }
}

// A slice's profile at a distance from its middle, as a part of its thickness: 1 inside, ramps of a fifth at its edges.
[[nodiscard]] inline double slice_profile(double distance) {
  const double x = std::abs(distance);
  return x <= 0.4 ? 1.0 : x >= 0.6 ? 0.0 : (0.6 - x) / 0.2;
}

} // namespace bregma::sim::scanner::detail
