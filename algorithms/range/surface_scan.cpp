#include "algorithms/range/surface_scan.hpp"

#include <cmath>
#include <stdexcept>

namespace bregma::range {

namespace {

// Position at a time, in records; NaN before the first one, or where a neighbour is not known.
Eigen::Vector2d position_at(std::span<const ScanRecord> records, double at) {
  if (!(at >= 0.0) || at > static_cast<double>(records.size() - 1)) {
    return Eigen::Vector2d::Constant(std::nan(""));
  }
  const auto before = static_cast<std::size_t>(at);
  const double part = at - static_cast<double>(before);
  const ScanRecord &a = records[before];
  const ScanRecord &b = records[part > 0.0 ? before + 1 : before];
  return {a.x_mm + part * (b.x_mm - a.x_mm), a.y_mm + part * (b.y_mm - a.y_mm)};
}

} // namespace

SurfaceScan surface_points(std::span<const ScanRecord> records, const ScanOptions &options) {
  if (!(options.period_ms > 0.0)) {
    throw std::invalid_argument("period_ms must be positive");
  }
  const double period_ns = 1e6 * options.period_ms;
  RangeChain chain(options.chain, options.curve);
  SurfaceScan out;
  for (std::size_t i = 0; i < records.size(); ++i) {
    out.missing += std::isnan(records[i].reading) ? 1 : 0;
    const auto time_ns = static_cast<std::int64_t>(std::llround(static_cast<double>(i) * period_ns));
    const auto value = chain.push({time_ns, records[i].reading});
    if (!value) {
      continue;
    }
    if (value->value < options.near_mm) {
      ++out.too_near;
      continue;
    }
    if (value->value > options.far_mm) {
      ++out.too_far;
      continue;
    }
    const double z = options.height_mm - value->value;
    if (z < options.lowest_mm) {
      ++out.too_low;
      continue;
    }
    const double at = options.at_newest ? static_cast<double>(i) : static_cast<double>(value->time_ns) / period_ns;
    const Eigen::Vector2d xy = position_at(records, at);
    if (!xy.allFinite()) {
      ++out.without_position;
      continue;
    }
    out.points_mm.emplace_back(xy.x(), xy.y(), z);
    out.newest.push_back(i);
    out.delay_ms += 1e-6 * static_cast<double>(value->delay_ns);
  }
  if (!out.points_mm.empty()) {
    out.delay_ms /= static_cast<double>(out.points_mm.size());
  }
  return out;
}

} // namespace bregma::range
