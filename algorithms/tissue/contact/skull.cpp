#include "algorithms/tissue/contact/skull.hpp"

#include <cmath>
#include <stdexcept>

#include <Eigen/Geometry>

#include "algorithms/surface/surface_model.hpp"
#include "algorithms/tissue/material/units.hpp"

namespace bregma::tissue {
namespace {

// A node keeps its tangent plane until it has slid this far from the point of tangency. The error at a radius of 60 mm
// is below 0.02 mm.
constexpr float kPlane_m = 1.5e-3F;

bool not_negative(double value) { return std::isfinite(value) && value >= 0.0; }

} // namespace

Skull::Skull(const TetMesh &mesh, const TetBoundary &boundary, const SkullOptions &options) : options_(options) {
  if (!not_negative(options.gap_mm)) {
    throw std::invalid_argument("skull: gap_mm = " + std::to_string(options.gap_mm) + ", must not be negative");
  }
  if (!not_negative(options.craniotomy.radius_mm)) {
    throw std::invalid_argument("craniotomy: radius_mm = " + std::to_string(options.craniotomy.radius_mm) +
                                ", must not be negative");
  }
  surface_ = std::make_unique<surface::SurfaceModel>(surface::TriangleMesh{mesh.nodes_mm, boundary.triangles});
  triangles_ = boundary.triangles;
  nodes_mm_ = mesh.nodes_mm;
  normals_.assign(mesh.nodes_mm.size(), Eigen::Vector3d::Zero());
  for (const int on_surface : boundary.nodes) {
    const auto node = static_cast<std::size_t>(on_surface);
    const surface::SurfacePoint closest = surface_->closest(mesh.nodes_mm[node]);
    normals_[node] = closest.normal;
    if (!open_at(mesh.nodes_mm[node])) {
      supports_.push_back({on_surface, closest.normal.cast<float>(), Eigen::Vector3f::Zero(), closest.triangle,
                           /*open=*/false});
    }
  }
}

Skull::~Skull() = default;

bool Skull::open_at(const Eigen::Vector3d &rest_mm) const noexcept {
  return (rest_mm - options_.craniotomy.centre_mm).norm() < options_.craniotomy.radius_mm;
}

void Skull::apply_supports(ExplicitSolver &solver) const {
  if (!options_.sliding) {
    for (const Support &support : supports_) {
      solver.fix(support.node);
    }
  }
}

// The plane through the closest point of the surface, with the interpolated normal of its triangle's corners. Normals
// of triangles would jump at every edge.
void Skull::find_plane(Support &support, const Eigen::Vector3d &rest_mm, const Eigen::Vector3d &now_mm) const noexcept {
  const surface::SurfacePoint closest = surface_->closest(now_mm, support.triangle);
  const Eigen::Vector3i &t = triangles_[static_cast<std::size_t>(closest.triangle)];
  const auto corner = [&](int i) -> const Eigen::Vector3d & { return nodes_mm_[static_cast<std::size_t>(t[i])]; };
  const Eigen::Vector3d area = (corner(1) - corner(0)).cross(corner(2) - corner(0));
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d opposite =
        (corner((i + 1) % 3) - closest.point_mm).cross(corner((i + 2) % 3) - closest.point_mm);
    normal += opposite.dot(area) * normals_[static_cast<std::size_t>(t[i])];
  }
  support.triangle = closest.triangle;
  support.at_m = to_metres(closest.point_mm - rest_mm);
  support.open = open_at(closest.point_mm);
  if (const double length = normal.norm(); length > 0.0) {
    support.normal = (normal / length).cast<float>();
  }
}

void Skull::apply(const NodeMotion &nodes) noexcept {
  force_N_.setZero();
  if (!options_.sliding) {
    return;
  }
  const float gap = static_cast<float>(options_.gap_mm) / kMetreFloat;
  for (Support &support : supports_) {
    const auto node = static_cast<std::size_t>(support.node);
    const NodeVector &u = nodes.displacement_m[node];
    const Eigen::Vector3f moved(u.x, u.y, u.z);
    const auto beyond = [&] { return support.normal.dot(moved - support.at_m); };
    if ((moved - support.at_m).squaredNorm() - beyond() * beyond() > kPlane_m * kPlane_m) {
      const Eigen::Vector3d &rest_mm = nodes_mm_[node];
      find_plane(support, rest_mm, rest_mm + (kMetreFloat * moved).cast<double>());
    }
    if (const float out = beyond() - gap; !support.open && out > 0.0F) {
      const Eigen::Vector3f back = -out * support.normal;
      nodes.move(support.node, back);
      const float inverse_mass = nodes.inverse_mass_per_kg[node].x;
      force_N_ += back * (inverse_mass > 0.0F ? 1.0F / (inverse_mass * nodes.step_s * nodes.step_s) : 0.0F);
    }
  }
}

} // namespace bregma::tissue
