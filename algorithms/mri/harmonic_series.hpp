// A scalar field as a series of solid harmonics, fitted to values at scattered points, with its uncertainty inside and
// outside their volume.
//
// Magnetic fields without sources in the volume are series of solid harmonics: those of the gradient coils, whose
// deviation from linearity displaces a spin's image, and B0 [Tuna 2022, references 11, 12, 40]. They are harmonic as
// functions of the true position, not of the imaged one.
//
// The degree is not chosen: all degrees up to a maximum enter, and the variance of each degree's coefficients and that
// of the noise maximise the evidence [MacKay 1992]. Degrees 0 and 1 have a flat prior. The covariance of the
// coefficients then states the error between the points. Outside, errors of degrees that the points do not show grow
// with the radius, so variances for the prediction do not fall below the geometric decay of the larger degrees.
//
// Units: mm for points, any for values. const members are thread-safe; evaluation does not allocate.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <tl/expected.hpp>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/solid_harmonics.hpp"

namespace bregma::mri {

struct HarmonicOptions {
  int max_degree = 9;       // 2 to kMaxHarmonicDegree
  double radius_mm = 0.0;   // at which coefficients are stated; 0: the largest distance of a point from the origin
  int max_iterations = 200; // of the evidence
  double tolerance = 1e-4;  // relative change of all variances
};

class HarmonicSeries {
public:
  struct Estimate {
    double value = 0.0;
    double sigma = 0.0; // of the field itself, not of a measurement
  };

  // The expansion's origin is that of the points' frame: the isocentre. Otherwise a sentence: fewer than 12 points,
  // sizes that differ, numbers that are not finite, options out of range, points that do not determine the linear part.
  [[nodiscard]] static tl::expected<HarmonicSeries, std::string>
  fit(const geometry::Points3 &points_mm, const Eigen::VectorXd &values, const HarmonicOptions &options = {});

  [[nodiscard]] double operator()(const Eigen::Vector3d &point_mm) const noexcept;
  [[nodiscard]] Estimate estimate(const Eigen::Vector3d &point_mm) const noexcept;

  [[nodiscard]] int degree() const { return degree_; }
  [[nodiscard]] double radius_mm() const { return radius_mm_; }
  [[nodiscard]] double noise_sigma() const { return noise_sigma_; }                   // of one value
  [[nodiscard]] const Eigen::VectorXd &coefficients() const { return coefficients_; } // order: solid_harmonics.hpp
  [[nodiscard]] double degree_sigma(int degree) const { return prior_sigma_[static_cast<std::size_t>(degree)]; }
  // Value minus that of a series fitted without it, with the same variances; exact.
  [[nodiscard]] const Eigen::VectorXd &leave_one_out() const { return leave_one_out_; }

private:
  int degree_ = 0;
  double radius_mm_ = 1.0, noise_sigma_ = 0.0;
  Eigen::VectorXd coefficients_;
  Eigen::MatrixXd factor_; // upper triangular, covariance = factor' * factor
  std::vector<double> prior_sigma_;
  Eigen::VectorXd leave_one_out_;
};

} // namespace bregma::mri
