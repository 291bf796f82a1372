#include "algorithms/tissue/contact/falx.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Cholesky>

#include "algorithms/surface/surface_model.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kMaxPlaneIterations = 30;
constexpr double kSettled = 1e-6; // rotation in rad or shift in mm: a smaller change moves no node in or out
// Layers of a body-centred lattice are half a cell apart, so that there is always one within this distance of a plane.
// A cell is 1.07 mean edges.
constexpr double kLayerEdges = 0.27;
// The corpus callosum begins about 35 mm behind the frontal pole and ends 60 mm before the occipital pole; the falx
// hangs to some 10 mm from it.
constexpr double kFrontDepth_mm = 25.0;
constexpr double kBackDepth_mm = 50.0;
// Angle above the horizontal through the brain's centre, seen from there: crista galli and inner occipital protuberance
// lie somewhat below it.
constexpr double kMinElevation_rad = -15.0 * std::numbers::pi / 180.0;

Vector3d mean(const std::vector<Vector3d> &points) {
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d &point : points) {
    sum += point;
  }
  return sum / static_cast<double>(points.size());
}

// Angle of a direction in the sagittal plane: 0 to the front, pi / 2 up, pi to the back, negative or above pi down.
double elevation_rad_of(const Vector3d &direction) {
  const double angle = std::atan2(direction.z(), direction.y());
  return angle < -0.5 * std::numbers::pi ? angle + 2.0 * std::numbers::pi : angle;
}

// Depth of the falx: narrow in front, wide behind.
double depth_mm(double elevation_rad) {
  return std::lerp(kFrontDepth_mm, kBackDepth_mm, std::clamp(elevation_rad / std::numbers::pi, 0.0, 1.0));
}

} // namespace

Plane symmetry_plane(const std::vector<Vector3d> &points_mm, const surface::SurfaceModel &surface,
                     const Vector3d &first_normal) {
  const Vector3d centre_mm = mean(points_mm);
  Plane plane(first_normal.normalized(), centre_mm);
  for (int iteration = 0; iteration < kMaxPlaneIterations; ++iteration) {
    Eigen::Matrix<double, 3, 2> aside; // directions in which the normal rotates
    aside.col(0) = plane.normal().unitOrthogonal();
    aside.col(1) = plane.normal().cross(aside.col(0));
    Matrix3d curvature = Matrix3d::Zero();
    Vector3d slope = Vector3d::Zero();
    for (const Vector3d &point_mm : points_mm) {
      const double before_mm = plane.signedDistance(point_mm);
      const surface::SurfacePoint closest = surface.closest(point_mm - 2.0 * before_mm * plane.normal());
      const double facing = closest.normal.dot(plane.normal());
      Vector3d row; // derivative of the signed distance by a rotation about the centre and by the offset
      row << -2.0 * aside.transpose() * (facing * (point_mm - centre_mm) + before_mm * closest.normal), -2.0 * facing;
      curvature += row * row.transpose();
      slope += row * closest.signed_mm;
    }
    const Vector3d step = -curvature.ldlt().solve(slope);
    const double offset_mm = plane.signedDistance(centre_mm) + step.z();
    plane.normal() = (plane.normal() + aside * step.head<2>()).normalized();
    plane.offset() = offset_mm - plane.normal().dot(centre_mm);
    if (!(step.norm() > kSettled)) {
      break;
    }
  }
  return plane;
}

Falx::Falx(const TetMesh &mesh, const TetBoundary &boundary, const surface::SurfaceModel &surface) {
  std::vector<Vector3d> surface_mm;
  surface_mm.reserve(boundary.nodes.size());
  for (const int node : boundary.nodes) {
    surface_mm.push_back(mesh.nodes_mm[static_cast<std::size_t>(node)]);
  }
  plane_ = symmetry_plane(surface_mm, surface, Vector3d::UnitX());
  const Vector3d middle_mm = mean(mesh.nodes_mm);
  const double layer_mm = kLayerEdges * mean_edge_mm(mesh);
  for (std::size_t i = 0; i < mesh.nodes_mm.size(); ++i) {
    const Vector3d &at_mm = mesh.nodes_mm[i];
    if (std::abs(plane_.signedDistance(at_mm)) > layer_mm) {
      continue;
    }
    const surface::SurfacePoint vault = surface.closest(at_mm);
    const double elevation_rad = elevation_rad_of(vault.point_mm - middle_mm);
    if (elevation_rad > kMinElevation_rad && elevation_rad < std::numbers::pi - kMinElevation_rad &&
        vault.distance_mm < depth_mm(elevation_rad)) {
      nodes_.push_back(static_cast<int>(i));
    }
  }
}

void Falx::apply(const NodeMotion &nodes) noexcept {
  const Eigen::Vector3f normal = plane_.normal().cast<float>();
  for (const int node : nodes_) {
    const NodeVector &u = nodes.displacement_m[static_cast<std::size_t>(node)];
    nodes.move(node, -normal.dot(Eigen::Vector3f(u.x, u.y, u.z)) * normal);
  }
}

} // namespace bregma::tissue
