#include "algorithms/intensity/similarity.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/intensity/joint_histogram.hpp"

namespace bregma::intensity {

namespace {

struct Range {
  float low = std::numeric_limits<float>::infinity();
  float high = -std::numeric_limits<float>::infinity();
  void take(float v) {
    low = std::min(low, v);
    high = std::max(high, v);
  }
  [[nodiscard]] std::size_t bin(float v, int bins) const {
    const double fraction = high > low ? static_cast<double>(v - low) / static_cast<double>(high - low) : 0.0;
    return static_cast<std::size_t>(std::min(static_cast<int>(fraction * bins), bins - 1));
  }
};

bool both(float a, float b) { return std::isfinite(a) && std::isfinite(b); }

} // namespace

double rmse(std::span<const float> a, std::span<const float> b) noexcept {
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t i = 0; a.size() == b.size() && i < a.size(); ++i) {
    if (both(a[i], b[i])) {
      const double difference = static_cast<double>(a[i]) - static_cast<double>(b[i]);
      sum += difference * difference;
      count += 1.0;
    }
  }
  return std::sqrt(sum / count); // 0 / 0 is NaN
}

double mutual_information(std::span<const float> a, std::span<const float> b, int bins) {
  Range of_a;
  Range of_b;
  std::size_t count = 0;
  for (std::size_t i = 0; a.size() == b.size() && i < a.size(); ++i) {
    if (both(a[i], b[i])) {
      of_a.take(a[i]);
      of_b.take(b[i]);
      ++count;
    }
  }
  if (count == 0 || bins < 1) {
    return geometry::kUnknown;
  }
  // In parts: a float counts single pixels up to 2^24 only.
  constexpr std::size_t kPart = std::size_t{1} << 22U;
  JointHistogram total(bins, bins);
  JointHistogram part(bins, bins);
  for (std::size_t first = 0; first < a.size(); first += kPart) {
    part.clear();
    for (std::size_t i = first; i < std::min(first + kPart, a.size()); ++i) {
      if (both(a[i], b[i])) {
        part.counts()[of_a.bin(a[i], bins) * static_cast<std::size_t>(bins) + of_b.bin(b[i], bins)] += 1.0F;
      }
    }
    total.add(part);
  }
  return std::max(total.summarise().mutual_information(), 0.0);
}

void restrict_to_overlap(std::initializer_list<std::vector<float> *> images) {
  const std::size_t size = images.size() == 0 ? 0 : (*images.begin())->size();
  if (std::any_of(images.begin(), images.end(), [&](const auto *image) { return image->size() != size; })) {
    throw std::invalid_argument("images of different size have no overlap");
  }
  for (std::size_t i = 0; i < size; ++i) {
    if (std::any_of(images.begin(), images.end(), [&](const auto *image) { return !std::isfinite((*image)[i]); })) {
      for (std::vector<float> *image : images) {
        (*image)[i] = std::numeric_limits<float>::quiet_NaN();
      }
    }
  }
}

} // namespace bregma::intensity
