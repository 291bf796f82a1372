#include "algorithms/surface/surface_field.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace bregma::surface {

using Eigen::Vector3d;
using Eigen::Vector3i;

namespace {

constexpr double kMaxVoxels = 5e7;
constexpr double kOnPlane_mm = 1e-6; // nearer than this, the surface's own normal is used
constexpr double kTransportBand = 2.0;
constexpr double kSecure_mm = 0.25; // margin to the next triangle

Vector3i voxels(const Vector3d &extent_mm, double spacing_mm) {
  const Eigen::Array3d count = (extent_mm.array() / spacing_mm).ceil().max(1.0);
  if (!(spacing_mm > 0.0) || !(count.prod() <= kMaxVoxels)) {
    throw std::invalid_argument("a field of " + std::to_string(spacing_mm) + " mm over a surface of " +
                                std::to_string(extent_mm.maxCoeff()) + " mm is too large");
  }
  return count.cast<int>();
}

} // namespace

SurfaceField::SurfaceField(const SurfaceModel &surface, const FieldOptions &options)
    : surface_(&surface), options_(options) {
  const Vector3d margin = Vector3d::Constant(options.margin_mm);
  size_ = voxels(surface.high_mm() - surface.low_mm() + 2.0 * margin, options.spacing_mm);
  low_ = (surface.low_mm() - margin).cast<float>();
  per_mm_ = static_cast<float>(1.0 / options.spacing_mm);
  const Vector3d band = Vector3d::Constant(options.band_mm);
  near_low_ = surface.low_mm() - band;
  near_size_ = voxels(surface.high_mm() - surface.low_mm() + 2.0 * band, options.near_mm);
  build_planes();
  build_lists();
}

void SurfaceField::build_planes() {
  const auto index = [this](int i, int j, int k) {
    const int number = i + size_.x() * (j + size_.y() * k);
    return static_cast<std::size_t>(number);
  };
  const double h = options_.spacing_mm;
  const auto centre = [&](int i, int j, int k) {
    return Vector3d(low_.cast<double>() + h * Vector3d(i + 0.5, j + 0.5, k + 0.5));
  };
  const std::size_t count = index(size_.x() - 1, size_.y() - 1, size_.z() - 1) + 1;
  planes_.resize(count);
  nearest_.assign(count, -1);
  std::vector<float> squared(count, std::numeric_limits<float>::infinity());
  const auto offer = [&](std::size_t voxel, const Vector3d &at, int triangle) {
    const double distance = surface_->closest_on(triangle, at).distance_mm;
    const auto d2 = static_cast<float>(distance * distance);
    if (d2 < squared[voxel]) {
      squared[voxel] = d2;
      nearest_[voxel] = triangle;
    }
  };

  for (int t = 0; t < static_cast<int>(surface_->triangle_count()); ++t) {
    const auto [low, high] = surface_->box(t);
    const Vector3d reach = Vector3d::Constant(kTransportBand * h);
    const Vector3i from = ((low - reach - low_.cast<double>()) / h).array().floor().cast<int>().max(0);
    const Vector3i to = ((high + reach - low_.cast<double>()) / h).array().floor().cast<int>();
    for (int k = from.z(); k <= std::min(to.z(), size_.z() - 1); ++k) {
      for (int j = from.y(); j <= std::min(to.y(), size_.y() - 1); ++j) {
        for (int i = from.x(); i <= std::min(to.x(), size_.x() - 1); ++i) {
          offer(index(i, j, k), centre(i, j, k), t);
        }
      }
    }
  }

  // Fast sweeping: one pass in each of the eight diagonal directions propagates every triangle as far as it can be
  // closest.
  for (int direction = 0; direction < 8; ++direction) {
    const Vector3i step((direction & 1) != 0 ? -1 : 1, (direction & 2) != 0 ? -1 : 1, (direction & 4) != 0 ? -1 : 1);
    const auto at_step = [](int n, int size, int sign) { return sign > 0 ? n : size - 1 - n; };
    for (int n = 0; n < size_.z(); ++n) {
      const int k = at_step(n, size_.z(), step.z());
      for (int m = 0; m < size_.y(); ++m) {
        const int j = at_step(m, size_.y(), step.y());
        for (int l = 0; l < size_.x(); ++l) {
          const int i = at_step(l, size_.x(), step.x());
          const std::size_t voxel = index(i, j, k);
          const Vector3d at = centre(i, j, k);
          int last = nearest_[voxel];
          const auto take = [&](int a, int b, int c) {
            if (a < 0 || b < 0 || c < 0 || a >= size_.x() || b >= size_.y() || c >= size_.z()) {
              return;
            }
            const int triangle = nearest_[index(a, b, c)];
            if (triangle >= 0 && triangle != last) {
              offer(voxel, at, triangle);
              last = triangle;
            }
          };
          take(i - step.x(), j, k);
          take(i, j - step.y(), k);
          take(i, j, k - step.z());
        }
      }
    }
  }

  for (int k = 0; k < size_.z(); ++k) {
    for (int j = 0; j < size_.y(); ++j) {
      for (int i = 0; i < size_.x(); ++i) {
        const Vector3d at = centre(i, j, k);
        const SurfacePoint on = surface_->closest_on(nearest_[index(i, j, k)], at);
        const Vector3d normal = on.distance_mm > kOnPlane_mm ? Vector3d((at - on.point_mm) / on.signed_mm) : on.normal;
        planes_[index(i, j, k)] = {normal.cast<float>(), static_cast<float>(-normal.dot(on.point_mm))};
      }
    }
  }
}

// With r the half diagonal of a voxel and d the distance of its centre c, the triangle closest to a point p of the
// voxel is within |p - c| + d(p) <= 2 r + d of the centre.
void SurfaceField::build_lists() {
  const double half_diagonal = 0.5 * std::sqrt(3.0) * options_.near_mm;
  begin_.reserve(static_cast<std::size_t>(near_size_.prod()) + 1);
  std::vector<SurfaceModel::Candidate> list;
  for (int k = 0; k < near_size_.z(); ++k) {
    for (int j = 0; j < near_size_.y(); ++j) {
      for (int i = 0; i < near_size_.x(); ++i) {
        begin_.push_back(static_cast<std::uint32_t>(candidates_.size()));
        const Vector3d at = near_low_ + options_.near_mm * Vector3d(i + 0.5, j + 0.5, k + 0.5);
        const Plane &rough = plane(at.cast<float>());
        const double guess = std::abs(rough.normal.dot(at.cast<float>()) + rough.offset);
        if (guess > options_.band_mm + 2.0 * options_.spacing_mm) {
          continue;
        }
        const double distance = closest_from_planes(at).distance_mm;
        if (distance > options_.band_mm) {
          continue;
        }
        list.clear();
        surface_->each_within(at, distance + 2.0 * half_diagonal + kOnPlane_mm, [&](int triangle, double squared) {
          list.push_back({static_cast<float>(std::sqrt(squared)), triangle});
        });
        std::sort(list.begin(), list.end(),
                  [](const auto &a, const auto &b) { return a.from_place_mm < b.from_place_mm; });
        candidates_.insert(candidates_.end(), list.begin(), list.end());
      }
    }
  }
  begin_.push_back(static_cast<std::uint32_t>(candidates_.size()));
}

SurfacePoint SurfaceField::closest_from_planes(const Vector3d &p) const noexcept {
  return surface_->closest(p, nearest_[voxel_of(p.cast<float>())]);
}

std::ptrdiff_t SurfaceField::near_voxel_of(const Vector3d &p) const noexcept {
  const Eigen::Array3d at = (p - near_low_).array() * (1.0 / options_.near_mm);
  if (!((at >= 0.0).all() && (at < near_size_.array().cast<double>()).all())) {
    return -1;
  }
  const Vector3i voxel = at.cast<int>();
  const int number = voxel.x() + near_size_.x() * (voxel.y() + near_size_.y() * voxel.z());
  return number;
}

SurfaceField::Listed SurfaceField::listed(const Vector3d &p) const noexcept {
  const std::ptrdiff_t voxel = near_voxel_of(p);
  if (voxel < 0) {
    return {};
  }
  const auto index = static_cast<std::size_t>(voxel);
  const Eigen::Array3d at = (p - near_low_).array() * (1.0 / options_.near_mm);
  const double offset_mm = options_.near_mm * (at - at.floor() - 0.5).matrix().norm();
  return {{candidates_.data() + begin_[index], begin_[index + 1] - begin_[index]}, offset_mm};
}

void SurfaceField::prefetch(const Vector3d &p, const Nearby &known, Ahead what) const noexcept {
  if (known.triangle >= 0) {
    if (what == Ahead::kPlace) {
      surface_->prefetch(known.triangle);
    }
    return;
  }
  const std::ptrdiff_t voxel = near_voxel_of(p);
  if (voxel < 0) {
    return;
  }
  const std::uint32_t *begin = begin_.data() + voxel;
  if (what == Ahead::kPlace) {
    __builtin_prefetch(begin);
    return;
  }
  const SurfaceModel::Candidate *first = candidates_.data() + *begin;
  if (what == Ahead::kList) {
    __builtin_prefetch(first);
    __builtin_prefetch(first + 8);
    return;
  }
  constexpr std::ptrdiff_t kFirst = 6; // approximate number of triangles per query
  const SurfaceModel::Candidate *last = first + std::min<std::ptrdiff_t>(kFirst, begin[1] - begin[0]);
  for (; first != last; ++first) {
    surface_->prefetch(first->triangle);
  }
}

SurfacePoint SurfaceField::closest(const Vector3d &p) const noexcept {
  const auto [candidates, offset_mm] = listed(p);
  return candidates.empty() ? closest_from_planes(p) : surface_->closest_among(candidates, offset_mm, p);
}

SurfacePoint SurfaceField::closest(const Vector3d &p, Nearby &known) const noexcept {
  if (known.triangle >= 0) {
    SurfacePoint on = surface_->closest_on(known.triangle, p);
    if (on.distance_mm + (p - known.at_mm).norm() < known.others_mm) {
      return on;
    }
  }
  const auto [candidates, offset_mm] = listed(p);
  known.at_mm = p;
  known.others_mm = 0.0;
  SurfacePoint on = candidates.empty()
                        ? closest_from_planes(p)
                        : surface_->closest_among(candidates, offset_mm, p, &known.others_mm, kSecure_mm);
  known.triangle = on.triangle;
  return on;
}

} // namespace bregma::surface
