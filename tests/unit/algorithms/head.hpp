// A head for tests: a closed ellipsoid with a nose, 75 x 95 x 105 mm, in RAS; random fields and motions around it.
#pragma once

#include <random>
#include <vector>

#include "algorithms/geometry/pose_covariance.hpp"
#include "algorithms/surface/triangle_mesh.hpp"

namespace bregma::test {

using geometry::Matrix3d;
using geometry::Vector3d;

// Midpoint subdivisions of an icosahedron: 10 * 4^subdivisions + 2 vertices, 20 * 4^subdivisions triangles.
[[nodiscard]] surface::TriangleMesh make_sphere(int subdivisions, double radius_mm, const Vector3d &centre_mm);

inline const Vector3d kHeadCentre(0.0, -18.0, 8.0);
// The point on the head's smooth skin in this direction from its centre, before triangulation.
[[nodiscard]] Vector3d on_head(const Vector3d &direction);
[[nodiscard]] surface::TriangleMesh make_head(int subdivisions);

// A point of the mesh, uniform by area over the triangles whose centroid satisfies the condition.
struct SurfaceSpot {
  Vector3d point_mm;
  Vector3d normal;
};
template <class Condition>
[[nodiscard]] std::vector<SurfaceSpot> spots(const surface::TriangleMesh &mesh, std::size_t count, std::mt19937 &rng,
                                             Condition &&wanted) {
  std::vector<SurfaceSpot> out;
  std::vector<double> areas;
  std::vector<const Eigen::Vector3i *> kept;
  const auto vertex = [&](int i) -> const Vector3d & { return mesh.vertices_mm[static_cast<std::size_t>(i)]; };
  for (const Eigen::Vector3i &t : mesh.triangles) {
    if (wanted((vertex(t[0]) + vertex(t[1]) + vertex(t[2])) / 3.0)) {
      kept.push_back(&t);
      areas.push_back((vertex(t[1]) - vertex(t[0])).cross(vertex(t[2]) - vertex(t[0])).norm());
    }
  }
  std::discrete_distribution<std::size_t> pick(areas.begin(), areas.end());
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  while (out.size() < count) {
    const Eigen::Vector3i &t = *kept[pick(rng)];
    const double r = std::sqrt(unit(rng));
    const double s = unit(rng);
    const Vector3d ab = vertex(t[1]) - vertex(t[0]);
    const Vector3d ac = vertex(t[2]) - vertex(t[0]);
    out.push_back({vertex(t[0]) + r * (1.0 - s) * ab + r * s * ac, ab.cross(ac).normalized()});
  }
  return out;
}

[[nodiscard]] Vector3d normal_vector(std::mt19937 &rng, double sigma);
// A random error with this covariance. Computes the Cholesky factor each time, so for small tests only.
[[nodiscard]] Vector3d draw(std::mt19937 &rng, const Matrix3d &covariance);
// Covariance with lateral (x, y) and depth (z) standard deviations in a random orientation.
[[nodiscard]] Matrix3d random_anisotropic(std::mt19937 &rng, double lateral_mm, double depth_mm);
[[nodiscard]] Eigen::Quaterniond random_rotation(std::mt19937 &rng);

template <class Target, class Source> [[nodiscard]] geometry::Rigid3<Target, Source> random_pose(std::mt19937 &rng) {
  return {random_rotation(rng), normal_vector(rng, 100.0)};
}

// A smooth random field of unit variance and correlation exp(-d^2 / 2 l^2): random Fourier features.
class SmoothField {
public:
  SmoothField(std::mt19937 &rng, double length_mm);
  [[nodiscard]] double operator()(const Vector3d &point_mm) const;

private:
  std::vector<Vector3d> wave_;
  std::vector<double> phase_;
};

} // namespace bregma::test
