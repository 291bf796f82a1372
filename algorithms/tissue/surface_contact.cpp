#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

#include "algorithms/tissue/probe_contact.hpp"
#include "algorithms/tissue/units.hpp"

namespace bregma::tissue {
namespace {

constexpr int kSurfaceSweeps = 4;  // of Gauss-Seidel in a step
constexpr float kNear_m = 0.5e-3F; // a point that is pushed out can push a neighbour in by no more

} // namespace

SurfaceContact::SurfaceContact(const TetMesh &mesh, const TetBoundary &boundary, const Options &options)
    : mesh_(&mesh), boundary_(&boundary), options_(options) {
  for (const Eigen::Vector3i &t : boundary.triangles) {
    double longest = 0.0;
    for (int i = 0; i < 3; ++i) {
      const auto node = [&](int k) { return mesh.nodes_mm[static_cast<std::size_t>(t[k % 3])]; };
      longest = std::max(longest, (node(i) - node(i + 1)).norm());
    }
    divisions_.push_back(std::max(1, static_cast<int>(std::ceil(longest / options.spacing_mm))));
  }
  near_.reserve(boundary.triangles.size());
  points_.reserve(static_cast<std::size_t>(options.capacity));
  near_points_.reserve(points_.capacity());
}

void SurfaceContact::search(const ExplicitSolver &solver) noexcept {
  near_.clear();
  points_.clear();
  const Eigen::Vector3d tip = (kMetreFloat * probe_.tip_m).cast<double>();
  const Eigen::Vector3d shaft = probe_.shaft.cast<double>();
  const auto position = [&](int node) -> Eigen::Vector3d {
    return mesh_->nodes_mm[static_cast<std::size_t>(node)] + solver.displacement_mm(node);
  };
  for (std::size_t i = 0; i < boundary_->triangles.size(); ++i) {
    const Eigen::Vector3i &t = boundary_->triangles[i];
    const Eigen::Vector3d a = position(t[0]);
    const Eigen::Vector3d middle = (a + position(t[1]) + position(t[2])) / 3.0;
    const double size = (a - middle).norm();
    const double height = std::max((middle - tip).dot(shaft), 0.0);
    const double distance =
        (middle - tip - height * shaft).norm() - size - static_cast<double>(kMetreFloat * probe_.radius_m);
    if (distance < options_.reach_mm) {
      near_.push_back({static_cast<float>(distance), static_cast<int>(i)});
    }
  }
  std::sort(near_.begin(), near_.end(), [](const Near &a, const Near &b) { return a.distance_mm < b.distance_mm; });
  for (const Near &near : near_) {
    const Eigen::Vector3i &t = boundary_->triangles[static_cast<std::size_t>(near.triangle)];
    const int n = divisions_[static_cast<std::size_t>(near.triangle)];
    if (points_.size() + static_cast<std::size_t>(n * n) > points_.capacity()) {
      return;
    }
    // The middles of n^2 equal parts.
    const float third = 1.0F / static_cast<float>(3 * n);
    for (int a = 0; a < n; ++a) {
      for (int b = 0; a + b < n; ++b) {
        const auto add = [&](int x, int y) {
          const float u = static_cast<float>(x) * third;
          const float v = static_cast<float>(y) * third;
          points_.push_back({near.triangle, {t[0], t[1], t[2]}, {1.0F - u - v, u, v}});
        };
        add(3 * a + 1, 3 * b + 1);
        if (a + b + 1 < n) {
          add(3 * a + 2, 3 * b + 2);
        }
      }
    }
  }
}

// Moves the point's nodes so that it is not inside the probe; how deep it was (negative: how far off).
float SurfaceContact::push_out(const NodeMotion &nodes, const Point &point) noexcept {
  Eigen::Vector3f p = Eigen::Vector3f::Zero();
  for (int i = 0; i < 3; ++i) {
    p += point.share[i] * nodes.position_m(point.node[i]);
  }
  const ProbeDistance distance = probe_.distance(p);
  const float depth = -distance.signed_m;
  if (depth <= 0.0F) {
    return depth;
  }
  Eigen::Vector3f velocity = Eigen::Vector3f::Zero();
  float mobility = 0.0F; // 1 / effective mass
  for (int i = 0; i < 3; ++i) {
    const auto node = static_cast<std::size_t>(point.node[i]);
    const NodeVector &v = nodes.velocity_m_s[node];
    velocity += point.share[i] * Eigen::Vector3f(v.x, v.y, v.z);
    mobility += point.share[i] * point.share[i] * nodes.inverse_mass_per_kg[node].x;
  }
  if (mobility <= 0.0F) {
    return depth;
  }
  Eigen::Vector3f way = depth * distance.normal;
  // Friction takes away what has slid in this step, up to Coulomb's share of what was pressed.
  const float height = (p - probe_.tip_m).dot(probe_.shaft);
  Eigen::Vector3f slid = (velocity - probe_.velocity_m_s(height)) * nodes.step_s;
  slid -= slid.dot(distance.normal) * distance.normal;
  const float length = slid.norm();
  if (length > 0.0F) {
    way -= std::min(1.0F, static_cast<float>(options_.friction) * depth / length) * slid;
  }
  const Eigen::Vector3f impulse = way / mobility;
  for (int i = 0; i < 3; ++i) {
    const float inverse_mass = nodes.inverse_mass_per_kg[static_cast<std::size_t>(point.node[i])].x;
    nodes.move(point.node[i], (point.share[i] * inverse_mass) * impulse);
  }
  force_N_ += impulse / (nodes.step_s * nodes.step_s);
  return depth;
}

void SurfaceContact::apply(const NodeMotion &nodes) noexcept {
  force_N_.setZero();
  touching_ = 0;
  if (!active_) {
    return;
  }
  const Point *touched = nullptr;
  float deepest = 0.0F;
  // The first sweep finds the points that are near; the others see those alone.
  near_points_.clear();
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const float depth = push_out(nodes, points_[i]);
    if (depth > -kNear_m) {
      near_points_.push_back(static_cast<std::uint32_t>(i));
    }
    touching_ += depth > 0.0F ? 1 : 0;
    if (depth > deepest) {
      deepest = depth;
      touched = &points_[i];
    }
  }
  for (int sweep = 1; sweep < kSurfaceSweeps; ++sweep) {
    for (const std::uint32_t i : near_points_) {
      (void)push_out(nodes, points_[i]);
    }
  }
  if (touched == nullptr) {
    return;
  }
  Eigen::Vector3f moved = Eigen::Vector3f::Zero();
  touched_rest_.setZero();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3f &rest = nodes.rest_m[static_cast<std::size_t>(touched->node[i])];
    touched_rest_ += touched->share[i] * rest;
    moved += touched->share[i] * (nodes.position_m(touched->node[i]) - rest);
  }
  depth_mm_ = static_cast<double>(-kMetreFloat * moved.dot(probe_.shaft));
  touched_tetrahedron_ = boundary_->tetrahedron[static_cast<std::size_t>(touched->triangle)];
}

} // namespace bregma::tissue
