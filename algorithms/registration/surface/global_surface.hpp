// Registration of samples onto a whole head from any pose, with a verdict.
//
// Search: rotations spread evenly over SO(3) (super-Fibonacci spirals, Alexa 2022). For each one translation: the
// samples' own sphere says which way they bulge, and their middle is laid on the head in that direction. From there
// robust point-to-plane steps over the field's planes, on few samples for all starts, on more for the best of them; the
// survivors, thinned to distinct poses, end in the exact local registration. Nothing is random: the same samples give
// the same answer, with any number of threads.
//
// Verdict: hypotheses are compared by the likelihood of their residuals, normal with a share of outliers. "Found" needs
// all of: residuals as small as stated, no distinct pose nearly as likely, no free direction, and a shape that a plane,
// a sphere or a spheroid does not explain as well. Everything else is ambiguous or refused, with the reason and the
// spot of the surface whose touch would tell most.
//
// What it cannot know: whether the surface is this patient's, or its mirror image. A head that is nearly symmetric left
// to right is no ambiguity here, because no rotation exchanges its sides without turning the face away.
//
// Frames: samples in Source, the surface in Target (RAS for the advice's words), mm.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <string>

#include "algorithms/registration/surface/local_surface.hpp"

namespace bregma::registration {

struct GlobalOptions {
  double sigma_mm = 1.0;       // error of a sample along the normal, independent, 1-sigma
  double model_sigma_mm = 0.5; // skin give and segmentation: alike over correlation_length_mm
  double correlation_length_mm = 12.0;
  double outliers = 0.05;          // share of the samples that may be off the surface
  double max_uncertainty_mm = 4.0; // predicted RMS error on the samples beyond which a direction counts as free
  double max_dilution = 13.0;      // of the samples' arrangement, see GlobalResult
  double min_log_odds = 5.0;       // of the best pose against the rest: 150 to 1
  double distinct_mm = 10.0;       // poses under which the samples differ less, RMS, are the same
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
  double log_likelihood = 0.0; // natural, of the residuals; only differences mean anything
  double probability = 0.0;    // among the hypotheses
  double rms_mm = 0.0;         // of the inliers
  int inliers = 0;
};

inline constexpr std::size_t kMaxHypotheses = 8;
inline constexpr int kMinGlobalSamples = 20;

struct GlobalResult {
  Verdict verdict = Verdict::kRefused;
  VerdictReason reason = VerdictReason::kTooFewSamples;
  // The most likely pose; to be navigated by only when the verdict is found.
  PairedPose T_target_source;
  Matrix6d covariance = Matrix6d::Zero();
  std::array<PoseHypothesis, kMaxHypotheses> hypotheses{}; // distinct, the most likely first
  std::size_t hypothesis_count = 0;
  int count = 0;               // samples used
  double log_odds = 0.0;       // best against runner-up
  double shape_log_odds = 0.0; // best against plane, sphere, spheroid
  double scale = 0.0;          // residuals over the stated error
  // Predicted RMS error on the samples, with what rivals too near to be distinct add.
  double uncertainty_mm = 0.0;
  // That error for independent samples of 1 mm, times the square root of their number: what the arrangement alone does,
  // as the dilution of precision does in satellite navigation. Errors of skin and segmentation that do not average out
  // are multiplied by it however many samples there are. About 8 for a face, 20 for a vault.
  double dilution = 0.0;
  Vector3d touch_mm = Vector3d::Zero(); // on the surface: where the next touch would tell most
};

// The verdict in words, with the advice: for a person.
[[nodiscard]] std::string describe(const GlobalResult &result);

// Holds the working memory; locate() allocates only for its threads. One call at a time.
class GlobalRegistration {
public:
  // field outlives this. Samples beyond capacity are thinned evenly; those that are not finite are ignored. Throws
  // std::invalid_argument for options that make no sense.
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
