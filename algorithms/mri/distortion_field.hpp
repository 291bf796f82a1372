// How a scanner bends space: the map from the true position of a point to that in the image, and back, from control
// points of a phantom [Tuna 2022, section III-D].
//
//   imaged = true + H(true) + w(true) S(true)
//
// H has a series of solid harmonics per axis (harmonic_series.hpp), S is a smoothing thin-plate spline of what the
// harmonics leave, (2)-(5) of the paper. w is 1 within the volume of the control points and half a spacing around it;
// beyond, where a spline has no meaning, it falls to 0 over one spacing. The smoothing is chosen by the hold-out of
// section VI-A; S is left out where it does not reduce the error at the points held out.
//
// The paper maps imaged to true. The direction here is the one in which the physics is harmonic, and the one that
// resampling an image needs. On the markers of a real phantom it lowers the residual of harmonics of degree 7 from 0.36
// to 0.31 mm (docs/mri.md). The inverse is a fixed-point iteration.
//
// Units: mm. Any frame for both sides with the isocentre as its origin, as Patient or Device (frames.hpp). const
// members are thread-safe; evaluation does not allocate and takes microseconds. For images: correction.hpp.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include <tl/expected.hpp>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/harmonic_series.hpp"
#include "algorithms/registration/splines/thin_plate_spline.hpp"

namespace bregma::mri {

enum class Coverage {
  kInterpolates, // between control points
  kExtrapolates, // outside, with a stated error within the limit
  kUnknown       // outside, and the stated error exceeds the limit
};
[[nodiscard]] const char *name(Coverage coverage) noexcept;

struct FieldOptions {
  HarmonicOptions harmonics;
  bool local_spline = true;
  // Limits of an extrapolation.
  double max_error_95_mm = 2.0;
  double max_distance_mm = 60.0;
};

class DistortionField {
public:
  using Vector = Eigen::Vector3d;

  struct Assessment {
    Coverage coverage = Coverage::kUnknown;
    Vector sigma_mm = Vector::Zero(); // of each coordinate
    double error_95_mm = 0.0;         // length of the error that is not exceeded with 95 %, for independent coordinates
    double distance_mm = 0.0;         // outside the volume of the control points; 0 within
  };

  // Column i of both is the same control point. Otherwise a sentence: that of HarmonicSeries or ThinPlateSpline.
  [[nodiscard]] static tl::expected<DistortionField, std::string>
  fit(const geometry::Points3 &true_mm, const geometry::Points3 &imaged_mm, const FieldOptions &options = {});

  [[nodiscard]] Vector to_imaged(const Vector &true_mm) const noexcept;
  // No result where the iteration does not settle within 1e-6 mm: far outside, where the field folds.
  [[nodiscard]] std::optional<Vector> to_true(const Vector &imaged_mm) const noexcept;
  [[nodiscard]] Assessment assess(const Vector &true_mm) const noexcept;

  [[nodiscard]] const FieldOptions &options() const { return options_; }
  [[nodiscard]] const HarmonicSeries &harmonics(int axis) const { return harmonics_[static_cast<std::size_t>(axis)]; }
  [[nodiscard]] bool has_spline() const { return spline_.has_value(); }
  [[nodiscard]] const geometry::Points3 &control_points_mm() const { return control_mm_; } // true positions
  // Median distance of a control point from its nearest neighbour.
  [[nodiscard]] double spacing_mm() const { return spacing_mm_; }

private:
  [[nodiscard]] double distance_outside(const Vector &true_mm) const noexcept;
  void fit_spline(const geometry::Points3 &residual_mm);

  FieldOptions options_;
  std::vector<HarmonicSeries> harmonics_; // x, y, z
  std::optional<registration::ThinPlateSpline<3>> spline_;
  double spline_sigma_mm_ = 0.0;
  Vector spline_part_mm_ = Vector::Zero(); // RMS of the spline at the control points, of each coordinate
  geometry::Points3 control_mm_;
  double spacing_mm_ = 0.0;
  geometry::Points3 hull_directions_; // the volume of the control points: direction . p <= extent for all
  Eigen::VectorXd hull_extents_;
};

// Lengths of many errors by axis and overall: a row of table 3 of the paper.
struct ErrorSummary {
  struct Row {
    double mean_mm = 0.0, deviation_mm = 0.0, max_mm = 0.0; // of absolute values
  };
  std::array<Row, 3> axis;
  Row overall;
};
[[nodiscard]] ErrorSummary summarise(const geometry::Points3 &errors_mm);

// Residuals (14) at points that took no part in the fit. Points where the field has no inverse are NaN.
[[nodiscard]] geometry::Points3 residuals(const DistortionField &field, const geometry::Points3 &true_mm,
                                          const geometry::Points3 &imaged_mm);

// Section VI-A: every other pair (lattice.hpp) determines the field, the others verify it. Otherwise the sentence of
// fit().
[[nodiscard]] tl::expected<ErrorSummary, std::string> hold_out(const geometry::Points3 &true_mm,
                                                               const geometry::Points3 &imaged_mm);

} // namespace bregma::mri
