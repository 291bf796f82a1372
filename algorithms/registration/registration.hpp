// The registration of the patient: one estimate of T_image_reference from touched fiducials and traced skin.
//
// Maximum a posteriori by Gauss-Newton on SO(3) x R3: point terms weighted by their full covariances, point-to-plane
// terms for the surface with Tukey's weights. Errors of the skin and of its segmentation are correlated
// over correlation_length_mm. Each sample is therefore down-weighted by the sum of its correlations with the others,
// and the covariance is the sandwich A^-1 B A^-1 with the correlations in B [White 1980]. Where surface residuals
// exceed the stated sigma, the stated sigma is scaled up.
//
// Samples of a range sensor have a common error that changes the shape of a scan: such a sensor reads too far on tilted
// skin (surface/tilt_excess.hpp). The excess and its two slopes are estimated together with the pose; the covariance
// contains what stays unknown of them. The tilt is that of the surface where a sample lies. What a scan does not show
// keeps its prior, of zero mean.
//
// Frames: fiducials and samples in Reference, their counterparts and the surface in Image, mm. The covariance is a left
// perturbation in Image (geometry/pose_covariance.hpp).
#pragma once

#include <memory>
#include <span>
#include <string_view>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/surface/surface_model.hpp"

namespace bregma::registration {

inline constexpr int kMaxFiducials = 64;

using ImageFromReference = geometry::Rigid3<geometry::frame::Image, geometry::frame::Reference>;

struct FiducialObservation {
  Vector3d reference_mm = Vector3d::Zero();
  Matrix3d reference_covariance = Matrix3d::Zero(); // tracker, pivot and placement of the touch
  Vector3d image_mm = Vector3d::Zero();
  Matrix3d image_covariance = Matrix3d::Zero(); // placement in the image
};

struct SurfaceSample {
  Vector3d reference_mm = Vector3d::Zero();
  Matrix3d covariance = Matrix3d::Zero(); // the sample's own error (tracker, pivot), in Reference; may be zero
  // Of a sample by a range sensor: unit, against the beam, and across it, fixed in the sensor; in Reference. Zero: the
  // skin was touched.
  Vector3d towards_sensor = Vector3d::Zero();
  Vector3d across = Vector3d::Zero();
};

struct RegistrationOptions {
  double surface_sigma_mm = 0.7;       // skin compression and segmentation, 1-sigma along the normal
  double correlation_length_mm = 12.0; // over which they are correlated, by exp(-d^2 / 2 l^2)
  double excess_sigma_mm = 5.0;        // 1 sigma of the excess before the scan; 0: tilted skin is read as it is
  double max_tilt_rad = 1.2;           // 69 degrees; samples of a range sensor on steeper skin have no weight
  double max_target_tre_mm = 2.0;      // above this predicted RMS at a target a direction counts as not fixed
  double min_spread_mm = 5.0;          // RMS distance of the fiducials from their best line
  double false_refusal = 0.002;        // probability that good fiducials are refused as contradicting, in total
  int max_iterations = 50;
};

enum class Refusal { // corresponds to RefusalReason on the wire
  kNone,
  kTooFewFiducials,
  kCollinearFiducials,
  kContradictingFiducial,
  kDirectionNotFixed,
  kFreTooLarge,
  kNotConverged
};

struct RegistrationResult {
  Refusal refusal = Refusal::kTooFewFiducials;
  // Valid unless refused for too few or collinear fiducials or as not converged. A refused estimate can still be shown
  // with its residuals, so that the operator sees what to touch again, but must not be used for navigation.
  bool has_estimate = false;
  ImageFromReference T_image_reference;
  Matrix6d covariance = Matrix6d::Zero();

  int fiducial_count = 0;
  // In the given order; leave-one-out within the joint estimate. For kContradictingFiducial, leave-one-out and p-value
  // are predicted from the fiducials that agree (robust_points.hpp).
  std::array<FiducialFit, kMaxFiducials> fiducials{};
  std::array<bool, kMaxFiducials> suspects{}; // kContradictingFiducial: those that contradict the rest
  int suspect_count = 0;
  int suspect = -1; // the least probable of them
  double fre_mm = 0.0;
  double fre_expected_mm = 0.0;
  double chi_square = 0.0; // residual of the fiducials only, 3 N - 6 degrees of freedom
  double p_value = 1.0;

  int surface_count = 0;    // samples used
  int surface_left_out = 0; // number of these without weight, far from the surface
  double surface_rms_mm = 0.0;
  double surface_scale = 1.0;     // factor by which surface_sigma_mm had to be multiplied
  double surface_effective = 0.0; // effective number of independent samples

  int beam_count = 0;                    // of the samples, those by a range sensor
  Vector3d excess_mm = Vector3d::Zero(); // their excess and its slopes, which surface_rms_mm is without
  double excess_sigma_mm = 0.0;          // 1 sigma of the first; 0: there are no such samples

  // The motion with the largest uncertainty, about the head's centre; rotations are scaled by 80 mm.
  geometry::Vector6d weakest = geometry::Vector6d::Zero(); // unit; rotation, translation
  double weakest_sigma_mm = 0.0;
  int worst_target = -1; // index of the target with the largest predicted TRE; -1: the head's centre
  double worst_target_tre_mm = 0.0;

  double spread_mm = 0.0; // second principal spread of the fiducials
  int iterations = 0;
};

// RegistrationResult::weakest in words, for example "translation along left-right" or "rotation about
// superior-inferior".
[[nodiscard]] std::string_view name_direction(const geometry::Vector6d &direction) noexcept;

// The reason of a refusal and advice for the operator; empty when not refused. NUL-terminated, cut at the end of out.
// subject: the names of the suspect fiducials; target: the name of the worst target. Does not allocate.
void describe(const RegistrationResult &result, const RegistrationOptions &options, std::string_view subject,
              std::string_view target, std::span<char> out) noexcept;

// What is known of the excess on tilted skin; empty without samples of a range sensor. As above.
void describe_excess(const RegistrationResult &result, const RegistrationOptions &options,
                     std::span<char> out) noexcept;

// Owns the work space of an estimate, so that a loop can call it without allocation. One thread at a time.
class RegistrationEstimator {
public:
  // surface: in Image, may be null (then samples are ignored), outlives the estimator. Samples beyond the first
  // max_surface_samples, and samples that are not finite, are ignored; so are fiducials beyond kMaxFiducials.
  RegistrationEstimator(const surface::SurfaceModel *surface, const RegistrationOptions &options,
                        int max_surface_samples = 2000);
  ~RegistrationEstimator();
  RegistrationEstimator(RegistrationEstimator &&) noexcept;
  RegistrationEstimator &operator=(RegistrationEstimator &&) noexcept;

  // targets_image_mm: points of interest for the accuracy. start: a previous estimate; default: the fiducials' own fit.
  // Does not allocate, throw or lock. The result is valid until the next call.
  const RegistrationResult &estimate(std::span<const FiducialObservation> fiducials,
                                     std::span<const SurfaceSample> samples, std::span<const Vector3d> targets_image_mm,
                                     const ImageFromReference *start = nullptr) noexcept;

  // From a pose that a search over all poses has found (global_surface.hpp). The surface then replaces the fiducials,
  // of which there may be fewer than three, or none. Without any, FRE and its probability are NaN.
  const RegistrationResult &estimate_located(std::span<const FiducialObservation> fiducials,
                                             std::span<const SurfaceSample> samples,
                                             std::span<const Vector3d> targets_image_mm,
                                             const ImageFromReference &located) noexcept;

  [[nodiscard]] const RegistrationOptions &options() const noexcept;

private:
  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

} // namespace bregma::registration
