#include "algorithms/range/surface_scan.hpp"

#include <cmath>
#include <stdexcept>

#include <Eigen/Dense>

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

// Slope of the plane through the points around one of them; NaN where they do not determine it.
double slope_at(std::span<const Eigen::Vector3d> points, const Eigen::Vector3d &at, double radius_mm) {
  constexpr int kMinPoints = 5;
  constexpr double kMinSpread = 0.05; // smaller over larger variance of the places: below it they lie on a line
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
  int count = 0;
  for (const Eigen::Vector3d &p : points) {
    const Eigen::Vector3d offset = p - at;
    if (offset.head<2>().squaredNorm() <= radius_mm * radius_mm) {
      mean += offset;
      moments += offset * offset.transpose();
      ++count;
    }
  }
  if (count < kMinPoints) {
    return std::nan("");
  }
  mean /= count;
  moments = moments / count - mean * mean.transpose();
  const Eigen::Matrix2d places = moments.topLeftCorner<2, 2>();
  const Eigen::Vector2d spread = Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(places).eigenvalues();
  if (!(spread[0] > kMinSpread * spread[1])) {
    return std::nan("");
  }
  const Eigen::Vector2d gradient = places.inverse() * moments.topRightCorner<2, 1>();
  return std::atan(gradient.norm());
}

void leave_out_slopes(SurfaceScan &scan, const ScanOptions &options) {
  std::vector<bool> steep;
  for (const Eigen::Vector3d &p : scan.points_mm) {
    steep.push_back(slope_at(scan.points_mm, p, options.slope_radius_mm) > options.max_slope_rad);
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < steep.size(); ++i) {
    if (!steep[i]) {
      scan.points_mm[kept] = scan.points_mm[i];
      scan.newest[kept++] = scan.newest[i];
    }
  }
  scan.too_steep = steep.size() - kept;
  scan.points_mm.resize(kept);
  scan.newest.resize(kept);
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
  if (std::isfinite(options.max_slope_rad)) {
    leave_out_slopes(out, options);
  }
  return out;
}

} // namespace bregma::range
