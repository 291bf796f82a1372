// A surface's neighbourhood, prepared once so that a registration does not search it again in every iteration.
//
// Two grids over the surface:
// - everywhere, the tangent plane of the surface at the point closest to a voxel's centre: what point-to-plane steps
// need
//   while the pose is still off. Built by closest-point transport: exact within two voxels of the surface, from there
//   each voxel chooses among its neighbours' triangles (Tsai 2002; Bridson 2015, section 4.3), so that a far voxel may
//   miss the closest triangle by a little, never by more than its neighbours know.
// - near the surface, the triangles that can be closest to any point of a small voxel: exact closest points at a tenth
// of
//   the cost of the tree.
//
// Frame: that of the surface, mm. Const and thread-safe after construction; queries do not allocate or throw.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "algorithms/surface/plane_grid.hpp"
#include "algorithms/surface/surface_model.hpp"

namespace bregma::surface {

struct FieldOptions {
  double spacing_mm = 4.0; // of the planes
  double margin_mm = 40.0; // of the planes around the surface; beyond, the border's planes are used
  double near_mm = 2.0;    // spacing of the exact lists
  double band_mm = 4.0;    // distance from the surface up to which there are lists; beyond, the tree is asked
};

class SurfaceField {
public:
  // surface outlives the field. Throws std::invalid_argument for a spacing that is not positive or a grid of more than
  // 50 million voxels (a surface in the wrong unit).
  explicit SurfaceField(const SurfaceModel &surface, const FieldOptions &options = {});

  // Signed distance of p from the plane is normal . p + offset. The normal is the gradient of the distance at the
  // voxel's centre: a unit vector, outward.
  struct alignas(16) Plane {
    Eigen::Vector3f normal;
    float offset;
  };
  [[nodiscard]] const Plane &plane(const Eigen::Vector3f &p) const noexcept { return planes_[voxel_of(p)]; }

  [[nodiscard]] PlaneGrid grid() const noexcept {
    return {{low_.x(), low_.y(), low_.z()}, per_mm_, {size_.x(), size_.y(), size_.z()}, planes_.front().normal.data()};
  }

  // Exact: what SurfaceModel::closest answers.
  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &p) const noexcept;
  // Exact as well, and quick for a point that moves little from query to query: as long as it has moved by less than
  // all other triangles were farther away, only the one that was closest is looked at.
  struct Nearby {
    Eigen::Vector3d at_mm = Eigen::Vector3d::Zero();
    int triangle = -1;      // closest to at_mm; none yet
    double others_mm = 0.0; // no other triangle is nearer to at_mm
  };
  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &p, Nearby &known) const noexcept;
  // For many points one after another: what such a query will read is asked of the memory while others are answered.
  // First the list's place (some ten points ahead), then the list (six), then its first triangles (three).
  enum class Ahead { kPlace, kList, kTriangles };
  void prefetch(const Eigen::Vector3d &p, const Nearby &known, Ahead what) const noexcept;

  [[nodiscard]] const SurfaceModel &surface() const noexcept { return *surface_; }
  [[nodiscard]] double spacing_mm() const noexcept { return options_.spacing_mm; }

private:
  [[nodiscard]] std::size_t voxel_of(const Eigen::Vector3f &p) const noexcept {
    const auto clamped = [](float v, int n) {
      return static_cast<int>(std::min(std::max(v, 0.0F), static_cast<float>(n - 1)));
    };
    const Eigen::Vector3f at = (p - low_) * per_mm_;
    const int row = clamped(at.y(), size_.y()) + size_.y() * clamped(at.z(), size_.z());
    const int number = clamped(at.x(), size_.x()) + size_.x() * row; // no more than 50 million
    return static_cast<std::size_t>(number);
  }
  // The triangles that can be closest to p, and how far p is from the middle of their voxel; none: too far away.
  struct Listed {
    std::span<const SurfaceModel::Candidate> candidates;
    double offset_mm = 0.0;
  };
  [[nodiscard]] Listed listed(const Eigen::Vector3d &p) const noexcept;
  // Of the near voxel that holds p; negative where there is none.
  [[nodiscard]] std::ptrdiff_t near_voxel_of(const Eigen::Vector3d &p) const noexcept;
  // By the tree, from the triangle of the voxel.
  [[nodiscard]] SurfacePoint closest_from_planes(const Eigen::Vector3d &p) const noexcept;
  void build_planes();
  void build_lists();

  const SurfaceModel *surface_;
  FieldOptions options_;

  Eigen::Vector3f low_; // corner of the first voxel
  float per_mm_ = 1.0F;
  Eigen::Vector3i size_;
  std::vector<Plane> planes_;
  std::vector<int> nearest_; // triangle of each voxel of planes_

  Eigen::Vector3d near_low_;
  Eigen::Vector3i near_size_;
  std::vector<std::uint32_t> begin_; // of each near voxel's list; the next voxel's begin is its end
  std::vector<SurfaceModel::Candidate> candidates_;
};

} // namespace bregma::surface
