// A cloud of points with normals, with fast queries for the nearest point: a kd-tree [Bentley 1975] [Friedman 1977],
// built once, in flat arrays. Queries are exact, const, thread-safe, and do not allocate or throw.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "algorithms/surface/surface_model.hpp"

namespace bregma::surface {

class CloudModel {
public:
  // normals: one per point, of any positive length, or empty (then only point-to-point is possible). Throws
  // std::invalid_argument with index and value: no points, a different count, a value that is not finite, a normal of
  // length zero.
  explicit CloudModel(std::span<const Eigen::Vector3d> points_mm, std::span<const Eigen::Vector3d> normals = {});

  // The nearest point. signed_mm is the distance from its tangent plane (from the point itself without normals);
  // triangle is its index.
  [[nodiscard]] SurfacePoint closest(const Eigen::Vector3d &point_mm) const noexcept;

  [[nodiscard]] bool has_normals() const noexcept { return !normals_.empty(); }
  [[nodiscard]] std::size_t count() const noexcept { return points_.size(); }

private:
  // The middle element of each range is its root; smaller coordinates are before it, larger ones after it.
  std::vector<Eigen::Vector3d> points_;
  std::vector<std::uint8_t> side_; // coordinate of the split at this point
  std::vector<int> index_;
  std::vector<Eigen::Vector3d> normals_; // in the order of points_
};

} // namespace bregma::surface
