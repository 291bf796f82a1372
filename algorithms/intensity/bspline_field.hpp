// A displacement field of cubic B-splines on a lattice over an image [Rueckert 1999]: p -> p + u(p), mm.
//
// The lattice lies along the grid's axes: `cells` cells cover it along each axis, with one node before and two behind.
// Coefficients are the nodes' vectors (x, y, z in the grid's frame, mm) with a zero behind each, the first axis
// fastest. const members are safe to call from several threads.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "algorithms/image/grid.hpp"
#include "algorithms/parallel/team.hpp"

namespace bregma::intensity {

// Values or derivatives of the four B-splines around a point along each axis.
struct SplineWeights {
  std::size_t first = 0; // node
  std::array<float, 4> x{}, y{}, z{};
};

class BSplineField {
public:
  // Cells of about `spacing_mm`, their number along each axis a multiple of `multiple`. Zero displacement.
  BSplineField(const image::Grid<3> &grid, double spacing_mm, int multiple = 1);

  [[nodiscard]] const image::Grid<3> &grid() const { return grid_; }
  [[nodiscard]] const std::array<int, 3> &cells() const { return cells_; }
  [[nodiscard]] std::array<int, 3> nodes() const { return {cells_[0] + 3, cells_[1] + 3, cells_[2] + 3}; }
  [[nodiscard]] std::vector<float> &coefficients() { return coefficients_; }
  [[nodiscard]] const std::vector<float> &coefficients() const { return coefficients_; }
  // Edge of a cell along each axis.
  [[nodiscard]] Eigen::Vector3d spacing_mm() const;

  // At an index of the grid, which need not be whole; outside, the polynomial of the nearest cell's border.
  [[nodiscard]] SplineWeights weights_at(const Eigen::Vector3f &index) const;
  [[nodiscard]] Eigen::Vector3f displacement_mm(const SplineWeights &at) const noexcept;
  [[nodiscard]] Eigen::Vector3d displacement_mm(const Eigen::Vector3d &point_mm) const;
  // Adds the derivative of a function with respect to u at a point to that with respect to the coefficients.
  void add_force(const SplineWeights &at, const Eigen::Vector3f &force, std::span<float> by_coefficient) const noexcept;

  // The same field with cells half as large.
  [[nodiscard]] BSplineField refined() const;

  // Mean over the lattice's inner nodes of the squared second derivatives, 1/mm^2, and its derivative times `scale`,
  // which is added to `by_coefficient`.
  [[nodiscard]] double bending(double scale, std::span<double> by_coefficient) const;

  // Determinant of the derivative of p + u(p) at eight points per cell along each axis: not above 0 where it folds.
  struct Stretch {
    double smallest = 1.0, largest = 1.0;
  };
  [[nodiscard]] Stretch jacobian(parallel::Team &team) const;

private:
  [[nodiscard]] std::size_t node(int i, int j, int k) const;
  [[nodiscard]] double jacobian_at(const Eigen::Vector3f &lattice) const;

  image::Grid<3> grid_;
  std::array<int, 3> cells_{};
  std::vector<float> coefficients_;
};

} // namespace bregma::intensity
