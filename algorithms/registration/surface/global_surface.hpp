// Registration of samples onto a whole head from any pose, with a verdict.
//
// Search: rotations spread evenly over SO(3) by super-Fibonacci spirals [Alexa 2022]. Each has one translation: a
// sphere fitted to the samples gives the direction in which they bulge, and their centroid is placed on the head there.
// Robust point-to-plane steps over the field's planes follow, on few samples for all starts, and on more for the best.
// The remaining distinct poses are refined by the exact local registration. Nothing is random: the same samples give
// the same answer, with any number of threads.
//
// Verdict: hypotheses are compared by the likelihood of their residuals, normal with a fraction of outliers. "Found"
// requires all of: residuals as small as stated, no distinct pose nearly as likely, no free direction, and a shape that
// a plane, a sphere or a spheroid does not explain as well. Everything else is ambiguous or refused, with the reason
// and the point of the surface whose touch would add the most information.
//
// It cannot detect a surface of another patient, or its mirror image. A head that is nearly symmetric left to right is
// not ambiguous here, because no rotation exchanges its sides without turning the face away.
//
// Frames: samples in Source, the surface in Target (RAS for the advice in words), mm.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>

#include "algorithms/registration/surface/local_surface.hpp"

namespace bregma::registration {

struct GlobalOptions {
  double sigma_mm = 1.0;       // error of a sample along the normal, independent, 1-sigma
  double model_sigma_mm = 0.5; // skin compression and segmentation: correlated over correlation_length_mm
  double correlation_length_mm = 12.0;
  double outliers = 0.05;          // fraction of the samples that may be off the surface
  double max_uncertainty_mm = 4.0; // above this predicted RMS error on the samples a direction counts as free
  double max_dilution = 13.0;      // dilution of the samples' arrangement, see GlobalResult
  double min_log_odds = 5.0;       // best pose against the rest: 150 to 1
  double distinct_mm = 10.0;       // poses that move the samples by less, RMS, count as the same
  int rotations = 4000;
  int threads = 1;
};

enum class Verdict { kFound, kAmbiguous, kRefused };
enum class VerdictReason {
  kNone,
  kTooFewSamples,     // refused
  kFitsBadly,         // refused: no pose explains the samples within the stated error
  kAnotherPose,       // ambiguous: a distinct pose is nearly as likely
  kDirectionNotFixed, // ambiguous: the pose can slide or turn along the surface
  kDegenerateShape    // ambiguous: a plane, sphere or spheroid explains the samples as well
};

struct PoseHypothesis {
  PairedPose T_target_source;
  double log_likelihood = 0.0; // natural, of the residuals; only differences are meaningful
  double probability = 0.0;    // among the hypotheses
  double rms_mm = 0.0;         // RMS residual of the inliers
  int inliers = 0;
};

inline constexpr std::size_t kMaxHypotheses = 8;
inline constexpr int kMinGlobalSamples = 20;

struct GlobalResult {
  Verdict verdict = Verdict::kRefused;
  VerdictReason reason = VerdictReason::kTooFewSamples;
  // The most likely pose; use it for navigation only when the verdict is found.
  PairedPose T_target_source;
  Matrix6d covariance = Matrix6d::Zero();
  std::array<PoseHypothesis, kMaxHypotheses> hypotheses{}; // distinct, the most likely first
  std::size_t hypothesis_count = 0;
  int count = 0;               // samples used
  double log_odds = 0.0;       // best against runner-up
  double shape_log_odds = 0.0; // best against plane, sphere, spheroid
  double scale = 0.0;          // residuals over the stated error
  // Predicted RMS error on the samples, including hypotheses that are too close to be distinct.
  double uncertainty_mm = 0.0;
  // That error for independent samples of 1 mm, times the square root of their number: the effect of the arrangement
  // alone, like the dilution of precision in satellite navigation. Errors of skin and segmentation that do not average
  // out are multiplied by it, for any number of samples. About 8 for a face, 20 for a vault.
  double dilution = 0.0;
  Vector3d touch_mm = Vector3d::Zero(); // point of the surface where the next touch would add the most information
};

// The verdict in words, with advice for the operator.
[[nodiscard]] std::string describe(const GlobalResult &result);

// Holds the working memory; locate() allocates only for its threads. One call at a time.
class GlobalRegistration {
public:
  // field outlives this. Samples beyond capacity are thinned evenly; those that are not finite are ignored. Throws
  // std::invalid_argument for options out of range.
  GlobalRegistration(const surface::SurfaceField &field, const GlobalOptions &options, std::size_t capacity = 2000);
  ~GlobalRegistration();
  GlobalRegistration(GlobalRegistration &&) noexcept;
  GlobalRegistration &operator=(GlobalRegistration &&) noexcept;

  const GlobalResult &locate(std::span<const Vector3d> source_mm);

private:
  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

} // namespace bregma::registration
