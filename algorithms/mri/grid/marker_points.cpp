#include "algorithms/mri/grid/marker_points.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include <Eigen/LU>

namespace bregma::mri {

namespace {

using Eigen::Index;
using Eigen::Vector3d;
using geometry::Points3;
using Volume = image::Image<float, 3>;

constexpr double kSmoothing = 0.25;                     // standard deviation, of a marker's diameter
constexpr float kCrowded = 0.5F;                        // of a marker's height: what is nearer is no part of it
constexpr double kWindow = 0.75;                        // radius around a centre, of a marker's diameter
constexpr double kWindowEdge_mm = 2.0;                  // over which the window falls to zero
constexpr double kShellInner = 0.85, kShellOuter = 1.1; // radii around a centre where the background shows
constexpr double kShellBright = 0.45;                   // of a marker's height: no background
constexpr double kMaxBrightShell = 0.1;                 // part of the shell that may be so bright

float median(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The index within 0 to n - 1 that a mirror at each end shows at i.
int mirrored(int i, int n) {
  const int period = 2 * n;
  const int at = ((i % period) + period) % period;
  return at < n ? at : period - 1 - at;
}

// One direction of a separable Gaussian; the image goes on as its mirror, in which noise stays noise. One value of the
// border that went on would be seen as a maximum.
void smooth_along(Volume &image, std::size_t axis, double sigma_px) {
  const int reach = static_cast<int>(std::ceil(3.0 * sigma_px));
  if (reach < 1 || image.size[axis] < 2) {
    return;
  }
  std::vector<float> kernel;
  float sum = 0.0F;
  for (int i = -reach; i <= reach; ++i) {
    kernel.push_back(static_cast<float>(std::exp(-0.5 * i * i / (sigma_px * sigma_px))));
    sum += kernel.back();
  }
  const int n = image.size[axis];
  const std::array<std::size_t, 3> others{axis, (axis + 1) % 3, (axis + 2) % 3};
  std::array<int, 3> at{};
  std::vector<float> line(static_cast<std::size_t>(n));
  for (at[others[2]] = 0; at[others[2]] < image.size[others[2]]; ++at[others[2]]) {
    for (at[others[1]] = 0; at[others[1]] < image.size[others[1]]; ++at[others[1]]) {
      const auto place = [&](int i) {
        at[axis] = i;
        return image.offset(at[0], at[1], at[2]);
      };
      for (int i = 0; i < n; ++i) {
        line[static_cast<std::size_t>(i)] = image.voxels[place(i)];
      }
      for (int i = 0; i < n; ++i) {
        float value = 0.0F;
        int from = i - reach;
        for (const float weight : kernel) {
          value += weight * line[static_cast<std::size_t>(mirrored(from++, n))];
        }
        image.voxels[place(i)] = value / sum;
      }
    }
  }
}

// Voxels whose centre lies within a distance of a point: visit(index, value, distance).
template <class Visit>
void around(const Volume &image, const Vector3d &centre_mm, double radius_mm, const Visit &visit) {
  const Vector3d spacing = image.spacing_mm();
  const Vector3d index = image.axes().inverse() * (centre_mm - image.origin_mm());
  std::array<int, 3> low{}, high{};
  for (std::size_t d = 0; d < 3; ++d) {
    const double reach = radius_mm / spacing[static_cast<Index>(d)];
    low[d] = std::max(0, static_cast<int>(std::ceil(index[static_cast<Index>(d)] - reach)));
    high[d] = std::min(image.size[d] - 1, static_cast<int>(std::floor(index[static_cast<Index>(d)] + reach)));
  }
  for (int k = low[2]; k <= high[2]; ++k) {
    for (int j = low[1]; j <= high[1]; ++j) {
      for (int i = low[0]; i <= high[0]; ++i) {
        const Vector3d at = image.point_mm(Vector3d(i, j, k));
        if (const double distance = (at - centre_mm).norm(); distance <= radius_mm) {
          visit(at, image.at(i, j, k), distance);
        }
      }
    }
  }
}

struct Maximum {
  Vector3d at_mm;
  float value = 0.0F;
};

struct Maxima {
  std::vector<Maximum> kept; // highest first; each is the highest within a marker's diameter
  std::vector<Vector3d> crowded_mm;
};

// Of the smoothed image, above the lowest value; heights count from the floor.
Maxima maxima(const Volume &smooth, float floor, float lowest, double radius_mm) {
  std::vector<Maximum> out;
  for (int k = 0; k < smooth.size[2]; ++k) {
    for (int j = 0; j < smooth.size[1]; ++j) {
      for (int i = 0; i < smooth.size[0]; ++i) {
        const float value = smooth.at(i, j, k);
        const auto below = [&](int di, int dj, int dk) {
          const std::array<int, 3> at{i + di, j + dj, k + dk};
          for (std::size_t d = 0; d < 3; ++d) {
            if (at[d] < 0 || at[d] >= smooth.size[d]) {
              return true;
            }
          }
          return smooth.at(at[0], at[1], at[2]) <= value;
        };
        if (value > lowest && below(1, 0, 0) && below(-1, 0, 0) && below(0, 1, 0) && below(0, -1, 0) &&
            below(0, 0, 1) && below(0, 0, -1)) {
          out.push_back({smooth.point_mm(Vector3d(i, j, k)), value});
        }
      }
    }
  }
  std::stable_sort(out.begin(), out.end(), [](const Maximum &a, const Maximum &b) { return a.value > b.value; });
  Maxima found;
  for (const Maximum &m : out) {
    const auto near = std::find_if(found.kept.begin(), found.kept.end(),
                                   [&](const Maximum &k) { return (k.at_mm - m.at_mm).norm() < 2.0 * radius_mm; });
    if (near == found.kept.end()) {
      found.kept.push_back(m);
    } else if (m.value - floor > kCrowded * (near->value - floor) && (near->at_mm - m.at_mm).norm() > radius_mm) {
      found.crowded_mm.push_back(m.at_mm);
    }
  }
  return found;
}

// Centroid of what rises above the background, in a window that follows it.
Vector3d centroid(const Volume &image, Vector3d centre_mm, float background, double radius_mm) {
  constexpr int kRounds = 15;
  for (int round = 0; round < kRounds; ++round) {
    double sum = 0.0;
    Vector3d moment = Vector3d::Zero();
    around(image, centre_mm, radius_mm, [&](const Vector3d &at, float value, double distance) {
      const double inside = std::min(1.0, (radius_mm - distance) / kWindowEdge_mm);
      const double height = inside * std::max(0.0, static_cast<double>(value - background));
      sum += height;
      moment += height * at;
    });
    if (!(sum > 0.0)) {
      break;
    }
    const Vector3d step = moment / sum - centre_mm;
    centre_mm += step;
    if (step.norm() < 1e-3) {
      break;
    }
  }
  return centre_mm;
}

// Less than a marker's radius within the image: the border cuts what is there.
bool at_border(const Volume &image, const Vector3d &mm, double radius_mm) {
  const Vector3d index = image.axes().inverse() * (mm - image.origin_mm());
  const Vector3d spacing = image.spacing_mm();
  for (std::size_t d = 0; d < 3; ++d) {
    const auto D = static_cast<Index>(d);
    const double margin = std::max(0.5, radius_mm / spacing[D] - 0.5); // voxels reach half a voxel beyond their centre
    if (index[D] < margin || index[D] > image.size[d] - 1.0 - margin) {
      return true;
    }
  }
  return false;
}

std::string check(const Volume &image, const MarkerOptions &options) {
  if (!(options.marker_mm > 0.0) || !(options.min_height > 0.0)) {
    return "markers of " + std::to_string(options.marker_mm) + " mm or a height of " +
           std::to_string(options.min_height) + " are out of range";
  }
  const bool finite = std::all_of(image.voxels.begin(), image.voxels.end(), [](float v) { return std::isfinite(v); });
  return finite && !image.voxels.empty() && image.voxels.size() == image.pixels() ? ""
                                                                                  : "a voxel is missing or not finite";
}

Points3 as_columns(const std::vector<Vector3d> &list) {
  Points3 out(3, static_cast<Index>(list.size()));
  for (std::size_t i = 0; i < list.size(); ++i) {
    out.col(static_cast<Index>(i)) = list[i];
  }
  return out;
}

} // namespace

tl::expected<MarkerPoints, std::string> find_marker_points(const Volume &image, const MarkerOptions &options) {
  if (const std::string problem = check(image, options); !problem.empty()) {
    return tl::unexpected(problem);
  }
  Volume smooth = image;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    smooth_along(smooth, axis, kSmoothing * options.marker_mm / image.spacing_mm()[static_cast<Index>(axis)]);
  }
  const float middle = median(smooth.voxels);
  std::vector<float> deviations = smooth.voxels;
  for (float &v : deviations) {
    v = std::abs(v - middle);
  }
  const float noise = 1.4826F * median(std::move(deviations));
  std::vector<Vector3d> separate, others, cut_off;
  const Maxima found =
      maxima(smooth, middle, middle + static_cast<float>(options.min_height) * noise, 0.5 * options.marker_mm);
  for (const Maximum &m : found.kept) {
    std::vector<float> shell;
    int bright = 0;
    around(smooth, m.at_mm, kShellOuter * options.marker_mm, [&](const Vector3d &, float value, double distance) {
      if (distance > kShellInner * options.marker_mm) {
        shell.push_back(value);
        bright += static_cast<double>(value - middle) > kShellBright * static_cast<double>(m.value - middle) ? 1 : 0;
      }
    });
    if (shell.empty() || bright > kMaxBrightShell * static_cast<double>(shell.size())) {
      others.push_back(m.at_mm);
      continue;
    }
    const Vector3d centre = centroid(image, m.at_mm, median(std::move(shell)), kWindow * options.marker_mm);
    (at_border(image, centre, 0.5 * options.marker_mm) ? cut_off : separate).push_back(centre);
  }
  if (separate.size() < static_cast<std::size_t>(std::max(0, options.min_points))) {
    return tl::unexpected(std::to_string(separate.size()) + " separate markers of " +
                          std::to_string(static_cast<int>(std::lround(options.marker_mm))) + " mm are seen, and " +
                          std::to_string(others.size()) + " larger bright places; a phantom has at least " +
                          std::to_string(options.min_points) + " markers");
  }
  return MarkerPoints{as_columns(separate), as_columns(others), as_columns(found.crowded_mm), as_columns(cut_off)};
}

} // namespace bregma::mri
