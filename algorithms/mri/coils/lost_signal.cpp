#include "algorithms/mri/coils/lost_signal.hpp"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

namespace bregma::mri {

namespace {

constexpr double kDark = 0.25;     // of the signal: below it a pixel shows nothing
constexpr double kFloor = 0.15;    // losses below it are noise and movement
constexpr double kFull = 0.55;     // losses above it count as whole
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

cv::Mat disc(double diameter_mm, double pixel_mm) {
  const int n = std::max(3, 2 * static_cast<int>(std::ceil(0.5 * diameter_mm / pixel_mm)) + 1);
  return cv::getStructuringElement(cv::MORPH_RECT, {n, n});
}

// Part of the pixels with signal that have the highest value of the stack.
double saturated_part(const Stack &stack, double dark) {
  const float highest = *std::max_element(stack.voxels.begin(), stack.voxels.end());
  const auto with_signal =
      std::count_if(stack.voxels.begin(), stack.voxels.end(), [&](float v) { return static_cast<double>(v) > dark; });
  const auto at_highest = std::count(stack.voxels.begin(), stack.voxels.end(), highest);
  return static_cast<double>(at_highest) / static_cast<double>(std::max<std::ptrdiff_t>(1, with_signal));
}

std::string percent(double part) { return std::to_string(static_cast<int>(std::lround(100.0 * part))) + " %"; }

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

tl::expected<LostSignal, std::string> LostSignal::between(const Stack &background, const Stack &foreground,
                                                          const ArtefactOptions &options) {
  if (background.size != foreground.size ||
      (background.T_image_index - foreground.T_image_index).cwiseAbs().maxCoeff() > 1e-3) {
    return tl::make_unexpected("background and foreground differ in size, spacing, position or orientation: scan both "
                               "with the same slices");
  }
  if (background.voxels.empty() || background.voxels.size() != background.pixels() ||
      foreground.voxels.size() != foreground.pixels()) {
    return tl::make_unexpected("the stack has no pixels");
  }
  LostSignal out;
  out.signal_ = quantile(some_of(background.voxels), 0.9);
  if (!(out.signal_ > 0.0)) {
    return tl::make_unexpected("the background shows no signal");
  }
  const double dark = kDark * out.signal_;
  for (const auto &[stack, which] : {std::pair(&background, "background"), std::pair(&foreground, "foreground")}) {
    const double saturated = saturated_part(*stack, dark);
    if (saturated > options.max_saturated) {
      return tl::make_unexpected(std::string("the ") + which + " is saturated: " + percent(saturated) +
                                 " of its pixels have the highest value; lower the receiver's gain");
    }
  }

  std::vector<float> ratios, differences;
  for (std::size_t i = 0; i < background.voxels.size(); i += 7) {
    if (static_cast<double>(background.voxels[i]) > 2.0 * dark) {
      ratios.push_back(foreground.voxels[i] / background.voxels[i]);
      differences.push_back(background.voxels[i] - foreground.voxels[i]);
    }
  }
  if (ratios.size() < 100) {
    return tl::make_unexpected("the background shows no signal");
  }
  const double gain = quantile(ratios, 0.5);
  if (gain < 0.8 || gain > 1.25) {
    return tl::make_unexpected("the foreground is " + percent(gain) +
                               " as bright as the background: not the same protocol, or not the same scene");
  }
  const double middle = quantile(differences, 0.5);
  for (float &d : differences) {
    d = std::abs(d - static_cast<float>(middle));
  }
  out.noise_ = 1.4826 * quantile(differences, 0.5);

  static_cast<image::Grid<3> &>(out.values_) = background;
  out.values_.voxels.resize(background.voxels.size());
  out.volumes_mm3_.resize(static_cast<std::size_t>(background.size[2]));
  const double pixel_mm = background.spacing_mm().head<2>().mean();
  const double voxel_mm3 = background.spacing_mm().prod();
  const cv::Mat around = disc(2.0 * kAround_mm, pixel_mm), hole = disc(kHole_mm, pixel_mm);
  const double blur_px = out.relative_noise() > 0.08 ? 1.0 : 0.0; // faint images: average before the threshold
  double lost_mm3 = 0.0, gained_mm3 = 0.0, shown_mm3 = 0.0;
  cv::Mat smooth, local, part, valid;
  for (int k = 0; k < background.size[2]; ++k) {
    const cv::Mat before = wrap(background, k), after = wrap(foreground, k);
    cv::blur(before, smooth, {3, 3});
    cv::dilate(smooth, local, around);
    part = before - after / gain;
    if (blur_px > 0.0) {
      cv::GaussianBlur(part, part, {}, blur_px);
    }
    cv::Mat lost = wrap(out.values_, k);
    double sum = 0.0;
    for (int j = 0; j < lost.rows; ++j) {
      const float *p = part.ptr<float>(j);
      const float *l = local.ptr<float>(j);
      float *o = lost.ptr<float>(j);
      for (int i = 0; i < lost.cols; ++i) {
        const double signal = static_cast<double>(l[i]);
        const double relative = signal > dark ? static_cast<double>(p[i]) / signal : 0.0;
        o[i] = static_cast<float>(std::clamp((relative - kFloor) / (kFull - kFloor), 0.0, 1.0));
        shown_mm3 += signal > dark ? voxel_mm3 : 0.0;
        gained_mm3 += relative < -options.min_lost ? voxel_mm3 : 0.0;
        lost_mm3 += relative > options.min_lost ? voxel_mm3 : 0.0;
      }
    }
    cv::morphologyEx(lost, smooth, cv::MORPH_CLOSE, hole); // plastic inside a coil has nothing to lose
    smooth.copyTo(lost);
    sum = cv::sum(lost)[0];
    out.volumes_mm3_[static_cast<std::size_t>(k)] = sum * voxel_mm3;
  }
  if (gained_mm3 > 2.0 * lost_mm3 && gained_mm3 > 300.0) {
    return tl::make_unexpected(
        "the foreground shows signal that the background lacks: background and foreground are exchanged");
  }
  if (lost_mm3 > options.max_lost_part * shown_mm3) {
    return tl::make_unexpected(percent(lost_mm3 / shown_mm3) +
                               " of the signal is lost: the two stacks do not show the same scene");
  }
  return out;
}

} // namespace bregma::mri
