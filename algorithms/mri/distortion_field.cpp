#include "algorithms/mri/distortion_field.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "algorithms/mri/lattice.hpp"

namespace bregma::mri {

namespace {

using Eigen::Index;
using Eigen::Vector3d;
using geometry::Points3;
using registration::SplineOptions;
using registration::ThinPlateSpline;

constexpr int kHullDirections = 200;
constexpr double kQuantile95 = 2.795; // of the length of three independent normal coordinates, sigma 1
constexpr int kMaxInverseSteps = 60;
constexpr double kInverseTolerance = 1e-6; // mm
constexpr double kUsefulShare = 0.97;      // of the error held out without a spline
// Of the error at points held out that the spline itself may have between its centres.
constexpr double kSplineErrorShare = 0.5;
// A control point at a face stands for the half of a cell beyond it; from there the spline fades over one spacing.
constexpr double kWholeSpline = 0.5;
// Error outside by what is not harmonic, per its size inside and spacing of the distance. Of fields that are no
// solution of Laplace's equation (./dev bench mri --only pillars).
constexpr double kNotHarmonicGrowth = 3.0;

// Directions spread evenly over the sphere [Gonzalez 2010].
Points3 sphere_directions(int count) {
  Points3 out(3, count);
  for (Index i = 0; i < count; ++i) {
    const double z = (2.0 * static_cast<double>(i) + 1.0) / count - 1.0;
    const double angle = std::numbers::pi * (1.0 + std::sqrt(5.0)) * static_cast<double>(i);
    const double r = std::sqrt(1.0 - z * z);
    out.col(i) = Vector3d(r * std::cos(angle), r * std::sin(angle), z);
  }
  return out;
}

double rms(const Points3 &p) { return std::sqrt(p.colwise().squaredNorm().mean()); }

} // namespace

const char *name(Coverage coverage) noexcept {
  switch (coverage) {
  case Coverage::kInterpolates:
    return "interpolates";
  case Coverage::kExtrapolates:
    return "extrapolates";
  case Coverage::kUnknown:
    break;
  }
  return "unknown";
}

tl::expected<DistortionField, std::string> DistortionField::fit(const Points3 &true_mm, const Points3 &imaged_mm,
                                                                const FieldOptions &options) {
  if (true_mm.cols() != imaged_mm.cols()) {
    return tl::unexpected(std::to_string(true_mm.cols()) + " true points but " + std::to_string(imaged_mm.cols()) +
                          " imaged ones");
  }
  DistortionField out;
  out.options_ = options;
  out.control_mm_ = true_mm;
  Points3 residual = imaged_mm - true_mm;
  for (Index axis = 0; axis < 3; ++axis) {
    auto series = HarmonicSeries::fit(true_mm, residual.row(axis).transpose(), options.harmonics);
    if (!series) {
      return tl::unexpected(series.error());
    }
    for (Index i = 0; i < true_mm.cols(); ++i) {
      residual(axis, i) -= (*series)(true_mm.col(i));
    }
    out.harmonics_.push_back(std::move(*series));
  }
  // Phantoms have faces along their lattice.
  const LatticeSteps lattice = lattice_steps(true_mm);
  out.spacing_mm_ = lattice.spacing_mm;
  const Points3 faces = lattice.steps_mm.colwise().normalized();
  out.hull_directions_.resize(3, kHullDirections + 2 * faces.cols());
  out.hull_directions_ << sphere_directions(kHullDirections), faces, -faces;
  out.hull_extents_ = (out.hull_directions_.transpose() * true_mm).rowwise().maxCoeff();
  if (options.local_spline) {
    out.fit_spline(residual);
  }
  return out;
}

void DistortionField::fit_spline(const Points3 &residual_mm) {
  const Halves halves = every_other(control_mm_);
  const Points3 centres = control_mm_(Eigen::all, halves.used), values = residual_mm(Eigen::all, halves.used);
  const Points3 held_out = control_mm_(Eigen::all, halves.held_out);
  const Points3 expected = residual_mm(Eigen::all, halves.held_out);
  const double without = rms(expected);
  double best = kUsefulShare * without, smoothing = -1.0;
  for (const double relative : {1e-2, 1e-1, 1.0, 1e1, 1e2}) {
    SplineOptions options;
    options.regularisation = relative * spacing_mm_ * spacing_mm_;
    const auto spline = ThinPlateSpline<3>::fit(centres, values, options);
    if (!spline) {
      continue;
    }
    if (const double error = rms(spline->map(held_out) - expected); error < best) {
      best = error;
      smoothing = options.regularisation;
    }
  }
  if (smoothing < 0.0) {
    return;
  }
  SplineOptions options;
  options.regularisation = smoothing;
  if (auto spline = ThinPlateSpline<3>::fit(control_mm_, residual_mm, options)) {
    spline_ = std::move(*spline);
    spline_sigma_mm_ = kSplineErrorShare * best / std::sqrt(3.0);
    spline_part_mm_ = spline_->map(control_mm_).rowwise().norm() / std::sqrt(static_cast<double>(control_mm_.cols()));
  }
}

double DistortionField::distance_outside(const Vector &true_mm) const noexcept {
  double out = 0.0;
  for (Index i = 0; i < hull_extents_.size(); ++i) {
    out = std::max(out, hull_directions_.col(i).dot(true_mm) - hull_extents_[i]);
  }
  return out;
}

Vector3d DistortionField::to_imaged(const Vector &true_mm) const noexcept {
  Vector out = true_mm;
  for (Index axis = 0; axis < 3; ++axis) {
    out[axis] += harmonics_[static_cast<std::size_t>(axis)](true_mm);
  }
  if (spline_) {
    const double weight = 1.0 + kWholeSpline - distance_outside(true_mm) / spacing_mm_;
    if (weight > 0.0) {
      out += std::min(weight, 1.0) * (*spline_)(true_mm);
    }
  }
  return out;
}

std::optional<Vector3d> DistortionField::to_true(const Vector &imaged_mm) const noexcept {
  // true = imaged - displacement(true) contracts while the displacement's slope is below 1. The step is halved where it
  // does not shrink.
  Vector p = imaged_mm;
  double before = std::numeric_limits<double>::infinity(), fraction = 1.0;
  for (int step = 0; step < kMaxInverseSteps; ++step) {
    const Vector move = imaged_mm - to_imaged(p);
    const double length = move.norm();
    if (!(length < 1e6)) {
      return std::nullopt;
    }
    if (length < kInverseTolerance) {
      return p;
    }
    fraction = length < before ? fraction : std::max(0.5 * fraction, 0.1);
    before = length;
    p += fraction * move;
  }
  return std::nullopt;
}

DistortionField::Assessment DistortionField::assess(const Vector &true_mm) const noexcept {
  Assessment out;
  out.distance_mm = distance_outside(true_mm);
  // What is not harmonic inside is not continued outside, where it may be as large and grow.
  const Vector not_continued = kNotHarmonicGrowth * out.distance_mm / spacing_mm_ * spline_part_mm_;
  for (Index axis = 0; axis < 3; ++axis) {
    const double sigma = harmonics_[static_cast<std::size_t>(axis)].estimate(true_mm).sigma;
    out.sigma_mm[axis] = std::hypot(sigma, spline_ ? spline_sigma_mm_ : 0.0, not_continued[axis]);
  }
  // At most the quantile of equal coordinates with the same variance in sum.
  out.error_95_mm = kQuantile95 / std::sqrt(3.0) * out.sigma_mm.norm();
  out.error_95_mm = std::max(out.error_95_mm, 1.96 * out.sigma_mm.maxCoeff());
  // A hollow phantom has no points inside, but harmonics are determined there by those around.
  if (out.distance_mm <= 0.0) {
    out.coverage = Coverage::kInterpolates;
  } else if (out.error_95_mm <= options_.max_error_95_mm && out.distance_mm <= options_.max_distance_mm) {
    out.coverage = Coverage::kExtrapolates;
  }
  if (!(out.error_95_mm <= options_.max_error_95_mm)) {
    out.coverage = Coverage::kUnknown;
  }
  return out;
}

ErrorSummary summarise(const Points3 &errors_mm) {
  const auto row = [](const Eigen::ArrayXd &values) {
    ErrorSummary::Row out;
    out.mean_mm = values.mean();
    out.deviation_mm = std::sqrt((values - out.mean_mm).square().mean());
    out.max_mm = values.maxCoeff();
    return out;
  };
  ErrorSummary out;
  if (errors_mm.cols() == 0) {
    return out;
  }
  for (Index axis = 0; axis < 3; ++axis) {
    out.axis[static_cast<std::size_t>(axis)] = row(errors_mm.row(axis).transpose().array().abs());
  }
  out.overall = row(errors_mm.colwise().norm().transpose().array());
  return out;
}

Points3 residuals(const DistortionField &field, const Points3 &true_mm, const Points3 &imaged_mm) {
  Points3 out(3, true_mm.cols());
  for (Index i = 0; i < true_mm.cols(); ++i) {
    const auto corrected = field.to_true(imaged_mm.col(i));
    out.col(i) = corrected ? Vector3d(true_mm.col(i) - *corrected)
                           : Vector3d(Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  }
  return out;
}

tl::expected<ErrorSummary, std::string> hold_out(const geometry::Points3 &true_mm, const geometry::Points3 &imaged_mm) {
  const Halves halves = every_other(true_mm);
  const auto field = DistortionField::fit(true_mm(Eigen::all, halves.used), imaged_mm(Eigen::all, halves.used));
  if (!field) {
    return tl::make_unexpected("every other control point does not determine the field: " + field.error());
  }
  return summarise(residuals(*field, true_mm(Eigen::all, halves.held_out), imaged_mm(Eigen::all, halves.held_out)));
}

} // namespace bregma::mri
