#include <cstdio>

#include "algorithms/registration/surface/global_surface.hpp"

namespace bregma::registration {

namespace {

std::string number(double value, int digits) {
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

std::string place(const Vector3d &p) {
  return "at (" + number(p.x(), 0) + ", " + number(p.y(), 0) + ", " + number(p.z(), 0) + ") mm";
}

} // namespace

std::string describe(const GlobalResult &result) {
  const std::string touch = "touch the surface " + place(result.touch_mm) + " next";
  switch (result.reason) {
  case VerdictReason::kNone:
    return "found, " + number(result.uncertainty_mm, 1) + " mm predicted on the samples";
  case VerdictReason::kTooFewSamples:
    return "refused: " + std::to_string(result.count) + " samples, at least " + std::to_string(kMinGlobalSamples) +
           " are needed; trace more of the face and the forehead";
  case VerdictReason::kFitsBadly:
    return "refused: no pose fits, the best leaves residuals " + number(result.scale, 1) +
           " times the stated error with " + std::to_string(result.count - result.hypotheses[0].inliers) + " of " +
           std::to_string(result.count) +
           " samples off the surface; is this the right patient and unit, and was the pointer on the skin?";
  case VerdictReason::kAnotherPose:
    return "ambiguous: another pose is nearly as likely (log odds " + number(result.log_odds, 1) + "); " + touch;
  case VerdictReason::kDirectionNotFixed:
    return "ambiguous: the samples can slide along the surface, " + number(result.uncertainty_mm, 1) +
           " mm predicted on them, dilution " + number(result.dilution, 0) + "; " + touch;
  case VerdictReason::kDegenerateShape:
    return "ambiguous: a plane, a sphere or a spheroid explains the samples as well as the head does; " + touch +
           ", or trace the nose and the brows";
  }
  return {};
}

} // namespace bregma::registration
