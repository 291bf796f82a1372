#include "algorithms/intensity/features.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <iterator>
#include <limits>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace bregma::intensity {

namespace {

constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

std::array<int, 3> strides_of(const image::Grid<3> &grid) { return {1, grid.size[0], grid.size[0] * grid.size[1]}; }

// Calls body(i, j, k, offset) for each voxel; slices, or rows of a plane, are shared among the threads.
template <class Body> void for_voxels(const image::Grid<3> &grid, parallel::Team &team, const Body &body) {
  const int rows = grid.size[1] * grid.size[2];
  team.run([&](int thread) {
    const int first = static_cast<int>(static_cast<std::int64_t>(rows) * thread / team.size());
    const int last = static_cast<int>(static_cast<std::int64_t>(rows) * (thread + 1) / team.size());
    for (int row = first; row < last; ++row) {
      const int j = row % grid.size[1];
      const int k = row / grid.size[1];
      for (int i = 0; i < grid.size[0]; ++i) {
        body(i, j, k, grid.offset(i, j, k));
      }
    }
  });
}

double mean_spacing(const image::Grid<3> &grid) {
  double sum = 0.0;
  int axes = 0;
  for (int d = 0; d < 3; ++d) {
    if (grid.size[static_cast<std::size_t>(d)] > 1) {
      sum += grid.spacing_mm()[d];
      ++axes;
    }
  }
  return axes > 0 ? sum / axes : 1.0;
}

// Difference per voxel along axis d.
float difference(const std::vector<float> &values, const std::array<int, 3> &size, std::size_t d, int at,
                 std::size_t offset, std::ptrdiff_t stride) {
  if (size[d] < 2) {
    return 0.0F;
  }
  const float *here = values.data() + offset;
  if (at == 0) {
    return here[stride] - here[0];
  }
  if (at == size[d] - 1) {
    return here[0] - here[-stride];
  }
  return 0.5F * (here[stride] - here[-stride]);
}

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

// Lower envelope of parabolas along one line of squared distances.
struct ParabolaEnvelope {
  std::vector<double> value, border, out;
  std::vector<int> apex;
  explicit ParabolaEnvelope(std::size_t n) : value(n), border(n + 1), out(n), apex(n) {}
  void transform(float *line, int count, std::ptrdiff_t stride, double step) {
    const double step2 = step * step;
    int last = -1;
    for (int q = 0; q < count; ++q) {
      const auto at = static_cast<std::size_t>(q);
      value[at] = static_cast<double>(line[q * stride]);
      if (!std::isfinite(value[at])) {
        continue;
      }
      double crossing = -std::numeric_limits<double>::infinity();
      while (last >= 0) {
        const int p = apex[static_cast<std::size_t>(last)];
        crossing = (value[at] - value[static_cast<std::size_t>(p)] + step2 * (q * q - p * p)) / (2.0 * step2 * (q - p));
        if (crossing > border[static_cast<std::size_t>(last)]) {
          break;
        }
        --last;
      }
      ++last;
      apex[static_cast<std::size_t>(last)] = q;
      border[static_cast<std::size_t>(last)] = last == 0 ? -std::numeric_limits<double>::infinity() : crossing;
    }
    if (last < 0) {
      return;
    }
    int k = 0;
    for (int q = 0; q < count; ++q) {
      while (k < last && border[static_cast<std::size_t>(k) + 1] < q) {
        ++k;
      }
      const int p = apex[static_cast<std::size_t>(k)];
      const double apart = step * (q - p);
      out[static_cast<std::size_t>(q)] = value[static_cast<std::size_t>(p)] + apart * apart;
    }
    for (int q = 0; q < count; ++q) {
      line[q * stride] = static_cast<float>(out[static_cast<std::size_t>(q)]);
    }
  }
};

// The finite value with `cut` values beyond it at one end of the range: a histogram finds the bin, and only its values
// are ordered.
float edge_of(const std::vector<float> &values, const GreyRange &range, std::size_t cut, bool at_top) {
  constexpr std::size_t kClasses = 1024;
  const float scale = (static_cast<float>(kClasses) - 1.0F) / (range.high - range.low);
  const auto class_of = [&](float v) {
    const auto at = static_cast<std::size_t>((at_top ? range.high - v : v - range.low) * scale);
    return std::min(at, kClasses - 1);
  };
  std::array<std::size_t, kClasses> count{};
  for (const float v : values) {
    if (std::isfinite(v)) {
      ++count[class_of(v)];
    }
  }
  std::size_t at = 0;
  while (cut >= count[at]) {
    cut -= count[at++];
  }
  std::vector<float> within;
  within.reserve(count[at]);
  std::copy_if(values.begin(), values.end(), std::back_inserter(within),
               [&](float v) { return std::isfinite(v) && class_of(v) == at; });
  const auto edge = within.begin() + static_cast<std::ptrdiff_t>(cut);
  if (at_top) {
    std::nth_element(within.begin(), edge, within.end(), std::greater<>());
  } else {
    std::nth_element(within.begin(), edge, within.end());
  }
  return *edge;
}

} // namespace

Volume as_volume(const image::Image<float, 2> &plane) {
  Volume out;
  out.size = {plane.size[0], plane.size[1], 1};
  out.T_image_index.topLeftCorner<2, 2>() = plane.axes();
  out.T_image_index.topRightCorner<2, 1>() = plane.origin_mm();
  out.voxels = plane.voxels;
  return out;
}

GreyRange grey_range(const std::vector<float> &values, double tail) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  float low = kInfinity;
  float high = -kInfinity;
  std::size_t count = 0;
  for (const float v : values) {
    const bool finite = std::abs(v) < kInfinity;
    low = finite && v < low ? v : low;
    high = finite && v > high ? v : high;
    count += finite ? 1 : 0;
  }
  if (count == 0) {
    return {};
  }
  const auto cut = static_cast<std::size_t>(tail * static_cast<double>(count - 1));
  if (cut == 0 || !(high > low)) {
    return {low, high};
  }
  return {edge_of(values, {low, high}, cut, false), edge_of(values, {low, high}, cut, true)};
}

Gradient gradient(const Volume &image, parallel::Team &team) {
  const std::size_t count = image.voxels.size();
  Gradient out{std::vector<float>(count), std::vector<float>(count), std::vector<float>(count)};
  const std::array<int, 3> stride = strides_of(image);
  // d/dx = A^-T d/dindex
  const Eigen::Matrix3f to_frame = (image.axes().inverse().transpose() * mean_spacing(image)).cast<float>();
  for_voxels(image, team, [&](int i, int j, int k, std::size_t at) {
    const Eigen::Vector3f along(difference(image.voxels, image.size, 0, i, at, stride[0]),
                                difference(image.voxels, image.size, 1, j, at, stride[1]),
                                difference(image.voxels, image.size, 2, k, at, stride[2]));
    const Eigen::Vector3f g = to_frame * along;
    out.x[at] = g.x();
    out.y[at] = g.y();
    out.z[at] = g.z();
  });
  return out;
}

std::vector<float> gradient_magnitude(const Volume &image, parallel::Team &team) {
  Gradient g = gradient(image, team);
  for_voxels(image, team, [&](int, int, int, std::size_t at) {
    g.x[at] = std::sqrt(g.x[at] * g.x[at] + g.y[at] * g.y[at] + g.z[at] * g.z[at]);
  });
  return std::move(g.x);
}

std::vector<float> significance(const Volume &image, parallel::Team &team) {
  std::vector<float> out = gradient_magnitude(image, team);
  const GreyRange grey = grey_range(image.voxels);
  const float scale = grey_range(out).high + grey.high - grey.low;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = scale > 0.0F ? (out[i] + image.voxels[i] - grey.low) / scale : 0.0F;
  }
  return out;
}

std::vector<float> adaptive_image_gradient(const Volume &image, AigReading reading, parallel::Team &team) {
  const std::vector<float> slope = gradient_magnitude(image, team);
  const float threshold = reading == AigReading::kPrinted ? 0.0F : otsu_threshold(slope);
  std::vector<char> edge(slope.size());
  std::transform(slope.begin(), slope.end(), edge.begin(), [&](float g) { return g > threshold ? 1 : 0; });
  std::vector<float> out = distance_to(image, edge);
  const float farthest = grey_range(out).high;
  const GreyRange grey = grey_range(image.voxels);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float factor = reading == AigReading::kDistance            ? 1.0F
                         : reading == AigReading::kDistanceTimesGrey ? image.voxels[i] - grey.low
                                                                     : slope[i];
    const float distance = farthest > 0.0F ? out[i] / farthest : 0.0F;
    out[i] = std::isnan(image.voxels[i]) ? kNoValue : distance * factor;
  }
  return out;
}

std::vector<float> standard_deviation(const Volume &image, int radius, parallel::Team &team) {
  std::vector<float> out(image.voxels.size());
  const auto range = [&](int at, std::size_t d) {
    return std::pair(std::max(at - radius, 0), std::min(at + radius, image.size[d] - 1));
  };
  for_voxels(image, team, [&](int i, int j, int k, std::size_t at) {
    double sum = 0.0;
    double squares = 0.0;
    double count = 0.0;
    const auto [i0, i1] = range(i, 0);
    const auto [j0, j1] = range(j, 1);
    const auto [k0, k1] = range(k, 2);
    for (int c = k0; c <= k1; ++c) {
      for (int b = j0; b <= j1; ++b) {
        for (int a = i0; a <= i1; ++a) {
          const auto v = static_cast<double>(image.at(a, b, c));
          sum += v;
          squares += v * v;
          count += 1.0;
        }
      }
    }
    out[at] = static_cast<float>(std::sqrt(std::max(squares / count - sum * sum / (count * count), 0.0)));
  });
  return out;
}

std::vector<float> corners(const Volume &image, parallel::Team &team) {
  const Gradient g = gradient(image, team);
  const double sigma_mm = mean_spacing(image);
  const auto product = [&](const std::vector<float> &a, const std::vector<float> &b) {
    Volume out{image, std::vector<float>(a.size())};
    std::transform(a.begin(), a.end(), b.begin(), out.voxels.begin(), std::multiplies<>());
    return smoothed(out, sigma_mm, team).voxels;
  };
  const std::array<std::vector<float>, 6> tensor{product(g.x, g.x), product(g.y, g.y), product(g.z, g.z),
                                                 product(g.x, g.y), product(g.x, g.z), product(g.y, g.z)};
  const bool plane = image.size[2] == 1;
  std::vector<float> out(image.voxels.size());
  for_voxels(image, team, [&](int, int, int, std::size_t at) {
    Eigen::Matrix3f m;
    m << tensor[0][at], tensor[3][at], tensor[4][at], tensor[3][at], tensor[1][at], tensor[5][at], tensor[4][at],
        tensor[5][at], tensor[2][at];
    if (!m.allFinite()) {
      out[at] = kNoValue;
      return;
    }
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> solver;
    solver.computeDirect(m, Eigen::EigenvaluesOnly);
    out[at] = std::sqrt(std::max(solver.eigenvalues()[plane ? 1 : 0], 0.0F)); // in the plane one is always 0
  });
  return out;
}

std::vector<float> feature_of(const Volume &image, Feature feature, AigReading reading, parallel::Team &team) {
  switch (feature) {
  case Feature::kGradient:
    return gradient_magnitude(image, team);
  case Feature::kSignificance:
    return significance(image, team);
  case Feature::kAig:
    return adaptive_image_gradient(image, reading, team);
  case Feature::kStandardDeviation:
    return standard_deviation(image, 1, team);
  case Feature::kCorners:
    return corners(image, team);
  case Feature::kGrey:
    break;
  }
  return image.voxels;
}

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

std::vector<float> distance_to(const Volume &grid, const std::vector<char> &set) {
  std::vector<float> out(set.size());
  if (std::find(set.begin(), set.end(), 1) == set.end()) {
    return out;
  }
  std::transform(set.begin(), set.end(), out.begin(),
                 [](char in) { return in != 0 ? 0.0F : std::numeric_limits<float>::infinity(); });
  const std::array<int, 3> stride = strides_of(grid);
  const double unit = mean_spacing(grid);
  for (std::size_t d = 0; d < 3; ++d) {
    const std::size_t e = d == 0 ? 1 : 0;
    const std::size_t f = d == 2 ? 1 : 2;
    ParabolaEnvelope envelope(static_cast<std::size_t>(grid.size[d]));
    for (int b = 0; b < grid.size[f]; ++b) {
      for (int a = 0; a < grid.size[e]; ++a) {
        const std::ptrdiff_t start =
            static_cast<std::ptrdiff_t>(a) * stride[e] + static_cast<std::ptrdiff_t>(b) * stride[f];
        envelope.transform(out.data() + start, grid.size[d], stride[d],
                           grid.spacing_mm()[static_cast<Eigen::Index>(d)] / unit);
      }
    }
  }
  for (float &v : out) {
    v = std::sqrt(v);
  }
  return out;
}

float otsu_threshold(const std::vector<float> &values) {
  constexpr int kClasses = 256;
  const GreyRange range = grey_range(values);
  if (range.constant()) {
    return range.high;
  }
  std::array<double, kClasses> count{};
  double total = 0.0;
  double sum = 0.0;
  for (const float v : values) {
    if (std::isfinite(v)) {
      const auto bin = static_cast<std::size_t>((v - range.low) / (range.high - range.low) * (kClasses - 1));
      count[bin] += 1.0;
      total += 1.0;
      sum += static_cast<double>(bin);
    }
  }
  double below = 0.0;
  double sum_below = 0.0;
  double best = -1.0;
  int threshold = 0;
  for (int bin = 0; bin < kClasses - 1; ++bin) {
    below += count[static_cast<std::size_t>(bin)];
    sum_below += bin * count[static_cast<std::size_t>(bin)];
    if (below > 0.0 && below < total) {
      const double apart = sum_below / below - (sum - sum_below) / (total - below);
      const double between = below * (total - below) * apart * apart;
      if (between > best) {
        best = between;
        threshold = bin;
      }
    }
  }
  return range.low + (static_cast<float>(threshold) + 1.0F) / (kClasses - 1) * (range.high - range.low);
}

} // namespace bregma::intensity
