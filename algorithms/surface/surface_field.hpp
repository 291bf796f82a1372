// The neighbourhood of a surface, prepared once, so that a registration does not search it again in every iteration.
//
// Two grids over the surface:
// - Everywhere: the tangent plane at the point closest to a voxel's centre, for point-to-plane steps while the pose is
//   still off. It is built by closest-point transport, exact within two voxels of the surface. Beyond, each voxel
//   chooses among its neighbours' triangles [Tsai 2002] [Bridson 2015, section 4.3], so that a far voxel may miss the
//   closest triangle slightly.
// - Near the surface: the triangles that can be closest to any point of a small voxel. They give exact closest points,
//   at a tenth of the cost of the tree.
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
  double spacing_mm = 4.0; // spacing of the planes
  double margin_mm = 40.0; // margin of the planes around the surface; beyond it the outermost planes are used
  double near_mm = 2.0;    // spacing of the exact lists
  double band_mm = 4.0;    // lists exist up to this distance from the surface; beyond it the tree is used
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

  // Exact: the result of SurfaceModel::closest.
  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &p) const noexcept;
  // Exact too, and fast for a point that moves little between queries: as long as it has moved by less than the margin
  // to all other triangles, only the previously closest triangle is evaluated.
  struct Nearby {
    Eigen::Vector3d at_mm = Eigen::Vector3d::Zero();
    int triangle = -1;      // the closest to at_mm; -1: none yet
    double others_mm = 0.0; // lower bound of the distance of all other triangles from at_mm
  };
  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &p, Nearby &known) const noexcept;
  // For many consecutive points: prefetches what later queries will read. First the list's index (some ten points
  // ahead), then the list (six), then its first triangles (three).
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
  // The triangles that can be closest to p, and the distance of p from the centre of their voxel; empty: too far away.
  struct Listed {
    std::span<const SurfaceModel::Candidate> candidates;
    double offset_mm = 0.0;
  };
  [[nodiscard]] Listed listed(const Eigen::Vector3d &p) const noexcept;
  // Index of the near voxel that contains p; negative: none.
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
  std::vector<std::uint32_t> begin_; // begin of each near voxel's list; it ends where the next one begins
  std::vector<SurfaceModel::Candidate> candidates_;
};

} // namespace bregma::surface
