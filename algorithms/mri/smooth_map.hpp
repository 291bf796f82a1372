// Private to algorithms/mri: a robust smooth displacement between paired points, to recognise wrong pairs. For the
// distortion itself: distortion_field.hpp.
#pragma once

#include <Eigen/Core>

#include "algorithms/geometry/points.hpp"

namespace bregma::mri {

class SmoothMap {
public:
  // Displacements to - from as solid harmonics up to `degree` about the origin of `from`, by least squares with Tukey's
  // weights. The degree is lowered to what the number of pairs allows (three pairs per harmonic); degree 0 is a
  // translation. At least one pair.
  SmoothMap(const geometry::Points3 &from_mm, const geometry::Points3 &to_mm, int degree);

  [[nodiscard]] geometry::Points3 operator()(const geometry::Points3 &from_mm) const;

private:
  int degree_;
  double radius_mm_;
  Eigen::MatrixXd coefficients_; // one row per harmonic
};

// The same map without pairs, by expectation-maximisation: each target is a sample of a Gaussian around one of the
// moved points, or an outlier [Myronenko 2010].
class SoftSmoothMap {
public:
  // References must outlive it.
  SoftSmoothMap(const geometry::Points3 &from_mm, const geometry::Points3 &to_mm, double spacing_mm);

  // Where `from` comes to lie, with harmonics up to `degree` (1 or more).
  geometry::Points3 run(int degree);

private:
  struct Responsibility {
    Eigen::VectorXd weight; // of each moved point
    geometry::Points3 sum;  // weighted targets
  };
  void iterate(int degree, double from_share, double to_share, int iterations);
  [[nodiscard]] Responsibility expectation(double sigma_mm) const;

  const geometry::Points3 &from_, &to_;
  double spacing_mm_, radius_mm_;
  geometry::Points3 moved_;
};

} // namespace bregma::mri
