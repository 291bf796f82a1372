#include "algorithms/intensity/bspline_field.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include <Eigen/LU>

#include "algorithms/intensity/cubic_spline.hpp"

namespace bregma::intensity {

namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
using Floats4 = Eigen::Array4f;

// At a node: values, first and second derivatives of the three splines around it.
constexpr std::array<std::array<double, 3>, 3> kAtNode{
    {{1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0}, {-0.5, 0.0, 0.5}, {1.0, -2.0, 1.0}}};
// The second derivatives: order along each axis, and how often each occurs.
struct SecondDerivative {
  std::array<std::size_t, 3> order;
  double times;
};
constexpr std::array<SecondDerivative, 6> kSecond{
    {{{2, 0, 0}, 1.0}, {{0, 2, 0}, 1.0}, {{0, 0, 2}, 1.0}, {{1, 1, 0}, 2.0}, {{1, 0, 1}, 2.0}, {{0, 1, 1}, 2.0}}};

struct Tap {
  std::ptrdiff_t offset; // nodes
  double weight;
};
std::array<std::vector<Tap>, 6> second_stencils(const Vector3d &spacing_mm, const std::array<int, 3> &nodes) {
  std::array<std::vector<Tap>, 6> out;
  for (std::size_t d = 0; d < kSecond.size(); ++d) {
    const auto &order = kSecond[d].order;
    double unit = 1.0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      unit /= std::pow(spacing_mm[static_cast<Eigen::Index>(axis)], static_cast<double>(order[axis]));
    }
    for (std::size_t s = 0; s < 27; ++s) {
      const std::size_t a = s % 3;
      const std::size_t b = s / 3 % 3;
      const std::size_t c = s / 9;
      const double weight = unit * kAtNode[order[0]][a] * kAtNode[order[1]][b] * kAtNode[order[2]][c];
      const std::ptrdiff_t row = nodes[0];
      const std::ptrdiff_t slice = row * nodes[1];
      if (weight != 0.0) {
        out[d].push_back({static_cast<std::ptrdiff_t>(a) - 1 + (static_cast<std::ptrdiff_t>(b) - 1) * row +
                              (static_cast<std::ptrdiff_t>(c) - 1) * slice,
                          weight});
      }
    }
  }
  return out;
}

} // namespace

BSplineField::BSplineField(const image::Grid<3> &grid, double spacing_mm, int multiple) : grid_(grid) {
  const Vector3d voxel = grid.spacing_mm();
  for (std::size_t d = 0; d < 3; ++d) {
    const double length = voxel[static_cast<Eigen::Index>(d)] * std::max(grid.size[d] - 1, 1);
    const int groups = static_cast<int>(std::ceil(length / (spacing_mm * multiple) - 1e-9));
    cells_[d] = multiple * std::max(groups, 1);
  }
  const std::array<int, 3> n = nodes();
  coefficients_.assign(
      4 * static_cast<std::size_t>(n[0]) * static_cast<std::size_t>(n[1]) * static_cast<std::size_t>(n[2]), 0.0F);
}

Vector3d BSplineField::spacing_mm() const {
  Vector3d out = grid_.spacing_mm();
  for (std::size_t d = 0; d < 3; ++d) {
    out[static_cast<Eigen::Index>(d)] *= static_cast<double>(std::max(grid_.size[d] - 1, 1)) / cells_[d];
  }
  return out;
}

std::size_t BSplineField::node(int i, int j, int k) const {
  return (static_cast<std::size_t>(k) * (static_cast<std::size_t>(cells_[1]) + 3) + static_cast<std::size_t>(j)) *
             (static_cast<std::size_t>(cells_[0]) + 3) +
         static_cast<std::size_t>(i);
}

SplineWeights BSplineField::weights_at(const Vector3f &index) const {
  std::array<int, 3> base{};
  std::array<std::array<float, 4>, 3> weights{};
  for (std::size_t d = 0; d < 3; ++d) {
    const auto cells = static_cast<float>(cells_[d]);
    const float at = std::clamp(
        index[static_cast<Eigen::Index>(d)] * cells / static_cast<float>(std::max(grid_.size[d] - 1, 1)), 0.0F, cells);
    base[d] = std::min(static_cast<int>(at), cells_[d] - 1);
    weights[d] = spline_weights(at - static_cast<float>(base[d]));
  }
  return {node(base[0], base[1], base[2]), weights[0], weights[1], weights[2]};
}

Vector3f BSplineField::displacement_mm(const SplineWeights &at) const noexcept {
  const auto row = static_cast<std::size_t>(cells_[0]) + 3;
  const std::size_t slice = row * (static_cast<std::size_t>(cells_[1]) + 3);
  Floats4 sum = Floats4::Zero();
  for (std::size_t c = 0; c < 4; ++c) {
    for (std::size_t b = 0; b < 4; ++b) {
      const float *from = coefficients_.data() + 4 * (at.first + c * slice + b * row);
      Floats4 line = Floats4::Zero();
      for (std::size_t a = 0; a < 4; ++a) {
        line += at.x[a] * Eigen::Map<const Floats4>(from + 4 * a);
      }
      sum += at.y[b] * at.z[c] * line;
    }
  }
  return sum.head<3>();
}

Vector3d BSplineField::displacement_mm(const Vector3d &point_mm) const {
  const Vector3d index = grid_.axes().inverse() * (point_mm - grid_.origin_mm());
  return displacement_mm(weights_at(index.cast<float>())).cast<double>();
}

void BSplineField::add_force(const SplineWeights &at, const Vector3f &force,
                             std::span<float> by_coefficient) const noexcept {
  const auto row = static_cast<std::size_t>(cells_[0]) + 3;
  const std::size_t slice = row * (static_cast<std::size_t>(cells_[1]) + 3);
  const Floats4 whole(force.x(), force.y(), force.z(), 0.0F);
  for (std::size_t c = 0; c < 4; ++c) {
    for (std::size_t b = 0; b < 4; ++b) {
      float *to = by_coefficient.data() + 4 * (at.first + c * slice + b * row);
      const Floats4 part = at.y[b] * at.z[c] * whole;
      for (std::size_t a = 0; a < 4; ++a) {
        Eigen::Map<Floats4>(to + 4 * a) += at.x[a] * part;
      }
    }
  }
}

BSplineField BSplineField::refined() const {
  // Subdivision along one axis after the other: a new node at an old one is 1/8, 6/8, 1/8 of its neighbours, one
  // between two old ones their mean.
  BSplineField out = *this;
  for (std::size_t d = 0; d < 3; ++d) {
    const BSplineField from = out;
    out.cells_[d] *= 2;
    const std::array<int, 3> n = out.nodes();
    out.coefficients_.assign(
        4 * static_cast<std::size_t>(n[0]) * static_cast<std::size_t>(n[1]) * static_cast<std::size_t>(n[2]), 0.0F);
    for (int k = 0; k < n[2]; ++k) {
      for (int j = 0; j < n[1]; ++j) {
        for (int i = 0; i < n[0]; ++i) {
          std::array<int, 3> at{i, j, k};
          const int fine = at[d];
          const auto old = [&](int place) -> Floats4 {
            at[d] = place;
            return Eigen::Map<const Floats4>(from.coefficients_.data() + 4 * from.node(at[0], at[1], at[2]));
          };
          const int low = fine / 2;
          const Floats4 value = fine % 2 == 0 ? Floats4(0.5F * (old(low) + old(low + 1)))
                                              : Floats4(0.125F * (old(low) + old(low + 2)) + 0.75F * old(low + 1));
          Eigen::Map<Floats4>(out.coefficients_.data() + 4 * out.node(i, j, k)) = value;
        }
      }
    }
  }
  return out;
}

double BSplineField::bending(double scale, std::span<double> by_coefficient) const {
  const std::array<int, 3> n = nodes();
  const double count = static_cast<double>(n[0] - 2) * (n[1] - 2) * (n[2] - 2);
  const std::array<std::vector<Tap>, 6> stencils = second_stencils(spacing_mm(), n);
  double sum = 0.0;
  for (int k = 1; k < n[2] - 1; ++k) {
    for (int j = 1; j < n[1] - 1; ++j) {
      for (int i = 1; i < n[0] - 1; ++i) {
        const auto here = static_cast<std::ptrdiff_t>(node(i, j, k));
        for (std::size_t d = 0; d < stencils.size(); ++d) {
          Vector3d value = Vector3d::Zero();
          for (const Tap &tap : stencils[d]) {
            const float *from = coefficients_.data() + 4 * (here + tap.offset);
            value += tap.weight * Eigen::Map<const Vector3f>(from).cast<double>();
          }
          sum += kSecond[d].times * value.squaredNorm();
          const double factor = 2.0 * scale * kSecond[d].times / count;
          for (const Tap &tap : stencils[d]) {
            Eigen::Map<Vector3d>(by_coefficient.data() + 4 * (here + tap.offset)) += factor * tap.weight * value;
          }
        }
      }
    }
  }
  return sum / count;
}

double BSplineField::jacobian_at(const Vector3f &lattice) const {
  std::array<int, 3> base{};
  std::array<std::array<std::array<float, 4>, 2>, 3> weights{}; // values, slopes
  for (std::size_t d = 0; d < 3; ++d) {
    const float at = lattice[static_cast<Eigen::Index>(d)];
    base[d] = std::min(static_cast<int>(at), cells_[d] - 1);
    const float t = at - static_cast<float>(base[d]);
    weights[d] = {spline_weights(t), spline_slopes(t)};
  }
  SplineWeights at;
  at.first = node(base[0], base[1], base[2]);
  Eigen::Matrix3d by_lattice; // du / d(lattice coordinate)
  for (std::size_t d = 0; d < 3; ++d) {
    at.x = weights[0][d == 0 ? 1 : 0];
    at.y = weights[1][d == 1 ? 1 : 0];
    at.z = weights[2][d == 2 ? 1 : 0];
    by_lattice.col(static_cast<Eigen::Index>(d)) = displacement_mm(at).cast<double>();
  }
  Eigen::Matrix3d cell = grid_.axes(); // columns: edges of a cell
  for (std::size_t d = 0; d < 3; ++d) {
    cell.col(static_cast<Eigen::Index>(d)) *= static_cast<double>(std::max(grid_.size[d] - 1, 1)) / cells_[d];
  }
  return (Eigen::Matrix3d::Identity() + by_lattice * cell.inverse()).determinant();
}

BSplineField::Stretch BSplineField::jacobian(parallel::Team &team) const {
  constexpr int kPerCell = 8;
  std::vector<Stretch> parts(static_cast<std::size_t>(team.size()));
  team.run([&](int thread) {
    Stretch &part = parts[static_cast<std::size_t>(thread)];
    for (int k = thread; k <= kPerCell * cells_[2]; k += team.size()) {
      for (int j = 0; j <= kPerCell * cells_[1]; ++j) {
        for (int i = 0; i <= kPerCell * cells_[0]; ++i) {
          const double J =
              jacobian_at(Vector3f(static_cast<float>(i), static_cast<float>(j), static_cast<float>(k)) / kPerCell);
          part.smallest = std::min(part.smallest, J);
          part.largest = std::max(part.largest, J);
        }
      }
    }
  });
  Stretch out = parts[0];
  for (const Stretch &part : parts) {
    out.smallest = std::min(out.smallest, part.smallest);
    out.largest = std::max(out.largest, part.largest);
  }
  return out;
}

} // namespace bregma::intensity
