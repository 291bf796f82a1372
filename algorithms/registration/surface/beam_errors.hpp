// Refines the pose of points that a range sensor measured along one direction, with the errors that its points have in
// common: the sensor reads too far by an offset everywhere, and by an excess on tilted skin, excess * (1 - cos(tilt)).
//
// Both are unknown with a zero mean. The excess may be larger on skin that is tilted to one side, because such a sensor
// looks from the side: it has two slopes, over the normal's parts across the beam. It changes the shape of the scan,
// and is estimated together with the pose; the tilt is that of the surface where a point lies, which needs no dense
// scan. The offset moves the scan along the beam, where the pose can follow: only the covariance tells it. Gauss-Newton
// over exact closest points with Hampel's weights, nine unknowns; the covariance is the sandwich of local_surface.hpp,
// with the offset as one more unknown that keeps its prior.
//
// Frames: points in Source, surface in Target, mm; the covariance is a left perturbation in Target.
#pragma once

#include <span>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/surface/surface_field.hpp"

namespace bregma::registration {

struct BeamErrorOptions {
  double sigma_mm = 1.0;       // error of a point along the normal, independent, 1 sigma
  double model_sigma_mm = 0.5; // of skin and segmentation: correlated over correlation_length_mm
  double correlation_length_mm = 12.0;
  double offset_sigma_mm = 0.3; // 1 sigma
  double excess_sigma_mm = 5.0; // 1 sigma; 0: tilted skin is read as it is
  double max_tilt_rad = 1.2;    // 69 degrees; steeper points are not used
  int max_iterations = 100;
};

struct BeamErrorFit {
  bool converged = false;
  PairedPose T_target_source;
  Matrix6d covariance = Matrix6d::Zero();        // NaN unless converged
  double excess_mm = 0.0, excess_sigma_mm = 0.0; // the estimate without its slopes, and its 1 sigma
  int inliers = 0;                               // within three sigma (scaled) of the surface
  double rms_mm = 0.0;                           // of the inliers' distances from the surface, without the excess
};

// towards_sensor: unit, in Source, against the beam. start: near the pose, as GlobalRegistration finds it. Not
// converged for fewer than nine points that can be used. Throws std::invalid_argument for options out of range.
// Allocates; any thread.
[[nodiscard]] BeamErrorFit fit_beam_errors(const surface::SurfaceField &field, std::span<const Vector3d> source_mm,
                                           const Vector3d &towards_sensor, const PairedPose &start,
                                           const BeamErrorOptions &options = {});

} // namespace bregma::registration
