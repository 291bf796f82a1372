// Local registration of samples onto a surface or a cloud, from a start pose close to the true pose.
//
// Gauss-Newton on SO(3) x R3 over closest points: point to plane [Chen 1992] or point to point [Besl 1992], by
// iteratively reweighted least squares with a robust loss, optionally trimmed [Chetverikov 2002]. On a mesh the first
// steps use the tangent planes of a SurfaceField, and the samples' own spread as the scale of the loss: wide at first,
// so that a start 20 degrees off does not look like outliers. The last steps use exact closest points and the stated
// sigma. The covariance is the sandwich A^-1 B A^-1 with the correlation of neighbouring samples in B, as in
// registration.hpp.
//
// Frames: samples in Source, surface in Target, mm; the covariance is a left perturbation in Target.
#pragma once

#include <memory>
#include <span>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/surface/cloud_model.hpp"
#include "algorithms/surface/surface_field.hpp"

namespace bregma::registration {

enum class SurfaceMetric { kPointToPlane, kPointToPoint };
// Tukey's, Huber's, Geman and McClure's loss are 95 % efficient for normal errors. Hampel's, with full weight up to
// 2.5 sigma and none beyond 4.5, is 99 % efficient.
enum class RobustLoss { kSquare, kHuber, kTukey, kGemanMcClure, kHampel };

struct LocalOptions {
  SurfaceMetric metric = SurfaceMetric::kPointToPlane;
  RobustLoss loss = RobustLoss::kHampel;
  double trim = 0.0;                   // fraction of the samples, the farthest, that is left out; below 0.9
  double sigma_mm = 1.0;               // error of a sample along the surface's normal, 1-sigma
  double correlation_length_mm = 12.0; // errors are correlated by exp(-d^2 / 2 l^2); 0: independent
  double correlated_fraction = 1.0; // correlated fraction of the variance (skin, segmentation); the rest is independent
  int max_iterations = 80;
};

struct LocalFit {
  bool converged = false; // the last step moved a head by less than 5 micrometres (50 at the maximum of iterations)
  int iterations = 0;
  PairedPose T_target_source;
  Matrix6d covariance = Matrix6d::Zero(); // NaN where the samples do not determine the pose
  int count = 0;                          // samples used
  int inliers = 0;                        // within three sigma (scaled) of the surface
  double rms_mm = 0.0;                    // distance of the inliers from the surface
  double scale = 1.0;                     // factor by which sigma_mm had to be multiplied
  double effective = 0.0;                 // effective number of independent inliers
};

// Owns the work space: fit() neither allocates nor throws nor locks. One thread at a time; several estimators may share
// a field or a cloud.
class LocalRegistration {
public:
  // field or cloud outlives this. Samples beyond capacity, and samples that are not finite, are ignored. Throws
  // std::invalid_argument for options out of range, and for point-to-plane on a cloud without normals.
  LocalRegistration(const surface::SurfaceField &field, const LocalOptions &options, std::size_t capacity = 2000);
  LocalRegistration(const surface::CloudModel &cloud, const LocalOptions &options, std::size_t capacity = 2000);
  ~LocalRegistration();
  LocalRegistration(LocalRegistration &&) noexcept;
  LocalRegistration &operator=(LocalRegistration &&) noexcept;

  // Fewer than six samples, or a start that is not finite: not converged, the start is returned.
  const LocalFit &fit(std::span<const Vector3d> source_mm, const PairedPose &start) noexcept;
  // The residuals of the last fit, one per used sample: signed distance from the surface, in mm.
  [[nodiscard]] std::span<const double> residuals_mm() const noexcept;

private:
  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

} // namespace bregma::registration
