#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>

#include "algorithms/tissue/contact/probe_contact.hpp"
#include "algorithms/tissue/material/units.hpp"

namespace bregma::tissue {
namespace {

constexpr int kSurfaceSweeps = 8;  // Gauss-Seidel sweeps per step
constexpr float kNear_m = 0.5e-3F; // a point that is pushed out pushes a neighbour in by no more than this

} // namespace

SurfaceContact::SurfaceContact(const TetMesh &mesh, const TetBoundary &boundary, const Options &options)
    : mesh_(&mesh), boundary_(&boundary), options_(options) {
  for (const Eigen::Vector3i &t : boundary.triangles) {
    double max_edge = 0.0;
    for (int i = 0; i < 3; ++i) {
      const auto node = [&](int k) { return mesh.nodes_mm[static_cast<std::size_t>(t[k % 3])]; };
      max_edge = std::max(max_edge, (node(i) - node(i + 1)).norm());
    }
    divisions_.push_back(std::max(1, static_cast<int>(std::ceil(max_edge / options.spacing_mm))));
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
    // The centres of n^2 equal parts.
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

// Moves the point's nodes so that it is not inside the probe, or back when others have pushed it too far. Returns its
// depth (negative: its distance).
float SurfaceContact::push_out(const NodeMotion &nodes, const Point &point, Push &push) noexcept {
  Eigen::Vector3f p = Eigen::Vector3f::Zero();
  for (int i = 0; i < 3; ++i) {
    p += point.barycentric[i] * nodes.position_m(point.node[i]);
  }
  const ProbeDistance distance = probe_.distance(p);
  const float depth = -distance.signed_m;
  if (depth <= 0.0F && push.out_m <= 0.0F) {
    return depth;
  }
  Eigen::Vector3f velocity = Eigen::Vector3f::Zero();
  float mobility = 0.0F; // 1 / effective mass
  for (int i = 0; i < 3; ++i) {
    const auto node = static_cast<std::size_t>(point.node[i]);
    const NodeVector &v = nodes.velocity_m_s[node];
    velocity += point.barycentric[i] * Eigen::Vector3f(v.x, v.y, v.z);
    const Eigen::Vector3f &n = distance.normal;
    const NodeVector &free = nodes.inverse_mass_per_kg[node]; // along the normal, for the axes that are not fixed
    mobility += point.barycentric[i] * point.barycentric[i] *
                (free.x * n.x() * n.x() + free.y * n.y() * n.y() + free.z * n.z() * n.z());
  }
  if (mobility <= 0.0F) {
    return depth;
  }
  const float out = std::max(-push.out_m, depth);
  push.out_m += out;
  // Friction cancels the sliding in this step, up to Coulomb's limit.
  const float height = (p - probe_.tip_m).dot(probe_.shaft);
  Eigen::Vector3f slid = (velocity - probe_.velocity_m_s(height)) * nodes.step_s;
  slid -= slid.dot(distance.normal) * distance.normal;
  Eigen::Vector3f rubbed = push.aside_m - slid;
  const float max_rub = static_cast<float>(options_.friction) * push.out_m;
  if (const float length = rubbed.norm(); length > max_rub) {
    rubbed *= max_rub / length;
  }
  const Eigen::Vector3f impulse = (out * distance.normal + rubbed - push.aside_m) / mobility;
  push.aside_m = rubbed;
  for (int i = 0; i < 3; ++i) {
    const NodeVector &free = nodes.inverse_mass_per_kg[static_cast<std::size_t>(point.node[i])];
    nodes.move(point.node[i], point.barycentric[i] * impulse.cwiseProduct(Eigen::Vector3f(free.x, free.y, free.z)));
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
  // The first sweep finds the near points; the others use only those.
  near_points_.clear();
  for (const Point &point : points_) {
    Push push;
    const float depth = push_out(nodes, point, push);
    if (depth > -kNear_m) {
      near_points_.push_back({&point, push});
    }
    if (depth > deepest) {
      deepest = depth;
      touched = &point;
    }
  }
  for (int sweep = 1; sweep < kSurfaceSweeps; ++sweep) {
    for (NearPoint &near : near_points_) {
      (void)push_out(nodes, *near.point, near.push);
    }
  }
  if (touched == nullptr) {
    return;
  }
  const auto at_rest = [&](const Point &point) {
    Eigen::Vector3f rest = Eigen::Vector3f::Zero();
    for (int i = 0; i < 3; ++i) {
      rest += point.barycentric[i] * nodes.rest_m[static_cast<std::size_t>(point.node[i])];
    }
    return rest;
  };
  const auto moved = [&](const Point &point) {
    Eigen::Vector3f now = Eigen::Vector3f::Zero();
    for (int i = 0; i < 3; ++i) {
      now += point.barycentric[i] * nodes.position_m(point.node[i]);
    }
    return Eigen::Vector3f(now - at_rest(point));
  };
  float indentation_m = 0.0F;
  for (const NearPoint &near : near_points_) {
    if (near.push.out_m > 0.0F) {
      ++touching_;
      indentation_m = std::max(indentation_m, -moved(*near.point).dot(probe_.shaft));
    }
  }
  depth_mm_ = static_cast<double>(kMetreFloat * indentation_m);
  touched_rest_ = at_rest(*touched);
  touched_height_ = (touched_rest_ + moved(*touched) - probe_.tip_m).dot(probe_.shaft);
  touched_tetrahedron_ = boundary_->tetrahedron[static_cast<std::size_t>(touched->triangle)];
}

} // namespace bregma::tissue
