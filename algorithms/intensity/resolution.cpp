#include "algorithms/intensity/resolution.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include <Eigen/LU>

#include "algorithms/intensity/voxels.hpp"

namespace bregma::intensity {

namespace {

using Volume = image::Image<float, 3>;

// Adds the smoothed copy of one line; weights on both sides, renormalised where a voxel is missing.
void smooth_line(const float *from, float *to, int count, std::ptrdiff_t stride, const std::vector<float> &weights) {
  const int radius = static_cast<int>(weights.size()) - 1;
  for (int i = 0; i < count; ++i) {
    float sum = 0.0F;
    float total = 0.0F;
    for (int n = std::max(i - radius, 0); n <= std::min(i + radius, count - 1); ++n) {
      const float value = from[n * stride];
      if (value == value) {
        const float w = weights[static_cast<std::size_t>(std::abs(n - i))];
        sum += w * value;
        total += w;
      }
    }
    const float own = from[i * stride];
    to[i * stride] = own == own ? sum / total : kNoValue;
  }
}

void smooth_along(Volume &image, std::size_t d, double sigma_voxels, parallel::Team &team) {
  std::vector<float> weights;
  for (int i = 0; i <= static_cast<int>(std::ceil(3.0 * sigma_voxels)); ++i) {
    weights.push_back(static_cast<float>(std::exp(-0.5 * i * i / (sigma_voxels * sigma_voxels))));
  }
  std::vector<float> out(image.voxels.size());
  const std::array<int, 3> stride = strides_of(image);
  const std::size_t e = d == 0 ? 1 : 0;
  const std::size_t f = d == 2 ? 1 : 2;
  team.run([&](int thread) {
    for (int b = thread; b < image.size[f]; b += team.size()) {
      for (int a = 0; a < image.size[e]; ++a) {
        const std::ptrdiff_t start =
            static_cast<std::ptrdiff_t>(a) * stride[e] + static_cast<std::ptrdiff_t>(b) * stride[f];
        smooth_line(image.voxels.data() + start, out.data() + start, image.size[d], stride[d], weights);
      }
    }
  });
  image.voxels = std::move(out);
}

// Which voxels along an axis make one of the shrunk axis, with their weights: a Gaussian, interpolated linearly.
struct ShrinkTaps {
  int first = 0;
  std::vector<float> weights;
  std::array<int, 2> centre{}; // the voxels on both sides; without a value in one of them there is none
};
std::vector<ShrinkTaps> shrink_taps(int from, int to) {
  const double factor = static_cast<double>(from) / to;
  const double sigma = 0.4 * factor;
  const int radius = static_cast<int>(std::ceil(3.0 * sigma));
  std::vector<ShrinkTaps> out;
  for (int i = 0; i < to; ++i) {
    const double position = (i + 0.5) * factor - 0.5;
    const int base = std::clamp(static_cast<int>(position), 0, from - 2);
    const double fraction = std::clamp(position - base, 0.0, 1.0);
    const auto gauss = [&](int n) { return std::abs(n) <= radius ? std::exp(-0.5 * n * n / (sigma * sigma)) : 0.0; };
    ShrinkTaps taps;
    taps.first = std::max(base - radius, 0);
    double total = 0.0;
    for (int n = taps.first; n <= std::min(base + 1 + radius, from - 1); ++n) {
      const double w = (1.0 - fraction) * gauss(n - base) + fraction * gauss(n - base - 1);
      taps.weights.push_back(static_cast<float>(w));
      total += w;
    }
    for (float &w : taps.weights) {
      w = static_cast<float>(static_cast<double>(w) / total);
    }
    taps.centre = {fraction < 1.0 ? base : base + 1, fraction > 0.0 ? base + 1 : base};
    out.push_back(std::move(taps));
  }
  return out;
}

// Weighted sum of `count` neighbouring lines' voxels. `apart`: distance of two taps in memory, `beside`: of two voxels
// of the result. NaN is left out; `total` receives the weight that remains.
struct TapLines {
  const float *from;
  std::ptrdiff_t apart, beside;
  int count;
};
void add_taps(const TapLines &lines, const ShrinkTaps &taps, float *sum, float *total) {
  std::fill_n(sum, lines.count, 0.0F);
  std::fill_n(total, lines.count, 0.0F);
  for (std::size_t n = 0; n < taps.weights.size(); ++n) {
    const float w = taps.weights[n];
    const float *line = lines.from + (taps.first + static_cast<std::ptrdiff_t>(n)) * lines.apart;
    for (int i = 0; i < lines.count; ++i) {
      const float v = line[i * lines.beside];
      const bool known = v == v;
      sum[i] += known ? w * v : 0.0F;
      total[i] += known ? w : 0.0F;
    }
  }
  for (int i = 0; i < lines.count; ++i) {
    const float *at = lines.from + i * lines.beside;
    const bool known = at[taps.centre[0] * lines.apart] == at[taps.centre[0] * lines.apart] &&
                       at[taps.centre[1] * lines.apart] == at[taps.centre[1] * lines.apart];
    sum[i] = known ? sum[i] / total[i] : kNoValue;
  }
}

void shrink_along(Volume &image, std::size_t d, int size, parallel::Team &team) {
  const std::vector<ShrinkTaps> taps = shrink_taps(image.size[d], size);
  const std::array<int, 3> stride = strides_of(image);
  Volume out;
  out.size = image.size;
  out.size[d] = size;
  out.voxels.resize(out.pixels());
  const std::array<int, 3> out_stride = strides_of(out);
  const int rows = out.size[1] * out.size[2];
  std::vector<float> totals(static_cast<std::size_t>(team.size()) * static_cast<std::size_t>(out.size[0]));
  team.run([&](int thread) {
    const auto of_thread = static_cast<std::size_t>(thread);
    float *total = totals.data() + of_thread * static_cast<std::size_t>(out.size[0]);
    const int last = static_cast<int>(static_cast<std::int64_t>(rows) * (thread + 1) / team.size());
    for (int row = static_cast<int>(static_cast<std::int64_t>(rows) * thread / team.size()); row < last; ++row) {
      const int j = row % out.size[1];
      const int k = row / out.size[1];
      float *to = out.voxels.data() + static_cast<std::ptrdiff_t>(row) * out_stride[1];
      if (d == 0) {
        const float *from = image.voxels.data() + static_cast<std::ptrdiff_t>(row) * stride[1];
        for (int i = 0; i < size; ++i) {
          add_taps({from, 1, 0, 1}, taps[static_cast<std::size_t>(i)], to + i, total);
        }
      } else {
        const float *from = image.voxels.data() + (d == 1 ? static_cast<std::ptrdiff_t>(k) * stride[2]
                                                          : static_cast<std::ptrdiff_t>(j) * stride[1]);
        add_taps({from, stride[d], 1, out.size[0]}, taps[static_cast<std::size_t>(d == 1 ? j : k)], to, total);
      }
    }
  });
  image.size = out.size;
  image.voxels = std::move(out.voxels);
}

} // namespace

Volume smoothed(const Volume &image, double sigma_mm, parallel::Team &team) {
  Volume out = image;
  for (std::size_t d = 0; d < 3; ++d) {
    const double sigma = sigma_mm / image.spacing_mm()[static_cast<Eigen::Index>(d)];
    if (image.size[d] > 1 && sigma > 0.05) {
      smooth_along(out, d, sigma, team);
    }
  }
  return out;
}

Volume shrunk(const Volume &image, double spacing_mm, parallel::Team &team) {
  Volume out = image;
  Eigen::Vector3d factor = Eigen::Vector3d::Ones();
  for (const std::size_t d : {2U, 1U, 0U}) { // lines across memory first: they are the quicker ones
    const auto axis = static_cast<Eigen::Index>(d);
    const double ratio = spacing_mm / image.spacing_mm()[axis];
    if (image.size[d] > 1 && ratio > 1.2) {
      const int size = std::max(static_cast<int>(std::round(image.size[d] / ratio)), 2);
      factor[axis] = static_cast<double>(image.size[d]) / size;
      shrink_along(out, d, size, team);
    }
  }
  // Both grids cover the same box.
  out.T_image_index.topLeftCorner<3, 3>() = image.axes() * factor.asDiagonal();
  out.T_image_index.topRightCorner<3, 1>() = image.point_mm(0.5 * (factor - Eigen::Vector3d::Ones()));
  return out;
}

} // namespace bregma::intensity
