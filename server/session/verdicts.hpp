// Decisions from the data: acceptance of a registration, evaluation of a check touch, confirmation of the verification.
// Pure functions. A refusal is the text shown to the operator.
#pragma once

#include <map>
#include <optional>
#include <string>

#include "casefile/case.hpp"
#include "server/session/messages.hpp"

namespace bregma::server {

struct TargetTre {
  std::string target; // empty if the case has no target
  double rms_mm = 0.0;
  std::string placed_in = {};  // registered image in which it was planned; empty: the planning image
  double placing_rms_mm = 0.0; // part of rms_mm: the error of that image's registration
};

// The target with the largest predicted TRE.
[[nodiscard]] TargetTre worst_target(const casefile::Case &the_case, const RegistrationAccepted &registration);

// " (0.4 mm of it from the registration of image T2)"; empty for a target of the planning image.
[[nodiscard]] std::string placing_text(const TargetTre &tre);

// Requires a candidate whose predicted TRE is at most limits.max_target_tre_mm at every target.
[[nodiscard]] std::optional<std::string> refuse_acceptance(const casefile::Case &the_case,
                                                           const RegistrationEstimate &estimate);
// Precondition: not refused.
[[nodiscard]] RegistrationAccepted accept(const RegistrationEstimate &estimate);

// Evaluates a touch of the landmark with this index in the case, by the accepted registration.
[[nodiscard]] JudgedCheck judge_check(const casefile::Case &the_case, const RegistrationAccepted &registration,
                                      std::size_t landmark_index, const wire::Name &tool, const CaptureResult &touch);

// Requires min_checks landmarks, each within limits.max_check_mm, and joint consistency with the predicted error: a
// chi-square test of all errors, which have the registration's error in common, at the level kVerificationTail.
inline constexpr double kVerificationTail = 1e-3; // probability that a correct registration is refused
[[nodiscard]] std::optional<std::string> refuse_verification(const casefile::Case &the_case,
                                                             const RegistrationAccepted &registration,
                                                             const std::map<std::string, JudgedCheck> &checks,
                                                             std::size_t min_checks);

// The reason why a capture failed; empty if it succeeded.
[[nodiscard]] std::optional<std::string> refuse_capture(const CaptureRequest &request, const CaptureResult &result);

} // namespace bregma::server
