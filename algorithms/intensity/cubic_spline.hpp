// The four uniform cubic B-splines around a point; t: its position between the second and the third node, 0 to 1.
#pragma once

#include <array>

namespace bregma::intensity {

// They sum to 1.
[[nodiscard]] inline std::array<float, 4> spline_weights(float t) {
  const float u = 1.0F - t;
  const float first = u * u * u / 6.0F;
  const float last = t * t * t / 6.0F;
  const float second = 2.0F / 3.0F - t * t * (1.0F - 0.5F * t);
  return {first, second, 1.0F - first - second - last, last};
}

// By t; they sum to 0.
[[nodiscard]] inline std::array<float, 4> spline_slopes(float t) {
  const float u = 1.0F - t;
  const float first = -0.5F * u * u;
  const float last = 0.5F * t * t;
  const float second = t * (1.5F * t - 2.0F);
  return {first, second, -first - second - last, last};
}

} // namespace bregma::intensity
