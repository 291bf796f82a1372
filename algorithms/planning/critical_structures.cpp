#include "algorithms/planning/critical_structures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/math/bv/OBBRSS.h>
#include <fcl/narrowphase/detail/gjk_solver_libccd.h>
#include <fcl/narrowphase/detail/traversal/distance/mesh_shape_distance_traversal_node.h>
#include <fcl/narrowphase/detail/traversal/traversal_recurse.h>
#include <fcl/narrowphase/distance.h>

#include "algorithms/geometry/unknown.hpp"
#include "algorithms/surface/surface_model.hpp"

namespace bregma::planning {

using Eigen::Vector3d;

namespace {

using Mesh = fcl::BVHModel<fcl::OBBRSSd>;
using Solver = fcl::detail::GJKSolver_libccdd;

// FCL measures between volumes: the tip is a sphere of negligible size.
constexpr double kTipRadius_mm = 1e-6;

std::shared_ptr<Mesh> to_fcl(const surface::TriangleMesh &mesh) {
  auto out = std::make_shared<Mesh>();
  out->beginModel(static_cast<int>(mesh.triangles.size()), static_cast<int>(mesh.vertices_mm.size()));
  std::vector<fcl::Triangle> triangles;
  triangles.reserve(mesh.triangles.size());
  for (const Eigen::Vector3i &t : mesh.triangles) {
    triangles.emplace_back(static_cast<std::size_t>(t[0]), static_cast<std::size_t>(t[1]),
                           static_cast<std::size_t>(t[2]));
  }
  out->addSubModel(mesh.vertices_mm, triangles);
  out->endModel();
  out->computeLocalAABB();
  return out;
}

} // namespace

struct CriticalStructures::Structure {
  explicit Structure(const NamedMesh &named) : name(named.name), surface(named.mesh), mesh(to_fcl(named.mesh)) {}

  // Lower bound of the distance: that to the box.
  [[nodiscard]] double box_distance_mm(const Vector3d &p) const noexcept {
    return (surface.low_mm() - p).cwiseMax(p - surface.high_mm()).cwiseMax(0.0).norm();
  }
  [[nodiscard]] bool contains(const Vector3d &p) const noexcept {
    return surface.is_closed() && box_distance_mm(p) == 0.0 && surface.closest(p).signed_mm < 0.0;
  }
  // Distance to the surface, if it is less than bound_mm.
  [[nodiscard]] double distance_mm(const Vector3d &p, double bound_mm) const noexcept;
  [[nodiscard]] StructurePoint surface_point(const Vector3d &p) const noexcept {
    const auto closest = surface.closest(p);
    const bool outside = closest.signed_mm > kTipRadius_mm;
    return {closest.point_mm, outside ? Vector3d((p - closest.point_mm).normalized()) : closest.normal};
  }

  std::string name;
  surface::SurfaceModel surface; // for inside and outside
  std::shared_ptr<Mesh> mesh;
};

CriticalStructures::CriticalStructures(const std::vector<NamedMesh> &structures) {
  for (const NamedMesh &named : structures) {
    try {
      structures_.push_back(std::make_unique<Structure>(named));
    } catch (const std::invalid_argument &wrong) {
      throw std::invalid_argument("critical structure " + named.name + ": " + wrong.what());
    }
  }
}
CriticalStructures::~CriticalStructures() = default;
CriticalStructures::CriticalStructures(CriticalStructures &&) noexcept = default;
CriticalStructures &CriticalStructures::operator=(CriticalStructures &&) noexcept = default;

// fcl::distance allocates while it fits a box around the tip. The traversal is therefore set up here, with the tip's
// sphere-swept box given. A prefilled result makes it skip all farther boxes.
double CriticalStructures::Structure::distance_mm(const Vector3d &p, double bound_mm) const noexcept {
  const fcl::Sphered tip(kTipRadius_mm);
  const Solver solver;
  fcl::DistanceResultd result(bound_mm);
  fcl::detail::MeshShapeDistanceTraversalNodeOBBRSS<fcl::Sphered, Solver> node;
  node.result = &result;
  node.model1 = mesh.get();
  node.model2 = &tip;
  node.vertices = mesh->vertices;
  node.tri_indices = mesh->tri_indices;
  node.nsolver = &solver;
  node.tf1.setIdentity();
  node.tf2.setIdentity();
  node.tf2.translation() = p;
  node.model2_bv.rss.axis.setIdentity();
  node.model2_bv.rss.To = p;
  node.model2_bv.rss.l[0] = 0.0;
  node.model2_bv.rss.l[1] = 0.0;
  node.model2_bv.rss.r = kTipRadius_mm;
  fcl::detail::distanceRecurse<double>(&node, 0, 0, nullptr);
  return std::max(result.min_distance, 0.0);
}

NearestStructure CriticalStructures::nearest(const Vector3d &tip_mm, Warm &warm) const noexcept {
  NearestStructure out{-1, geometry::kUnknown};
  if (structures_.empty() || !tip_mm.allFinite()) {
    return out;
  }
  const auto count = static_cast<int>(structures_.size());
  double best = std::numeric_limits<double>::max();
  const auto visit = [&](int index) {
    const Structure &structure = *structures_[static_cast<std::size_t>(index)];
    if (structure.box_distance_mm(tip_mm) >= best) {
      return;
    }
    const double distance = structure.contains(tip_mm) ? 0.0 : structure.distance_mm(tip_mm, best);
    if (distance < best) {
      best = distance;
      out.index = index;
    }
  };
  const bool known = warm.index >= 0 && warm.index < count;
  if (known) {
    // The distance to the previously nearest one cannot have grown by more than the tip has moved.
    best = (warm.distance_mm + (tip_mm - warm.tip_mm).norm()) * (1.0 + 1e-9) + 1e-6;
    visit(warm.index);
  }
  for (int i = 0; i < count; ++i) {
    if (!known || i != warm.index) {
      visit(i);
    }
  }
  out.distance_mm = best;
  warm = {out.index, best, tip_mm};
  return out;
}

StructurePoint CriticalStructures::surface_point(int index, const Vector3d &tip_mm) const noexcept {
  return structures_[static_cast<std::size_t>(index)]->surface_point(tip_mm);
}

std::vector<StructureClearance> CriticalStructures::path_clearance(const Vector3d &entry_mm,
                                                                   const Vector3d &target_mm) const {
  const Vector3d along = target_mm - entry_mm;
  const fcl::Capsuled line(kTipRadius_mm, along.norm());
  fcl::Transform3d at = fcl::Transform3d::Identity();
  if (along.norm() > 0.0) {
    at.linear() = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), along).toRotationMatrix();
  }
  at.translation() = 0.5 * (entry_mm + target_mm);
  std::vector<StructureClearance> out;
  for (std::size_t i = 0; i < structures_.size(); ++i) {
    const auto &structure = structures_[i];
    double distance = 0.0;
    if (!structure->contains(entry_mm) && !structure->surface.segment_hits(entry_mm, target_mm)) {
      fcl::DistanceResultd result;
      fcl::distance(structure->mesh.get(), fcl::Transform3d::Identity(), &line, at, fcl::DistanceRequestd(), result);
      distance = std::max(result.min_distance, 0.0);
    }
    out.push_back({static_cast<int>(i), structure->name, distance});
  }
  std::stable_sort(out.begin(), out.end(), [](const StructureClearance &a, const StructureClearance &b) {
    return a.distance_mm < b.distance_mm;
  });
  return out;
}

// The distance along the line may have several minima: samples find the smallest one, and golden sections refine it.
ClosestApproach CriticalStructures::closest_approach(int index, const Vector3d &entry_mm,
                                                     const Vector3d &target_mm) const {
  const Structure &structure = *structures_.at(static_cast<std::size_t>(index));
  constexpr double kStep_mm = 0.5;
  const auto signed_mm = [&](double fraction) {
    return structure.surface.closest(entry_mm + fraction * (target_mm - entry_mm)).signed_mm;
  };
  const int steps = std::max(static_cast<int>(std::ceil((target_mm - entry_mm).norm() / kStep_mm)), 1);
  int best = 0;
  double smallest = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= steps; ++i) {
    if (const double distance = signed_mm(static_cast<double>(i) / steps); distance < smallest) {
      smallest = distance;
      best = i;
    }
  }
  double low = std::max(best - 1, 0) / static_cast<double>(steps);
  double high = std::min(best + 1, steps) / static_cast<double>(steps);
  constexpr double kGolden = 0.6180339887498949;
  for (int i = 0; i < 9; ++i) {
    const double left = high - kGolden * (high - low);
    const double right = low + kGolden * (high - low);
    if (signed_mm(left) < signed_mm(right)) {
      high = right;
    } else {
      low = left;
    }
  }
  const double fraction = 0.5 * (low + high);
  return {fraction, structure.surface_point(entry_mm + fraction * (target_mm - entry_mm))};
}

std::size_t CriticalStructures::size() const noexcept { return structures_.size(); }

const std::string &CriticalStructures::name(int index) const {
  return structures_.at(static_cast<std::size_t>(index))->name;
}

} // namespace bregma::planning
