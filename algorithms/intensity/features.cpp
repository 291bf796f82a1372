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

#include "algorithms/intensity/resolution.hpp"
#include "algorithms/intensity/voxels.hpp"

namespace bregma::intensity {

namespace {

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
