// Calibration of a range sensor by a power law, distance = a * reading^b, and where it does not hold.
//
// Least squares on the distance by Gauss-Newton, from the straight line between the logarithms. The covariance is the
// sandwich of [White 1980]: it holds for errors that grow with the distance. A power law is a description, not the
// physics of a triangulating sensor: stretches of distance where the mean residual is significantly off are named, and
// the mean residuals of all stretches correct the law between them.
//
// Pure functions; any thread.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace bregma::range {

struct PowerLaw {
  double scale_mm = 0.0; // a: distance at a reading of one
  double exponent = 0.0; // b
  // NaN for a reading that is not positive.
  [[nodiscard]] double distance_mm(double reading) const {
    return reading > 0.0 ? scale_mm * std::pow(reading, exponent) : std::nan("");
  }
  [[nodiscard]] double reading(double distance_mm) const { return std::pow(distance_mm / scale_mm, 1.0 / exponent); }
};

struct CurveCorrection {
  double reading = 0.0; // mean of a stretch
  double add_mm = 0.0;  // mean of measured minus fitted distance there
};

// The law, with what is to be added to its distance: linear between the corrections, constant beyond the outermost.
struct RangeCurve {
  PowerLaw law;
  std::vector<CurveCorrection> corrections; // readings increase
  [[nodiscard]] double distance_mm(double reading) const;
};

struct CalibrationPoint {
  double reading = 0.0; // positive
  double distance_mm = 0.0;
};

struct PowerLawOptions {
  std::size_t min_points = 20;
  double min_distance_ratio = 1.5; // largest over smallest distance; below it the exponent is not determined
  double max_bias_mm = 1.0;        // mean residual of a stretch that counts as a misfit
  std::size_t stretches = 8;       // of equal numbers of points
};

enum class PowerLawVerdict : std::uint8_t {
  kAccepted,
  kTooFewPoints,
  kInvalidPoint, // a reading or distance that is not finite and positive
  kTooNarrow,    // the distances do not differ enough
  kNotMonotone,  // the reading rises and falls with the distance: it would mean two distances
  kDoesNotFit    // stretches with a significant bias above max_bias_mm
};

struct Misfit {
  double from_mm = 0.0, to_mm = 0.0; // distances
  double bias_mm = 0.0;              // mean of measured minus fitted distance
};

struct PowerLawFit {
  PowerLawVerdict verdict = PowerLawVerdict::kTooFewPoints;
  std::string text;
  bool estimated = false;
  PowerLaw law;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero(); // of scale (mm) and exponent
  double rms_mm = 0.0, worst_mm = 0.0;
  std::vector<Misfit> misfits;
  std::vector<CurveCorrection> corrections; // readings increase
  double corrected_rms_mm = 0.0;            // of the points about the corrected law
  // 1 sigma of the law's distance at a reading, from the covariance.
  [[nodiscard]] double sigma_mm(double reading) const;
  [[nodiscard]] RangeCurve corrected() const { return {law, corrections}; }
  [[nodiscard]] bool accepted() const { return verdict == PowerLawVerdict::kAccepted; }
};

[[nodiscard]] PowerLawFit fit_power_law(std::span<const CalibrationPoint> points, const PowerLawOptions &options = {});

} // namespace bregma::range
