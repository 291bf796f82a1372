#include "algorithms/mri/field_table.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <random>

#include <Eigen/LU>

#include "algorithms/parallel/team.hpp"

namespace bregma::mri {

namespace {

using Eigen::Index;
using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr int kErrorCoarser = 3;
constexpr float kUnknownError = 999.0F;
constexpr int kInverseSteps = 40;
constexpr double kInverseStep_mm = 1e-4;

image::Grid<3> box_grid(const Vector3d &low, const Vector3d &high, double spacing_mm) {
  image::Grid<3> out;
  out.T_image_index.topLeftCorner<3, 3>() = spacing_mm * Eigen::Matrix3d::Identity();
  out.T_image_index.topRightCorner<3, 1>() = low;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto d = static_cast<Index>(axis);
    out.size[axis] = static_cast<int>(std::ceil((high[d] - low[d]) / spacing_mm)) + 1;
  }
  return out;
}

// Calls node(offset) for all nodes of a grid, in parts on all threads of the team.
template <class Node> void for_each_node(parallel::Team &team, const image::Grid<3> &grid, Node &&node) {
  constexpr std::size_t kPart = 256;
  std::atomic<std::size_t> next{0};
  const std::size_t count = grid.pixels();
  team.run([&](int) {
    for (std::size_t begin = next.fetch_add(kPart); begin < count; begin = next.fetch_add(kPart)) {
      for (std::size_t i = begin; i < std::min(begin + kPart, count); ++i) {
        node(i);
      }
    }
  });
}

// Trilinear weights at an index, clamped into the grid.
struct Cell {
  std::size_t corner = 0;
  std::array<std::size_t, 3> step{}; // to the next node along each axis; 0 at the border
  std::array<double, 3> fraction{};
  bool inside = true;
};
Cell cell_at(const image::Grid<3> &grid, const Vector3d &index) {
  Cell out;
  std::size_t stride = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double last = grid.size[axis] - 1;
    const double x = index[static_cast<Index>(axis)];
    const double clamped = std::clamp(x, 0.0, last);
    out.inside = out.inside && x > -1e-6 && x < last + 1e-6;
    const auto whole = std::min(static_cast<int>(clamped), std::max(grid.size[axis] - 2, 0));
    out.corner += stride * static_cast<std::size_t>(whole);
    out.step[axis] = grid.size[axis] > 1 ? stride : 0;
    out.fraction[axis] = clamped - whole;
    stride *= static_cast<std::size_t>(grid.size[axis]);
  }
  return out;
}

template <class Value, class Sum> Sum interpolate(const std::vector<Value> &values, const Cell &cell, Sum sum) {
  for (unsigned corner = 0; corner < 8; ++corner) {
    double weight = 1.0;
    std::size_t at = cell.corner;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const bool upper = ((corner >> axis) & 1U) != 0;
      weight *= upper ? cell.fraction[axis] : 1.0 - cell.fraction[axis];
      at += upper ? cell.step[axis] : 0;
    }
    if constexpr (std::is_same_v<Value, float>) {
      sum += weight * static_cast<double>(values[at]);
    } else {
      sum += weight * values[at].template cast<double>();
    }
  }
  return sum;
}

Vector3d transformed(const Matrix4d &T, const Vector3d &p) {
  return T.topLeftCorner<3, 3>() * p + T.topRightCorner<3, 1>();
}

} // namespace

FieldTable::FieldTable(const DistortionField &field, double spacing_mm, double margin_mm, int threads)
    : max_error_95_mm_(field.options().max_error_95_mm) {
  const auto &points = field.control_points_mm();
  const Vector3d low = points.rowwise().minCoeff().array() - margin_mm;
  const Vector3d high = points.rowwise().maxCoeff().array() + margin_mm;
  static_cast<image::Grid<3> &>(displacement_) = box_grid(low, high, spacing_mm);
  static_cast<image::Grid<3> &>(error_) = box_grid(low, high, kErrorCoarser * spacing_mm);
  displacement_.voxels.resize(displacement_.pixels());
  error_.voxels.resize(error_.pixels());
  parallel::Team team(std::max(threads, 1));
  for_each_node(team, displacement_, [&](std::size_t i) {
    const Vector3d p = displacement_.pixel_mm(i);
    displacement_.voxels[i] = (field.to_imaged(p) - p).cast<float>();
  });
  prepare();
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int i = 0; i < 1000; ++i) {
    const Vector3d p = low + Vector3d(unit(rng), unit(rng), unit(rng)).cwiseProduct(high - low);
    if (field.assess(p).coverage != Coverage::kUnknown) {
      table_error_mm_ = std::max(table_error_mm_, (field.to_imaged(p) - to_imaged(p)).norm());
    }
  }
  for_each_node(team, error_, [&](std::size_t i) {
    const auto a = field.assess(error_.pixel_mm(i));
    const auto stated = static_cast<float>(std::min(a.error_95_mm + table_error_mm_, double{kUnknownError}));
    error_.voxels[i] = a.coverage == Coverage::kInterpolates ? stated
                       : a.coverage == Coverage::kExtrapolates
                           ? -stated
                           : -std::max(stated, static_cast<float>(1.01 * max_error_95_mm_));
  });
}

FieldTable::FieldTable(image::Image<Eigen::Vector3f, 3> displacement_mm, image::Image<float, 3> signed_error_95_mm,
                       double max_error_95_mm)
    : displacement_(std::move(displacement_mm)), error_(std::move(signed_error_95_mm)),
      max_error_95_mm_(max_error_95_mm) {
  prepare();
}

void FieldTable::prepare() {
  T_index_mm_ = displacement_.T_image_index.inverse();
  T_error_index_mm_ = error_.T_image_index.inverse();
}

Vector3d FieldTable::displacement(const Vector &true_mm) const noexcept {
  return interpolate(displacement_.voxels, cell_at(displacement_, transformed(T_index_mm_, true_mm)),
                     Vector3d(Vector3d::Zero()));
}

FieldTable::Sample FieldTable::sample(const Vector &true_mm) const noexcept {
  Sample out;
  const Cell cell = cell_at(displacement_, transformed(T_index_mm_, true_mm));
  out.displacement_mm = interpolate(displacement_.voxels, cell, Vector3d(Vector3d::Zero()));
  const Cell coarse = cell_at(error_, transformed(T_error_index_mm_, true_mm));
  // The sign is that of the nearest node, the size is interpolated.
  double size = 0.0;
  bool extrapolates = false;
  double most = -1.0;
  for (unsigned corner = 0; corner < 8; ++corner) {
    double weight = 1.0;
    std::size_t at = coarse.corner;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const bool upper = ((corner >> axis) & 1U) != 0;
      weight *= upper ? coarse.fraction[axis] : 1.0 - coarse.fraction[axis];
      at += upper ? coarse.step[axis] : 0;
    }
    const double value = error_.voxels[at];
    size += weight * std::abs(value);
    if (weight > most) {
      most = weight;
      extrapolates = value < 0.0;
    }
  }
  out.error_95_mm = size;
  if (cell.inside && size <= max_error_95_mm_) {
    out.coverage = extrapolates ? Coverage::kExtrapolates : Coverage::kInterpolates;
  }
  return out;
}

std::optional<Vector3d> FieldTable::to_true(const Vector &imaged_mm) const noexcept {
  Vector p = imaged_mm;
  for (int step = 0; step < kInverseSteps; ++step) {
    const Vector move = imaged_mm - to_imaged(p);
    p += move;
    if (move.norm() < kInverseStep_mm) {
      return p;
    }
  }
  return std::nullopt;
}

double FieldTable::volume_ratio(const Vector &true_mm) const noexcept {
  const Vector3d step = displacement_.spacing_mm();
  Eigen::Matrix3d J = Eigen::Matrix3d::Identity();
  for (Index axis = 0; axis < 3; ++axis) {
    const Vector3d away = step[axis] * Vector3d::Unit(axis);
    J.col(axis) += (displacement(true_mm + away) - displacement(true_mm - away)) / (2.0 * step[axis]);
  }
  return J.determinant();
}

} // namespace bregma::mri
