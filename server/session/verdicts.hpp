// What the data allow: may this registration be accepted, how good was this check touch, may the verification be
// confirmed. Pure functions; a refusal is the sentence that the person reads.
#pragma once

#include <map>
#include <optional>
#include <string>

#include "casefile/case.hpp"
#include "server/session/messages.hpp"

namespace bregma::server {

struct TargetTre {
  std::string target; // empty: the case has none
  double rms_mm = 0.0;
};

// The target with the largest predicted TRE.
[[nodiscard]] TargetTre worst_target(const casefile::Case &the_case, const RegistrationAccepted &registration);

// Only a candidate whose predicted TRE keeps limits.max_target_tre_mm at every target.
[[nodiscard]] std::optional<std::string> refuse_acceptance(const casefile::Case &the_case,
                                                           const wire::RegistrationState &estimate);
// Precondition: not refused.
[[nodiscard]] RegistrationAccepted accept(const wire::RegistrationState &estimate);

// A touch of the landmark with this index in the case, against the accepted registration.
[[nodiscard]] JudgedCheck judge_check(const casefile::Case &the_case, const RegistrationAccepted &registration,
                                      std::size_t landmark_index, const wire::Name &tool, const CaptureResult &touch);

// Needs min_checks landmarks, each within limits.max_check_mm, and all of them together no further off than the
// predicted error explains: the joint chi-square of all errors, which share the registration's, at kVerificationTail.
inline constexpr double kVerificationTail = 1e-3; // chance that a good registration is refused
[[nodiscard]] std::optional<std::string> refuse_verification(const casefile::Case &the_case,
                                                             const RegistrationAccepted &registration,
                                                             const std::map<std::string, JudgedCheck> &checks,
                                                             std::size_t min_checks);

// Why a capture failed; nothing when it did not.
[[nodiscard]] std::optional<std::string> refuse_capture(const CaptureRequest &request, const CaptureResult &result);

} // namespace bregma::server
