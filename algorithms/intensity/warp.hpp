// Resampling of an image through a map, in the plane and in space.
//
// The map leads from the reference image's frame to the floating image's (resampling direction): each pixel of the
// result is sampled from the floating image by (bi-, tri-)linear interpolation. Pixels outside the floating image are
// NaN, so that similarity.hpp leaves them out. Pure; `map` must be safe to call from the team's threads at a time.
#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <vector>

#include <Eigen/Core>
#include <Eigen/LU>

#include "algorithms/image/grid.hpp"
#include "algorithms/parallel/team.hpp"

namespace bregma::intensity {

// Linear interpolation at a fractional pixel index; NaN outside the pixel centres.
template <int D>
[[nodiscard]] float sample(const image::Grid<D> &grid, std::span<const float> values,
                           const Eigen::Matrix<double, D, 1> &index) noexcept {
  std::array<std::size_t, D> base{};
  std::array<double, D> fraction{};
  for (std::size_t d = 0; d < static_cast<std::size_t>(D); ++d) {
    const double at = index[static_cast<Eigen::Index>(d)];
    const int last = grid.size[d] - 1;
    if (!(at >= -1e-9 && at <= last + 1e-9)) {
      return std::numeric_limits<float>::quiet_NaN();
    }
    const int low = std::clamp(static_cast<int>(at), 0, std::max(last - 1, 0));
    base[d] = static_cast<std::size_t>(low);
    fraction[d] = std::clamp(at - low, 0.0, 1.0);
  }
  double sum = 0.0;
  for (unsigned corner = 0; corner < (1U << D); ++corner) {
    double weight = 1.0;
    std::size_t offset = 0;
    std::size_t stride = 1;
    for (std::size_t d = 0; d < static_cast<std::size_t>(D); ++d) {
      const bool upper = ((corner >> d) & 1U) != 0;
      weight *= upper ? fraction[d] : 1.0 - fraction[d];
      offset += stride * (base[d] + (upper ? 1 : 0));
      stride *= static_cast<std::size_t>(grid.size[d]);
    }
    if (weight > 0.0) {
      sum += weight * static_cast<double>(values[offset]);
    }
  }
  return static_cast<float>(sum);
}

// map: a point of the reference (mm) to a point of the floating image (mm). values: floating.pixels() intensities.
template <int D, class Map>
[[nodiscard]] std::vector<float> warp(const image::Grid<D> &reference, const image::Grid<D> &floating,
                                      std::span<const float> values, const Map &map, parallel::Team &team) {
  std::vector<float> out(reference.pixels());
  const Eigen::Matrix<double, D, D> to_index = floating.axes().inverse();
  const Eigen::Matrix<double, D, 1> origin_mm = floating.origin_mm();
  const auto parts = static_cast<std::size_t>(team.size());
  team.run([&](int thread) {
    const auto part = static_cast<std::size_t>(thread);
    for (std::size_t i = out.size() * part / parts; i < out.size() * (part + 1) / parts; ++i) {
      const Eigen::Matrix<double, D, 1> there = map(reference.pixel_mm(i));
      out[i] = sample<D>(floating, values, to_index * (there - origin_mm));
    }
  });
  return out;
}

// On the caller's thread.
template <int D, class Map>
[[nodiscard]] std::vector<float> warp(const image::Grid<D> &reference, const image::Grid<D> &floating,
                                      std::span<const float> values, const Map &map) {
  parallel::Team alone(1);
  return warp<D>(reference, floating, values, map, alone);
}

} // namespace bregma::intensity
