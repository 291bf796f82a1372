#include "server/runtime/histogram.hpp"

#include <algorithm>
#include <cmath>

namespace bregma::runtime {

double HistogramSnapshot::percentile_ns(double fraction) const noexcept {
  if (total == 0) {
    return 0.0;
  }
  // The smallest value that at least this fraction of the samples does not exceed.
  const double wanted = std::ceil(std::clamp(fraction, 0.0, 1.0) * static_cast<double>(total));
  const std::uint64_t rank = std::max<std::uint64_t>(1, static_cast<std::uint64_t>(wanted));
  std::uint64_t seen = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    seen += counts[i];
    if (seen >= rank) {
      return std::min(detail::value_of(i), static_cast<double>(max_ns));
    }
  }
  return static_cast<double>(max_ns);
}

HistogramSnapshot HistogramSnapshot::since(const HistogramSnapshot &earlier) const noexcept {
  HistogramSnapshot out;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    out.counts[i] = counts[i] - earlier.counts[i];
  }
  out.total = total - earlier.total;
  out.max_ns = max_ns;
  return out;
}

HistogramSnapshot Histogram::snapshot() const noexcept {
  HistogramSnapshot out;
  for (std::size_t i = 0; i < counts_.size(); ++i) {
    out.counts[i] = counts_[i].load(std::memory_order_relaxed);
    out.total += out.counts[i];
  }
  out.max_ns = max_ns_.load(std::memory_order_relaxed);
  return out;
}

} // namespace bregma::runtime
