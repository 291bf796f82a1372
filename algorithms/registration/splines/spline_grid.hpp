// A thin-plate spline on a regular grid, for images: a million points per second and more, for any number of centres,
// with a measured error.
//
// Nodes hold f itself; between them, cubic Lagrange polynomials through four nodes along each axis (error O(h^4) away
// from the centres; the kernel r has a kink at each centre, where it is O(h)). The error is measured where it is
// largest: at the centres themselves and in the middle of cells. Points outside the box are evaluated by the spline.
// const members are thread-safe; only the constructor allocates, except for points outside.
#pragma once

#include <vector>

#include "algorithms/registration/splines/thin_plate_spline.hpp"

namespace bregma::registration {

inline constexpr Eigen::Index kMaxGridNodes = 16'000'000;

template <int D> class SplineGrid {
public:
  using Vector = Eigen::Matrix<double, D, 1>;

  // The box low..high (mm, in the frame of the centres) with nodes at most spacing_mm apart, on `threads` threads.
  // Throws std::invalid_argument for an empty box, a spacing that is not positive, or more than kMaxGridNodes nodes.
  SplineGrid(const ThinPlateSpline<D> &spline, const Vector &low_mm, const Vector &high_mm, double spacing_mm,
             int threads = 1);

  [[nodiscard]] Vector operator()(const Vector &point_mm) const;

  // Measured at 4,000 points or more: up to 2,000 centres in the box, and pseudo-random points in it.
  [[nodiscard]] double largest_error_mm() const { return largest_error_mm_; }
  [[nodiscard]] double rms_error_mm() const { return rms_error_mm_; }
  [[nodiscard]] Eigen::Index nodes() const { return values_.cols(); }
  [[nodiscard]] const Vector &spacing_mm() const { return spacing_; }

private:
  void measure_error();

  ThinPlateSpline<D> spline_;
  Vector low_, high_, spacing_;
  Eigen::Matrix<Eigen::Index, D, 1> size_;
  geometry::Points<D> values_; // first axis fastest
  double largest_error_mm_ = 0.0, rms_error_mm_ = 0.0;
};

extern template class SplineGrid<2>;
extern template class SplineGrid<3>;

} // namespace bregma::registration
