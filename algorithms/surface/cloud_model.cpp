#include "algorithms/surface/cloud_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

namespace bregma::surface {

using Eigen::Vector3d;

namespace {
constexpr std::size_t kBucket = 8;        // ranges up to this size are searched linearly
constexpr std::size_t kMaxTreeDepth = 64; // median splits of up to 2^64 points
} // namespace

CloudModel::CloudModel(std::span<const Vector3d> points_mm, std::span<const Vector3d> normals)
    : points_(points_mm.begin(), points_mm.end()), side_(points_mm.size()), index_(points_mm.size()) {
  if (points_mm.empty()) {
    throw std::invalid_argument("the cloud has no points");
  }
  if (!normals.empty() && normals.size() != points_mm.size()) {
    throw std::invalid_argument("the cloud has " + std::to_string(points_mm.size()) + " points, but " +
                                std::to_string(normals.size()) + " normals");
  }
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    if (!points_mm[i].allFinite()) {
      throw std::invalid_argument("point " + std::to_string(i) + " of the cloud is not finite");
    }
    if (!normals.empty() && !(normals[i].norm() > 0.0 && normals[i].allFinite())) {
      throw std::invalid_argument("normal " + std::to_string(i) + " of the cloud has no direction");
    }
  }
  std::iota(index_.begin(), index_.end(), 0);
  const auto split = [&](const auto &self, std::size_t begin, std::size_t end) -> void {
    if (end - begin <= kBucket) {
      return;
    }
    Vector3d low = points_mm[static_cast<std::size_t>(index_[begin])];
    Vector3d high = low;
    for (std::size_t i = begin; i < end; ++i) {
      low = low.cwiseMin(points_mm[static_cast<std::size_t>(index_[i])]);
      high = high.cwiseMax(points_mm[static_cast<std::size_t>(index_[i])]);
    }
    Eigen::Index side = 0;
    (high - low).maxCoeff(&side);
    const std::size_t middle = begin + (end - begin) / 2;
    const auto at = [&](std::size_t i) { return index_.begin() + static_cast<std::ptrdiff_t>(i); };
    std::nth_element(at(begin), at(middle), at(end), [&](int a, int b) {
      return points_mm[static_cast<std::size_t>(a)][side] < points_mm[static_cast<std::size_t>(b)][side];
    });
    side_[middle] = static_cast<std::uint8_t>(side);
    self(self, begin, middle);
    self(self, middle + 1, end);
  };
  split(split, 0, index_.size());
  for (std::size_t i = 0; i < index_.size(); ++i) {
    points_[i] = points_mm[static_cast<std::size_t>(index_[i])];
    if (!normals.empty()) {
      normals_.push_back(normals[static_cast<std::size_t>(index_[i])].normalized());
    }
  }
}

SurfacePoint CloudModel::closest(const Vector3d &p) const noexcept {
  struct Waiting {
    std::size_t begin, end;
    double squared; // squared distance from the splitting plane
  };
  std::array<Waiting, kMaxTreeDepth> stack;
  std::size_t top = 0;
  stack[top++] = {0, points_.size(), 0.0};
  double best = std::numeric_limits<double>::infinity();
  std::size_t found = 0;
  const auto try_point = [&](std::size_t i) {
    const double d2 = (points_[i] - p).squaredNorm();
    if (d2 < best) {
      best = d2;
      found = i;
    }
  };
  while (top > 0) {
    auto [begin, end, squared] = stack[--top];
    if (squared >= best) {
      continue;
    }
    while (end - begin > kBucket) {
      const std::size_t middle = begin + (end - begin) / 2;
      try_point(middle);
      const double beyond = p[side_[middle]] - points_[middle][side_[middle]];
      if (beyond < 0.0) {
        stack[top++] = {middle + 1, end, beyond * beyond};
        end = middle;
      } else {
        stack[top++] = {begin, middle, beyond * beyond};
        begin = middle + 1;
      }
    }
    for (std::size_t i = begin; i < end; ++i) {
      try_point(i);
    }
  }
  SurfacePoint out;
  out.point_mm = points_[found];
  out.triangle = index_[found];
  out.distance_mm = std::sqrt(best);
  out.signed_mm = out.distance_mm;
  if (has_normals()) {
    out.normal = normals_[found];
    out.signed_mm = out.normal.dot(p - out.point_mm);
  }
  return out;
}

} // namespace bregma::surface
