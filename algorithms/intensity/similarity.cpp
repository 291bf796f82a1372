#include "algorithms/intensity/similarity.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "algorithms/geometry/unknown.hpp"

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
  double count = 0.0;
  for (std::size_t i = 0; a.size() == b.size() && i < a.size(); ++i) {
    if (both(a[i], b[i])) {
      of_a.take(a[i]);
      of_b.take(b[i]);
      count += 1.0;
    }
  }
  if (count == 0.0 || bins < 1) {
    return geometry::kUnknown;
  }
  const auto n = static_cast<std::size_t>(bins);
  std::vector<double> joint(n * n, 0.0);
  std::vector<double> first(n, 0.0);
  std::vector<double> second(n, 0.0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (both(a[i], b[i])) {
      const std::size_t x = of_a.bin(a[i], bins);
      const std::size_t y = of_b.bin(b[i], bins);
      joint[x * n + y] += 1.0 / count;
      first[x] += 1.0 / count;
      second[y] += 1.0 / count;
    }
  }
  double sum = 0.0;
  for (std::size_t x = 0; x < n; ++x) {
    for (std::size_t y = 0; y < n; ++y) {
      const double p = joint[x * n + y];
      sum += p > 0.0 ? p * std::log(p / (first[x] * second[y])) : 0.0;
    }
  }
  return std::max(sum, 0.0);
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
