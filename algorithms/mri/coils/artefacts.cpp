#include "algorithms/mri/coils/artefacts.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include <Eigen/Dense>
#include <opencv2/imgproc.hpp>

#include "algorithms/mri/coils/lost_signal.hpp"

namespace bregma::mri {

namespace {

using Eigen::Vector3d;

constexpr double kMinLostVolume_mm3 = 60.0; // a ball of 2.4 mm
constexpr double kEdge_mm = 3.0;            // over which the window falls to zero
// Of the variance of one scan, in the mean of two: noise averages, what sampling and pattern leave is the same.
constexpr double kOfTwoScans = 0.7;

struct Circle {
  int slice = 0;
  Vector3d centre_mm;
  double radius_mm = 0.0;
};

// Circles of one slice's lost signal, on an image of twice the resolution.
std::vector<Circle> circles_of(const LostSignal &lost, int slice, const ArtefactOptions &options) {
  cv::Mat large, bytes;
  cv::resize(lost.slice(slice), large, {}, 2.0, 2.0, cv::INTER_LINEAR);
  large.convertTo(bytes, CV_8U, 255.0);
  cv::GaussianBlur(bytes, bytes, {5, 5}, 1.0);
  const double pixel_mm = 0.5 * lost.grid().spacing_mm().head<2>().mean();
  std::vector<cv::Vec3f> found;
  cv::HoughCircles(bytes, found, cv::HOUGH_GRADIENT, 1.0, 2.0 * options.min_radius_mm / pixel_mm, 120.0, 9.0,
                   static_cast<int>(options.min_radius_mm / pixel_mm),
                   static_cast<int>(std::ceil(options.max_radius_mm / pixel_mm)));
  std::vector<Circle> out;
  for (const cv::Vec3f &c : found) {
    // Pixel i of the small image lies at 2 i + 0.5 of the large one.
    const double column = (static_cast<double>(c[0]) - 0.5) / 2.0;
    const double row = (static_cast<double>(c[1]) - 0.5) / 2.0;
    // A circle around a gap, or around noise, is not filled.
    if (lost.mean_within(slice, column, row, 0.7 * static_cast<double>(c[2]) / 2.0) >= options.min_lost) {
      out.push_back({slice, lost.grid().point_mm(Vector3d(column, row, slice)), static_cast<double>(c[2]) * pixel_mm});
    }
  }
  return out;
}

// Circles of one coil: near each other in space. Seeds are the largest circles.
std::vector<std::vector<Circle>> group(std::vector<Circle> circles, double thickness_mm, double window_mm) {
  std::stable_sort(circles.begin(), circles.end(),
                   [](const Circle &a, const Circle &b) { return a.radius_mm > b.radius_mm; });
  std::vector<std::vector<Circle>> out;
  while (!circles.empty()) {
    std::vector<Circle> one{circles.front()};
    Vector3d mean = one.front().centre_mm;
    for (int round = 0; round < 3; ++round) {
      std::vector<Circle> near;
      Vector3d sum = Vector3d::Zero();
      double weight = 0.0;
      for (const Circle &c : circles) {
        if ((c.centre_mm - mean).norm() < std::max(window_mm, thickness_mm)) {
          near.push_back(c);
          sum += c.radius_mm * c.radius_mm * c.centre_mm;
          weight += c.radius_mm * c.radius_mm;
        }
      }
      one = near;
      mean = sum / weight;
    }
    const auto taken = [&](const Circle &c) { return (c.centre_mm - mean).norm() < std::max(window_mm, thickness_mm); };
    const std::size_t before = circles.size();
    circles.erase(std::remove_if(circles.begin(), circles.end(), taken), circles.end());
    if (circles.size() == before) { // the mean has left its own seed behind
      circles.erase(circles.begin());
      continue;
    }
    out.push_back(std::move(one));
  }
  return out;
}

Vector3d mean_of_circles(const std::vector<Circle> &circles) {
  Vector3d sum = Vector3d::Zero();
  double areas = 0.0;
  for (const Circle &c : circles) {
    sum += c.radius_mm * c.radius_mm * c.centre_mm;
    areas += c.radius_mm * c.radius_mm;
  }
  return sum / areas;
}

struct SliceSum {
  double area_mm2 = 0.0;
  Vector3d moment = Vector3d::Zero(); // area times centroid
  double noise = 0.0;                 // sum of squared distances from the window's centre, for the covariance
};

// Lost signal of each slice within a ball around a centre.
std::vector<SliceSum> sum_slices(const LostSignal &lost, const Vector3d &centre_mm, double window_mm) {
  const auto &g = lost.grid();
  std::vector<SliceSum> out(static_cast<std::size_t>(g.size[2]));
  const Vector3d spacing = g.spacing_mm();
  const Vector3d index = g.axes().inverse() * (centre_mm - g.origin_mm());
  std::array<int, 3> low{}, high{};
  for (int d = 0; d < 3; ++d) {
    const auto D = static_cast<std::size_t>(d);
    low[D] = std::max(0, static_cast<int>(std::floor(index[d] - window_mm / spacing[d])));
    high[D] = std::min(g.size[D] - 1, static_cast<int>(std::ceil(index[d] + window_mm / spacing[d])));
  }
  const double pixel_mm2 = spacing.x() * spacing.y();
  for (int k = low[2]; k <= high[2]; ++k) {
    SliceSum &sum = out[static_cast<std::size_t>(k)];
    for (int j = low[1]; j <= high[1]; ++j) {
      for (int i = low[0]; i <= high[0]; ++i) {
        const Vector3d at = g.point_mm(Vector3d(i, j, k));
        const double inside = std::clamp((window_mm - (at - centre_mm).norm()) / kEdge_mm, 0.0, 1.0);
        const double part = inside * static_cast<double>(lost.at(i, j, k)) * pixel_mm2;
        sum.area_mm2 += part;
        sum.moment += part * at;
      }
    }
  }
  return out;
}

struct Located {
  Vector3d centre_mm;
  std::vector<SliceSum> slices;
  double volume_mm2 = 0.0; // sum of areas
};
// The window follows the centre until both agree, so that it cuts the artefact symmetrically.
Located locate(const LostSignal &lost, Vector3d centre_mm, double window_mm) {
  Located out;
  for (int round = 0; round < 12; ++round) {
    out.slices = sum_slices(lost, centre_mm, window_mm);
    Vector3d moment = Vector3d::Zero();
    out.volume_mm2 = 0.0;
    for (const SliceSum &s : out.slices) {
      moment += s.moment;
      out.volume_mm2 += s.area_mm2;
    }
    if (out.volume_mm2 <= 0.0) {
      break;
    }
    const Vector3d step = moment / out.volume_mm2 - centre_mm;
    centre_mm += step;
    if (step.norm() < 1e-3) {
      break;
    }
  }
  out.centre_mm = centre_mm;
  return out;
}

std::size_t largest_slice(const std::vector<SliceSum> &slices) {
  return static_cast<std::size_t>(
      std::max_element(slices.begin(), slices.end(),
                       [](const SliceSum &a, const SliceSum &b) { return a.area_mm2 < b.area_mm2; }) -
      slices.begin());
}

// Errors of a centre: a part of a pixel and of a slice that sampling, dephasing patterns and ripple leave, and noise.
// The parts were measured on simulated scans (./dev bench mri), and grow by the method.
Eigen::Matrix3d covariance_of(const LostSignal &lost, CoilMethod method, double volume_mm3, double window_mm) {
  const auto &g = lost.grid();
  const Vector3d spacing = g.spacing_mm();
  const bool single = method == CoilMethod::kSingleSlice;
  const double in_plane = single ? 0.35 : method == CoilMethod::kHoughCircles ? 0.25 : 0.10;
  const double through = single ? 1.0 : 0.15;
  // Noise of the relative loss moves the centroid by its first moment over the window.
  const double voxel = spacing.prod();
  const double ball = 4.0 / 3.0 * M_PI * std::pow(window_mm, 3);
  const double noise2 =
      std::pow(lost.relative_noise() / std::max(volume_mm3, 1.0), 2) * voxel * ball * 0.2 * window_mm * window_mm;
  Eigen::Matrix3d axes = g.axes();
  axes.colwise().normalize();
  const Vector3d variance(std::pow(in_plane * spacing.x(), 2) + noise2, std::pow(in_plane * spacing.y(), 2) + noise2,
                          std::pow(through * spacing.z(), 2) + noise2);
  return axes * variance.asDiagonal() * axes.transpose();
}

CoilArtefact measure(const LostSignal &lost, const std::vector<Circle> &circles, const ArtefactOptions &options) {
  const double window = std::max(options.window_mm, lost.grid().spacing_mm().z());
  const Vector3d start = mean_of_circles(circles);
  const Located at = locate(lost, start, window);
  const std::size_t middle = largest_slice(at.slices);
  CoilArtefact out;
  out.area_mm2 = at.slices[middle].area_mm2;
  out.volume_mm3 = at.volume_mm2 * lost.grid().spacing_mm().z();
  std::vector<int> numbers;
  for (const Circle &c : circles) {
    numbers.push_back(c.slice);
  }
  std::sort(numbers.begin(), numbers.end());
  out.slices = static_cast<int>(std::unique(numbers.begin(), numbers.end()) - numbers.begin());
  out.centre_mm = options.method == CoilMethod::kHoughCircles ? start
                  : options.method == CoilMethod::kSingleSlice
                      ? Vector3d(at.slices[middle].moment / std::max(1e-9, at.slices[middle].area_mm2))
                      : at.centre_mm;
  out.covariance = covariance_of(lost, options.method, out.volume_mm3, window);
  out.cut_off = std::max(at.slices.front().area_mm2, at.slices.back().area_mm2) > 0.3 * out.area_mm2;
  const Vector3d index = lost.grid().axes().inverse() * (at.centre_mm - lost.grid().origin_mm());
  for (int d = 0; d < 2; ++d) {
    const double margin = 0.5 * window / lost.grid().spacing_mm()[d];
    out.cut_off =
        out.cut_off || index[d] < margin || index[d] > lost.grid().size[static_cast<std::size_t>(d)] - 1 - margin;
  }
  return out;
}

} // namespace

struct ArtefactFinder::State {
  ArtefactOptions options;
  LostSignal lost;
  std::vector<std::vector<Circle>> circles; // of each slice
};

ArtefactFinder::ArtefactFinder(std::unique_ptr<State> state) : state_(std::move(state)) {}
ArtefactFinder::ArtefactFinder(ArtefactFinder &&) noexcept = default;
ArtefactFinder &ArtefactFinder::operator=(ArtefactFinder &&) noexcept = default;
ArtefactFinder::~ArtefactFinder() = default;

tl::expected<ArtefactFinder, std::string> ArtefactFinder::start(const Stack &background,
                                                                const ArtefactOptions &options) {
  auto lost = LostSignal::start(background, options);
  if (!lost) {
    return tl::make_unexpected(lost.error());
  }
  return ArtefactFinder(std::make_unique<State>(State{
      options, std::move(*lost), std::vector<std::vector<Circle>>(static_cast<std::size_t>(background.size[2]))}));
}

bool ArtefactFinder::add(int k, std::span<const float> foreground) {
  const image::Grid<3> &grid = state_->lost.grid();
  if (k < 0 || k >= grid.size[2] || foreground.size() != grid.pixels() / static_cast<std::size_t>(grid.size[2])) {
    return false;
  }
  state_->lost.add(k, foreground);
  if (state_->lost.volume_mm3(k) > 0.25 * kMinLostVolume_mm3) {
    state_->circles[static_cast<std::size_t>(k)] = circles_of(state_->lost, k, state_->options);
  }
  return true;
}

tl::expected<ArtefactSearch, std::string> ArtefactFinder::finish() const {
  const LostSignal &lost = state_->lost;
  const ArtefactOptions &options = state_->options;
  if (auto ok = lost.check(); !ok) {
    return tl::make_unexpected(ok.error());
  }
  std::vector<Circle> circles;
  for (const std::vector<Circle> &more : state_->circles) {
    circles.insert(circles.end(), more.begin(), more.end());
  }
  ArtefactSearch out;
  out.noise = lost.noise();
  out.signal = lost.signal();
  const double thickness = lost.grid().spacing_mm().z();
  const int needed = std::max(1, static_cast<int>(std::floor(4.5 / thickness)));
  for (const std::vector<Circle> &one : group(std::move(circles), thickness, 0.8 * options.window_mm)) {
    const CoilArtefact artefact = measure(lost, one, options);
    const bool known = std::any_of(out.artefacts.begin(), out.artefacts.end(), [&](const CoilArtefact &other) {
      return (other.centre_mm - artefact.centre_mm).norm() < 0.5 * options.window_mm;
    });
    if (!known && artefact.volume_mm3 >= kMinLostVolume_mm3 && (artefact.slices >= needed || artefact.cut_off)) {
      out.artefacts.push_back(artefact);
    }
  }
  std::stable_sort(out.artefacts.begin(), out.artefacts.end(),
                   [](const CoilArtefact &a, const CoilArtefact &b) { return a.volume_mm3 > b.volume_mm3; });
  return out;
}

tl::expected<ArtefactSearch, std::string> find_artefacts(const Stack &background, const Stack &foreground,
                                                         const ArtefactOptions &options) {
  if (background.size != foreground.size ||
      (background.T_image_index - foreground.T_image_index).cwiseAbs().maxCoeff() > 1e-3) {
    return tl::make_unexpected("background and foreground differ in size, spacing, position or orientation: scan both "
                               "with the same slices");
  }
  if (foreground.voxels.size() != foreground.pixels()) {
    return tl::make_unexpected("the stack has no pixels");
  }
  auto finder = ArtefactFinder::start(background, options);
  if (!finder) {
    return tl::make_unexpected(finder.error());
  }
  const std::size_t slice = foreground.pixels() / static_cast<std::size_t>(std::max(1, foreground.size[2]));
  for (int k = 0; k < foreground.size[2]; ++k) {
    finder->add(k, std::span(foreground.voxels).subspan(foreground.offset(0, 0, k), slice));
  }
  return finder->finish();
}

namespace {

const CoilArtefact *nearest(std::span<const CoilArtefact> list, const CoilArtefact &to) {
  const auto distance = [&](const CoilArtefact &a) { return (a.centre_mm - to.centre_mm).norm(); };
  const auto found = std::min_element(list.begin(), list.end(), [&](const CoilArtefact &a, const CoilArtefact &b) {
    return distance(a) < distance(b);
  });
  return found == list.end() ? nullptr : &*found;
}

// Of `one` and what the other scan shows of the same coil: each is the other's nearest, within the distance. Nothing
// where there is no such artefact.
std::optional<CoilArtefact> mean_with(const CoilArtefact &one, std::span<const CoilArtefact> ones,
                                      std::span<const CoilArtefact> others, double distance_mm) {
  const CoilArtefact *other = nearest(others, one);
  if (other == nullptr || nearest(ones, *other) != &one || (other->centre_mm - one.centre_mm).norm() > distance_mm) {
    return std::nullopt;
  }
  CoilArtefact out = one;
  out.centre_mm = 0.5 * (one.centre_mm + other->centre_mm);
  out.covariance = 0.5 * kOfTwoScans * (one.covariance + other->covariance);
  out.cut_off = one.cut_off || other->cut_off;
  return out;
}

} // namespace

std::vector<CoilArtefact> mean_of_polarities(std::span<const CoilArtefact> positive,
                                             std::span<const CoilArtefact> negative, double window_mm) {
  std::vector<CoilArtefact> out;
  for (const CoilArtefact &one : positive) {
    out.push_back(mean_with(one, positive, negative, 0.5 * window_mm).value_or(one));
  }
  return out;
}

std::vector<CoilArtefact> mean_of_read_outs(std::span<const CoilArtefact> forward,
                                            std::span<const CoilArtefact> reversed, double window_mm) {
  std::vector<CoilArtefact> out;
  for (const CoilArtefact &one : forward) {
    if (auto mean = mean_with(one, forward, reversed, window_mm)) {
      mean->b0_mm = one.centre_mm - mean->centre_mm;
      out.push_back(*mean);
    }
  }
  return out;
}

} // namespace bregma::mri
