#include "algorithms/intensity/joint_histogram.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "algorithms/intensity/cubic_spline.hpp"

namespace bregma::intensity {

namespace {

// First of the four columns of a Parzen window, and the cubic B-spline's weights from there.
struct Window {
  int first;
  float t; // position between the second and the third column, 0 to 1
};
Window window_of(float column, int columns) {
  const int second = std::clamp(static_cast<int>(column), 1, columns - 3);
  return {second - 1, std::clamp(column - static_cast<float>(second), 0.0F, 1.0F)};
}

// Sum of -p log p of counts that sum to `total`.
template <class Number> double entropy(std::span<const Number> counts, double total) {
  double sum = 0.0;
  for (const Number c : counts) {
    if (c > 0) {
      sum += static_cast<double>(c) * std::log(static_cast<double>(c));
    }
  }
  return std::log(total) - sum / total;
}

} // namespace

BinScale bin_scale(float low, float high, int bins, bool margin) {
  const int used = margin ? bins - 3 : bins - 1;
  return {low, high > low ? static_cast<float>(used) / (high - low) : 0.0F, margin ? 1.0F : 0.0F};
}

JointHistogram::JointHistogram(int rows, int columns)
    : rows_(rows), columns_(columns), counts_(static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns)),
      row_sum_(static_cast<std::size_t>(rows)), column_sum_(static_cast<std::size_t>(columns)) {}

void JointHistogram::clear() noexcept { std::fill(counts_.begin(), counts_.end(), 0.0F); }

void JointHistogram::add(const JointHistogram &other) noexcept {
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    counts_[i] += other.counts_[i];
  }
}

void JointHistogram::add_binned(std::span<const std::uint16_t> row, std::span<const float> column) noexcept {
  const auto columns = static_cast<std::size_t>(columns_);
  const auto last = static_cast<float>(columns_ - 1);
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (column[i] == column[i]) {
      const std::size_t bin = bin_at(std::clamp(column[i], 0.0F, last));
      counts_[row[i] * columns + bin] += 1.0F;
    }
  }
}

void JointHistogram::add_parzen(std::span<const std::uint16_t> row, std::span<const float> column) noexcept {
  const auto columns = static_cast<std::size_t>(columns_);
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (column[i] == column[i]) {
      const Window window = window_of(column[i], columns_);
      const std::array<float, 4> w = spline_weights(window.t);
      float *bins = counts_.data() + row[i] * columns + static_cast<std::size_t>(window.first);
      for (std::size_t k = 0; k < 4; ++k) {
        bins[k] += w[k];
      }
    }
  }
}

const Entropies &JointHistogram::summarise() noexcept {
  const auto columns = static_cast<std::size_t>(columns_);
  std::fill(column_sum_.begin(), column_sum_.end(), 0.0);
  double total = 0.0;
  for (std::size_t r = 0; r < row_sum_.size(); ++r) {
    double sum = 0.0;
    for (std::size_t c = 0; c < columns; ++c) {
      const double count = static_cast<double>(counts_[r * columns + c]);
      sum += count;
      column_sum_[c] += count;
    }
    row_sum_[r] = sum;
    total += sum;
  }
  entropies_ = {};
  if (total > 0.0) {
    entropies_.samples = total;
    entropies_.reference = std::max(entropy<double>(row_sum_, total), 0.0);
    entropies_.floating = std::max(entropy<double>(column_sum_, total), 0.0);
    entropies_.joint = std::max(entropy<float>(counts_, total), 0.0);
  }
  return entropies_;
}

void JointHistogram::differentiate(bool normalised) noexcept {
  // d(-p log p) = -(log p + 1) dp. A sample's move keeps its row and the total, so constants and the reference's
  // entropy drop out. Bins without counts have no logarithm; no sample is in them.
  const auto columns = static_cast<std::size_t>(columns_);
  const Entropies &h = entropies_;
  if (!(h.samples > 0.0) || !(h.joint > 0.0)) {
    clear();
    return;
  }
  const double of_floating = normalised ? 1.0 / h.joint : 1.0;
  const double of_joint = normalised ? h.normalised() / h.joint : 1.0;
  for (double &sum : column_sum_) {
    sum = sum > 0.0 ? std::log(sum / h.samples) : 0.0;
  }
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    const double count = static_cast<double>(counts_[i]);
    counts_[i] =
        count > 0.0 ? static_cast<float>(
                          (of_joint * std::log(count / h.samples) - of_floating * column_sum_[i % columns]) / h.samples)
                    : 0.0F;
  }
}

void JointHistogram::parzen_slopes(std::span<const std::uint16_t> row, std::span<const float> column,
                                   std::span<float> slope) const noexcept {
  const auto columns = static_cast<std::size_t>(columns_);
  for (std::size_t i = 0; i < row.size(); ++i) {
    float sum = 0.0F;
    if (column[i] == column[i]) {
      const Window window = window_of(column[i], columns_);
      const std::array<float, 4> w = spline_slopes(window.t);
      const float *bins = counts_.data() + row[i] * columns + static_cast<std::size_t>(window.first);
      sum = w[0] * bins[0] + w[1] * bins[1] + w[2] * bins[2] + w[3] * bins[3];
    }
    slope[i] = sum;
  }
}

} // namespace bregma::intensity
