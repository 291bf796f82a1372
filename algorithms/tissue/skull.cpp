#include "algorithms/tissue/skull.hpp"

#include <cmath>
#include <stdexcept>

#include "algorithms/registration/surface_model.hpp"
#include "algorithms/tissue/units.hpp"

namespace bregma::tissue {
namespace {

// A node that has slid less than this still has its own tangent plane before it: what a radius of 60 mm makes of it is
// below 0.02 mm. Beyond, the surface is asked.
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
  surface_ = std::make_unique<registration::SurfaceModel>(geometry::TriangleMesh{mesh.nodes_mm, boundary.triangles});
  for (const int node : boundary.nodes) {
    const Eigen::Vector3d &at = mesh.nodes_mm[static_cast<std::size_t>(node)];
    if (!open_at(at)) {
      const registration::SurfacePoint closest = surface_->closest(at);
      supports_.push_back({node, closest.normal.cast<float>()});
      triangle_.push_back(closest.triangle);
    }
  }
}

Skull::~Skull() = default;

bool Skull::open_at(const Eigen::Vector3d &rest_mm) const noexcept {
  return (rest_mm - options_.craniotomy.centre_mm).norm() < options_.craniotomy.radius_mm;
}

void Skull::hold(ExplicitSolver &solver) const {
  if (!options_.sliding) {
    for (const Support &support : supports_) {
      solver.fix(support.node);
    }
  }
}

void Skull::apply(const NodeMotion &nodes) noexcept {
  force_N_.setZero();
  if (!options_.sliding) {
    return;
  }
  const float gap = static_cast<float>(options_.gap_mm) / kMetreFloat;
  for (std::size_t i = 0; i < supports_.size(); ++i) {
    const Support &support = supports_[i];
    const auto node = static_cast<std::size_t>(support.node);
    const NodeVector &u = nodes.displacement_m[node];
    const Eigen::Vector3f moved(u.x, u.y, u.z);
    Eigen::Vector3f normal = support.normal;
    float beyond = normal.dot(moved);
    if (moved.squaredNorm() - beyond * beyond > kPlane_m * kPlane_m) {
      const Eigen::Vector3d at = kMetreFloat * nodes.position_m(support.node).cast<double>();
      const registration::SurfacePoint closest = surface_->closest(at, triangle_[i]);
      triangle_[i] = closest.triangle;
      if (open_at(closest.point_mm)) {
        continue; // it has slid into the opening
      }
      beyond = static_cast<float>(closest.signed_mm) / kMetreFloat;
      normal = closest.normal.cast<float>();
    }
    if (beyond > gap) {
      const Eigen::Vector3f back = (gap - beyond) * normal;
      nodes.move(support.node, back);
      const float inverse_mass = nodes.inverse_mass_per_kg[node].x;
      force_N_ += back * (inverse_mass > 0.0F ? 1.0F / (inverse_mass * nodes.step_s * nodes.step_s) : 0.0F);
    }
  }
}

} // namespace bregma::tissue
