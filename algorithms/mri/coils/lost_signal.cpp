#include "algorithms/mri/coils/lost_signal.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include <opencv2/imgproc.hpp>

namespace bregma::mri {

namespace {

constexpr double kDark = 0.25;      // of the signal: below it a pixel shows nothing
constexpr double kFloor = 0.15;     // losses below it are noise and movement
constexpr double kFull = 0.55;      // losses above it count as whole
constexpr int kFewestPixels = 1000; // with signal, of a stack
constexpr double kLeastGain = 0.1;
constexpr double kOddSlice = 0.5;  // of the other slices' brightness
constexpr double kHole_mm = 9.0;   // widest plastic inside a coil that is filled
constexpr double kAround_mm = 8.0; // where the brightest pixel states the local signal

double quantile(std::vector<float> values, double p) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(p * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return static_cast<double>(*at);
}

// An even selection of a stack's pixels, for quantiles.
std::vector<float> some_of(const std::vector<float> &voxels) {
  const std::size_t stride = std::max<std::size_t>(1, voxels.size() / 200000) | 1U;
  std::vector<float> out;
  for (std::size_t i = 0; i < voxels.size(); i += stride) {
    out.push_back(voxels[i]);
  }
  return out;
}

cv::Mat wrap(const Stack &stack, int k) {
  // OpenCV has no Mat of const pixels; nothing here writes to it.
  return {stack.size[1], stack.size[0], CV_32F, const_cast<float *>(&stack.voxels[stack.offset(0, 0, k)])};
}

cv::Mat square(double diameter_mm, double pixel_mm) {
  const int n = std::max(3, 2 * static_cast<int>(std::ceil(0.5 * diameter_mm / pixel_mm)) + 1);
  return cv::getStructuringElement(cv::MORPH_RECT, {n, n});
}

std::string percent(double part) { return std::to_string(static_cast<int>(std::lround(100.0 * part))) + " %"; }
std::string saturation_text(const char *which, double part) {
  return std::string("the ") + which + " is saturated: " + percent(part) +
         " of its pixels have the highest value; lower the receiver's gain";
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

} // namespace

cv::Mat LostSignal::slice(int k) const { return wrap(values_, k); }

double LostSignal::mean_within(int k, double column, double row, double radius_px) const {
  double sum = 0.0;
  int n = 0;
  const int reach = static_cast<int>(std::ceil(radius_px));
  const int c = static_cast<int>(std::lround(column));
  const int r = static_cast<int>(std::lround(row));
  for (int j = std::max(0, r - reach); j <= std::min(values_.size[1] - 1, r + reach); ++j) {
    for (int i = std::max(0, c - reach); i <= std::min(values_.size[0] - 1, c + reach); ++i) {
      if (std::hypot(i - column, j - row) <= radius_px) {
        sum += static_cast<double>(values_.at(i, j, k));
        ++n;
      }
    }
  }
  return n > 0 ? sum / n : 0.0;
}

double LostSignal::noise() const { return noises_.empty() ? 0.0 : median(noises_); }

tl::expected<LostSignal, std::string> LostSignal::start(const Stack &background, const ArtefactOptions &options) {
  if (background.voxels.empty() || background.voxels.size() != background.pixels()) {
    return tl::make_unexpected("the stack has no pixels");
  }
  LostSignal out;
  out.background_ = &background;
  out.options_ = options;
  out.signal_ = quantile(some_of(background.voxels), 0.9);
  const double dark = kDark * out.signal_;
  const auto with_signal = std::count_if(background.voxels.begin(), background.voxels.end(),
                                         [&](float v) { return static_cast<double>(v) > dark; });
  if (!(out.signal_ > 0.0) || with_signal < kFewestPixels) {
    return tl::make_unexpected("the background shows no signal");
  }
  const float highest = *std::max_element(background.voxels.begin(), background.voxels.end());
  const double part = static_cast<double>(std::count(background.voxels.begin(), background.voxels.end(), highest)) /
                      static_cast<double>(with_signal);
  if (part > options.max_saturated) {
    return tl::make_unexpected(saturation_text("background", part));
  }
  static_cast<image::Grid<3> &>(out.values_) = background;
  out.values_.voxels.assign(background.voxels.size(), 0.0F);
  out.volumes_mm3_.assign(static_cast<std::size_t>(background.size[2]), 0.0);
  out.gains_.assign(static_cast<std::size_t>(background.size[2]), 0.0);
  out.added_.assign(static_cast<std::size_t>(background.size[2]), false);
  return out;
}

void LostSignal::add(int k, std::span<const float> foreground) {
  const double dark = kDark * signal_;
  const std::size_t first = values_.offset(0, 0, k);
  std::vector<float> ratios, differences;
  for (std::size_t i = 0; i < foreground.size(); i += 5) {
    const float before = background_->voxels[first + i];
    if (static_cast<double>(before) > 2.0 * dark) {
      ratios.push_back(foreground[i] / before);
      differences.push_back(before - foreground[i]);
    }
  }
  double gain = 1.0, noise = 0.0;
  if (ratios.size() > 50) { // otherwise a slice beside the water
    gain = std::max(kLeastGain, quantile(ratios, 0.5));
    const auto middle = static_cast<float>(quantile(differences, 0.5));
    for (float &d : differences) {
      d = std::abs(d - middle);
    }
    noise = 1.4826 * quantile(differences, 0.5);
    gains_[static_cast<std::size_t>(k)] = gain;
    noises_.push_back(noise);
  }
  for (const float v : foreground) {
    const auto value = static_cast<double>(v);
    shown_pixels_ += value > dark ? 1.0 : 0.0;
    if (value > highest_) {
      highest_ = value;
      at_highest_ = 0.0;
    }
    at_highest_ += value == highest_ ? 1.0 : 0.0;
  }

  const double pixel_mm = values_.spacing_mm().head<2>().mean();
  const double voxel_mm3 = values_.spacing_mm().prod();
  const cv::Mat before = wrap(*background_, k);
  // OpenCV has no Mat of const pixels; nothing here writes to it.
  const cv::Mat after(before.rows, before.cols, CV_32F, const_cast<float *>(foreground.data()));
  cv::Mat smooth, local, part;
  cv::blur(before, smooth, {3, 3});
  cv::dilate(smooth, local, square(2.0 * kAround_mm, pixel_mm));
  part = before - after / gain;
  if (noise > 0.08 * signal_) { // a faint image: average before the threshold
    cv::GaussianBlur(part, part, {}, 1.0);
  }
  cv::Mat lost = wrap(values_, k);
  for (int j = 0; j < lost.rows; ++j) {
    const float *p = part.ptr<float>(j);
    const float *l = local.ptr<float>(j);
    float *o = lost.ptr<float>(j);
    for (int i = 0; i < lost.cols; ++i) {
      const double signal = static_cast<double>(l[i]);
      const double relative = signal > dark ? static_cast<double>(p[i]) / signal : 0.0;
      o[i] = static_cast<float>(std::clamp((relative - kFloor) / (kFull - kFloor), 0.0, 1.0));
      shown_mm3_ += signal > dark ? voxel_mm3 : 0.0;
      gained_mm3_ += relative < -options_.min_lost ? voxel_mm3 : 0.0;
      lost_mm3_ += relative > options_.min_lost ? voxel_mm3 : 0.0;
    }
  }
  cv::morphologyEx(lost, smooth, cv::MORPH_CLOSE, square(kHole_mm, pixel_mm)); // plastic in a coil has nothing to lose
  smooth.copyTo(lost);
  volumes_mm3_[static_cast<std::size_t>(k)] = cv::sum(lost)[0] * voxel_mm3;
  added_[static_cast<std::size_t>(k)] = true;
}

tl::expected<void, std::string> LostSignal::check() const {
  const auto missing = std::count(added_.begin(), added_.end(), false);
  if (missing > 0) {
    return tl::make_unexpected(std::to_string(missing) + " of " + std::to_string(added_.size()) +
                               " slices of the foreground are missing");
  }
  std::vector<double> seen;
  std::copy_if(gains_.begin(), gains_.end(), std::back_inserter(seen), [](double g) { return g > 0.0; });
  if (seen.empty()) {
    return tl::make_unexpected("the background shows no signal");
  }
  if (shown_pixels_ < kFewestPixels) {
    return tl::make_unexpected("the foreground shows no signal");
  }
  const double saturated = at_highest_ / shown_pixels_;
  if (saturated > options_.max_saturated) {
    return tl::make_unexpected(saturation_text("foreground", saturated));
  }
  const double gain = median(seen);
  // No coil spoils half of a slice. At the ends of the water a slice may be dark by a small movement.
  for (std::size_t k = 1; k + 1 < gains_.size(); ++k) {
    if (gains_[k - 1] > 0.0 && gains_[k] > 0.0 && gains_[k + 1] > 0.0 &&
        (gains_[k] < kOddSlice * gain || gain < kOddSlice * gains_[k])) {
      return tl::make_unexpected("slice " + std::to_string(k + 1) + " of the foreground is " + percent(gains_[k]) +
                                 " as bright as that of the background, the others " + percent(gain) +
                                 ": it is missing, or of another scan");
    }
  }
  if (gain < 0.8 || gain > 1.25) {
    return tl::make_unexpected("the foreground is " + percent(gain) +
                               " as bright as the background: not the same protocol, or not the same scene");
  }
  if (gained_mm3_ > 2.0 * lost_mm3_ && gained_mm3_ > 300.0) {
    return tl::make_unexpected(
        "the foreground shows signal that the background lacks: background and foreground are exchanged");
  }
  if (lost_mm3_ > options_.max_lost_part * shown_mm3_) {
    return tl::make_unexpected(percent(lost_mm3_ / shown_mm3_) +
                               " of the signal is lost: the two stacks do not show the same scene");
  }
  return {};
}

} // namespace bregma::mri
