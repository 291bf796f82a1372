#include "algorithms/uncertainty/error_metrics.hpp"

#include <cmath>

#include "algorithms/geometry/unknown.hpp"

namespace bregma::uncertainty {

namespace {

constexpr double kTool_mm = 100.0;

template <class Error>
double mean_of(const AnyPose &T, std::span<const Vector3d> source, std::span<const Vector3d> target, Error &&error) {
  if (source.empty() || source.size() != target.size()) {
    return geometry::kUnknown;
  }
  double sum = 0.0;
  for (std::size_t i = 0; i < source.size(); ++i) {
    sum += error(target[i] - T * source[i]);
  }
  return sum / static_cast<double>(source.size());
}

} // namespace

double rms_distance_mm(const AnyPose &T_target_source, std::span<const Vector3d> source_mm,
                       std::span<const Vector3d> target_mm) noexcept {
  return std::sqrt(mean_of(T_target_source, source_mm, target_mm, [](const Vector3d &e) { return e.squaredNorm(); }));
}

double out_of_plane_mean_error_mm(const AnyPose &T_target_source, std::span<const Vector3d> source_mm,
                                  std::span<const Vector3d> target_mm, const Vector3d &normal) noexcept {
  return mean_of(T_target_source, source_mm, target_mm, [&](const Vector3d &e) { return std::abs(normal.dot(e)); });
}

TenCentimetres ten_centimetre_error(const AnyPose &actual, const AnyPose &estimated) noexcept {
  TenCentimetres out;
  const Vector3d x = kTool_mm * Vector3d::UnitX();
  out.as_published_mm = (actual * x - estimated * x).norm() / std::sqrt(3.0);
  // |(R_a - R_e) u| = |(I - R_a' R_e) u|: the part of u normal to the axis rotates by the angle.
  const Vector3d turn = geometry::rotation_log(actual.rotation().conjugate() * estimated.rotation());
  out.angle_rad = turn.norm();
  out.worst_mm = 2.0 * kTool_mm * std::sin(0.5 * out.angle_rad);
  out.mean_mm = out.worst_mm * std::sqrt(2.0 / 3.0);
  out.worst_direction = turn.unitOrthogonal();
  return out;
}

} // namespace bregma::uncertainty
