// Thin-plate splines in the plane and in space: the smooth map that takes each centre to its value.
//
//   f(y) = sum_i a_i phi(|y - c_i|) + b_0 + B y,   sum_i a_i = 0,  sum_i a_i c_i' = 0
//
// Wang 2014 eqs. (19)-(20) (whose kernel |.|^2 log |.|^2 is twice this one: the same spline) and the MRI paper's
// (2)-(5); Bookstein 1989. Kernels side by side: r^2 ln r, which minimises the bending energy in the plane and is
// admissible in every dimension, and r, which does so in space (Wahba 1990, ch. 2.4). Both are conditionally definite:
// on the coefficients that satisfy the side conditions the system is positive definite. It is projected there by the
// QR of the polynomial part and solved by Cholesky, which needs no pivots and notices when centres coincide, and is
// refined once against the full system.
//
// Units: mm on both sides; any frames: f maps from the frame of the centres to that of the values. Coordinates are
// normalised inside. const members are thread-safe. fit() allocates 8 N^2 bytes for N centres and takes O(N^3).
#pragma once

#include <optional>
#include <string>

#include <tl/expected.hpp>

#include "algorithms/geometry/points.hpp"

namespace bregma::registration {

enum class SplineKernel { kR2LogR, kR };

struct SplineOptions {
  SplineKernel kernel = SplineKernel::kR2LogR;
  // lambda of sum |f(c_i) - v_i|^2 + lambda J(f), with J(f) = a' K a (K of -r for the kernel r): mm^2 for r^2 ln r, mm
  // for r. 0 interpolates.
  double regularisation = 0.0;
  bool leave_one_out = false; // costs about three times the fit
};

inline constexpr Eigen::Index kMaxSplineCentres = 20'000; // 3.2 GB

template <int D> class ThinPlateSpline {
public:
  using Vector = Eigen::Matrix<double, D, 1>;
  using Matrix = Eigen::Matrix<double, D, D>;

  // A sentence where it cannot be: fewer than D + 1 centres, all in a plane (D = 3) or on a line (D = 2), two that
  // coincide (named by index), numbers that are not finite, sizes that differ, a negative regularisation.
  [[nodiscard]] static tl::expected<ThinPlateSpline, std::string>
  fit(const geometry::Points<D> &centres_mm, const geometry::Points<D> &values_mm, const SplineOptions &options = {});

  [[nodiscard]] Vector operator()(const Vector &point_mm) const noexcept; // does not allocate
  // Many points; faster than one by one. Vectors of kernels: about 3 ns a centre and point.
  [[nodiscard]] geometry::Points<D> map(const geometry::Points<D> &points_mm) const;
  // d f / d y. The kernel r has none at its centres themselves: there the other centres' is returned.
  [[nodiscard]] Matrix jacobian(const Vector &point_mm) const noexcept;
  // The point that f takes to value_mm: Newton with halved steps from `start_mm` (by default the value taken through
  // the inverse of the affine part). Nothing where it does not settle to 1e-9 of the centres' size within 50 steps, or
  // f folds there (determinant of the Jacobian not positive in the sense of the affine part).
  [[nodiscard]] std::optional<Vector> inverse(const Vector &value_mm, const Vector *start_mm = nullptr) const noexcept;

  [[nodiscard]] Eigen::Index size() const { return centres_.rows(); }
  [[nodiscard]] SplineKernel kernel() const { return kernel_; }
  [[nodiscard]] geometry::Points<D> centres_mm() const;
  // Distance of each value from what a spline without its centre gives there (Rippa 1999; exact, from one inverse).
  // Empty unless asked for.
  [[nodiscard]] const Eigen::VectorXd &leave_one_out_mm() const { return leave_one_out_mm_; }

private:
  [[nodiscard]] Vector normalised(const Vector &p) const { return (p - origin_) / size_mm_; }

  SplineKernel kernel_ = SplineKernel::kR2LogR;
  Vector origin_ = Vector::Zero();
  double size_mm_ = 1.0;
  Eigen::Matrix<double, Eigen::Dynamic, D> centres_;      // normalised
  Eigen::Matrix<double, Eigen::Dynamic, D> coefficients_; // a, one row a centre, mm
  Eigen::Matrix<double, D + 1, D> affine_;                // b_0 above, then B', on normalised points
  Eigen::VectorXd leave_one_out_mm_;
};

extern template class ThinPlateSpline<2>;
extern template class ThinPlateSpline<3>;

} // namespace bregma::registration
