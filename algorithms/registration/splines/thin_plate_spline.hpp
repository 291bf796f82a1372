// Thin-plate splines in the plane and in space: the smooth map that takes each centre to its value.
//
//   f(y) = sum_i a_i phi(|y - c_i|) + b_0 + B y,   sum_i a_i = 0,  sum_i a_i c_i' = 0
//
// [Bookstein 1989]; [thesis, eqs. 19-20], whose kernel |.|^2 log |.|^2 is twice this one and gives the same spline;
// [Tuna 2022, eqs. 2-5]. Two kernels: r^2 ln r minimises the bending energy in the plane and is admissible in every
// dimension; r minimises it in space [Wahba 1990, chapter 2.4]. Both are conditionally definite: the system is positive
// definite on the coefficients that satisfy the side conditions. The QR of the polynomial part projects it there. It is
// solved by Cholesky, which needs no pivoting and detects coincident centres, and refined once against the full system.
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

  // Otherwise a sentence: fewer than D + 1 centres, all in a plane (D = 3) or on a line (D = 2), two that coincide
  // (named by index), numbers that are not finite, sizes that differ, a negative regularisation.
  [[nodiscard]] static tl::expected<ThinPlateSpline, std::string>
  fit(const geometry::Points<D> &centres_mm, const geometry::Points<D> &values_mm, const SplineOptions &options = {});

  [[nodiscard]] Vector operator()(const Vector &point_mm) const noexcept; // does not allocate
  // Many points; faster than one by one, about 3 ns per centre and point.
  [[nodiscard]] geometry::Points<D> map(const geometry::Points<D> &points_mm) const;
  // d f / d y. The kernel r has no derivative at its centre: there the derivative of the other centres is returned.
  [[nodiscard]] Matrix jacobian(const Vector &point_mm) const noexcept;
  // The point that f maps to value_mm, by Newton's method with halved steps from `start_mm` (default: by the inverse of
  // the affine part). No result where it does not converge to 1e-9 of the centres' size within 50 steps, or where f
  // folds (the determinant of the Jacobian has another sign than that of the affine part).
  [[nodiscard]] std::optional<Vector> inverse(const Vector &value_mm, const Vector *start_mm = nullptr) const noexcept;

  [[nodiscard]] Eigen::Index size() const { return centres_.rows(); }
  [[nodiscard]] SplineKernel kernel() const { return kernel_; }
  [[nodiscard]] geometry::Points<D> centres_mm() const;
  // Distance of each value from that of a spline without its centre, exact, from one inverse [Rippa 1999]. Empty unless
  // requested.
  [[nodiscard]] const Eigen::VectorXd &leave_one_out_mm() const { return leave_one_out_mm_; }

private:
  [[nodiscard]] Vector normalised(const Vector &p) const { return (p - origin_) / size_mm_; }

  SplineKernel kernel_ = SplineKernel::kR2LogR;
  Vector origin_ = Vector::Zero();
  double size_mm_ = 1.0;
  Eigen::Matrix<double, Eigen::Dynamic, D> centres_;      // normalised
  Eigen::Matrix<double, Eigen::Dynamic, D> coefficients_; // a, one row per centre, mm
  Eigen::Matrix<double, D + 1, D> affine_;                // b_0 above, then B', on normalised points
  Eigen::VectorXd leave_one_out_mm_;
};

extern template class ThinPlateSpline<2>;
extern template class ThinPlateSpline<3>;

} // namespace bregma::registration
