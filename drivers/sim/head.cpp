#include "drivers/sim/head.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "drivers/sim/random.hpp"

namespace bregma::sim {

namespace {

constexpr int kWaves = 64;
constexpr double kFingertip_mm = 4.0;

Vector3d any_perpendicular(const Vector3d &v) {
  return v.cross(std::abs(v.x()) < 0.7 ? Vector3d::UnitX() : Vector3d::UnitY()).normalized();
}

} // namespace

// A sum of waves with normal wave vectors has a Gaussian correlation (random Fourier features [Rahimi 2007]).
Head::Head(const surface::TriangleMesh &scalp, double sigma_mm, double correlation_mm, std::uint64_t seed)
    : surface_(scalp), centre_(surface_.centre_mm()), nose_(centre_), amplitude_(sigma_mm * std::sqrt(2.0 / kWaves)) {
  for (const auto &triangle : scalp.triangles) {
    for (int corner = 0; corner < 3; ++corner) {
      const auto &vertex = scalp.vertices_mm[static_cast<std::size_t>(triangle[corner])];
      radius_ = std::max(radius_, (vertex - centre_).norm());
      nose_ = vertex.y() > nose_.y() ? vertex : nose_;
    }
  }
  Random random(seed, "skin");
  waves_.reserve(kWaves);
  for (int i = 0; i < kWaves; ++i) {
    const Vector3d k = random.normal3(1.0 / correlation_mm);
    waves_.push_back({k, random.uniform(0.0, 2.0 * std::numbers::pi)});
  }
}

double Head::skin_error_mm(const Vector3d &on_scalp) const {
  double sum = 0.0;
  for (const Wave &wave : waves_) {
    sum += std::cos(wave.k.dot(on_scalp) + wave.phase);
  }
  return amplitude_ * sum;
}

Head::Skin Head::skin(const Vector3d &near) const {
  const auto on = surface_.closest(near);
  const Vector3d side = any_perpendicular(on.normal);
  const Vector3d other = on.normal.cross(side);
  Vector3d normal = on.normal;
  for (const Vector3d &offset : {side, other, Vector3d(-side), Vector3d(-other)}) {
    normal += surface_.closest(on.point_mm + kFingertip_mm * offset).normal;
  }
  normal = normal.norm() > 0.5 ? normal.normalized() : on.normal;
  return {on.point_mm + skin_error_mm(on.point_mm) * normal, normal};
}

bool Head::blocks(const Vector3d &from, const Vector3d &to) const {
  const Vector3d way = to - from;
  const double along = std::clamp((centre_ - from).dot(way) / way.squaredNorm(), 0.0, 1.0);
  if ((from + along * way - centre_).squaredNorm() > radius_ * radius_) {
    return false; // misses the sphere around the head, like nearly every line of sight
  }
  return surface_.segment_hits(from, to);
}

// Sphere tracing: a step of the distance to the surface cannot pass through it.
std::optional<Vector3d> Head::first_hit(const Vector3d &origin, const Vector3d &direction) const {
  const Vector3d to_centre = centre_ - origin;
  const double middle = to_centre.dot(direction);
  const double miss_squared = to_centre.squaredNorm() - middle * middle;
  if (middle < 0.0 || miss_squared > radius_ * radius_) {
    return std::nullopt;
  }
  const double half_chord = std::sqrt(radius_ * radius_ - miss_squared);
  double along = std::max(0.0, middle - half_chord);
  int triangle = -1;
  for (int step = 0; step < 200 && along <= middle + half_chord; ++step) {
    const Vector3d point = origin + along * direction;
    const auto on = triangle < 0 ? surface_.closest(point) : surface_.closest(point, triangle);
    if (on.distance_mm < 0.01) {
      return point;
    }
    triangle = on.triangle;
    along += on.distance_mm;
  }
  return std::nullopt;
}

} // namespace bregma::sim
