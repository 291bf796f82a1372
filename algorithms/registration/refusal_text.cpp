// Texts about an estimate for the operator.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "algorithms/registration/registration.hpp"

namespace bregma::registration {

std::string_view name_direction(const geometry::Vector6d &direction) noexcept {
  // Image is RAS: x to the right, y to the front, z up.
  static constexpr std::array<std::string_view, 3> kRotations = {
      "rotation about left-right", "rotation about anterior-posterior", "rotation about superior-inferior"};
  static constexpr std::array<std::string_view, 3> kTranslations = {
      "translation along left-right", "translation along anterior-posterior", "translation along superior-inferior"};
  // A motion about an axis within 150 mm of the centre is called a rotation, even if the centre itself mostly shifts:
  // three fiducials on the forehead leave a rotation about the forehead free. Rotations are scaled by 80 mm.
  constexpr double kReach = 150.0 / 80.0;
  const bool turns = kReach * direction.head<3>().norm() > direction.tail<3>().norm();
  Eigen::Index axis = 0;
  (turns ? direction.head<3>() : direction.tail<3>()).cwiseAbs().maxCoeff(&axis);
  return (turns ? kRotations : kTranslations)[static_cast<std::size_t>(axis)];
}

void describe(const RegistrationResult &result, const RegistrationOptions &options, std::string_view subject,
              std::string_view target, std::span<char> out) noexcept {
  if (out.empty()) {
    return;
  }
  out[0] = '\0';
  const auto length = [](std::string_view text) { return static_cast<int>(text.size()); };
  switch (result.refusal) {
  case Refusal::kNone:
    break;
  case Refusal::kTooFewFiducials:
    std::snprintf(out.data(), out.size(), "%d fiducials touched, at least 3 are needed", result.fiducial_count);
    break;
  case Refusal::kCollinearFiducials:
    std::snprintf(out.data(), out.size(),
                  "the %d fiducials lie nearly on a line (%.1f mm off it, %.1f mm needed): touch one away from it",
                  result.fiducial_count, result.spread_mm, options.min_spread_mm);
    break;
  case Refusal::kContradictingFiducial: {
    if (result.suspect_count > 1) {
      double farthest_mm = 0.0;
      for (std::size_t i = 0; i < result.suspects.size(); ++i) {
        farthest_mm = result.suspects[i] ? std::max(farthest_mm, result.fiducials[i].leave_one_out_mm) : farthest_mm;
      }
      std::snprintf(out.data(), out.size(),
                    "fiducials %.*s contradict the others: up to %.1f mm from where they place them; touch them again "
                    "or remove them",
                    length(subject), subject.data(), farthest_mm);
    } else {
      std::snprintf(
          out.data(), out.size(),
          "fiducial %.*s contradicts the others: %.1f mm from where they place it; touch it again or remove it",
          length(subject), subject.data(), result.fiducials[static_cast<std::size_t>(result.suspect)].leave_one_out_mm);
    }
    break;
  }
  case Refusal::kDirectionNotFixed: {
    const std::string_view direction = name_direction(result.weakest);
    const std::string_view where = target.empty() ? "a point inside the head" : target;
    std::snprintf(
        out.data(), out.size(),
        "too little surface to fix %.*s: predicted error at %.*s %.1f mm, limit %.1f mm; trace more of the head",
        length(direction), direction.data(), length(where), where.data(), result.worst_target_tre_mm,
        options.max_target_tre_mm);
    break;
  }
  case Refusal::kFreTooLarge:
    std::snprintf(out.data(), out.size(),
                  "FRE is %.2f mm where the stated errors give %.2f mm, and the wrong fiducials cannot be identified: "
                  "touch them again",
                  result.fre_mm, result.fre_expected_mm);
    break;
  case Refusal::kNotConverged:
    std::snprintf(out.data(), out.size(), "the estimate did not converge in %d iterations", options.max_iterations);
    break;
  }
}

void describe_excess(const RegistrationResult &result, const RegistrationOptions &options,
                     std::span<char> out) noexcept {
  if (out.empty()) {
    return;
  }
  out[0] = '\0';
  if (!(result.excess_sigma_mm > 0.0)) {
    return;
  }
  constexpr double kKnown = 0.7; // of the prior's sigma
  if (result.excess_sigma_mm > kKnown * options.excess_sigma_mm) {
    std::snprintf(out.data(), out.size(),
                  "the scan does not show by how much the range sensor reads too far on tilted skin (%.1f mm, 1 sigma, "
                  "is assumed): scan skin of different tilts",
                  options.excess_sigma_mm);
  } else {
    std::snprintf(
        out.data(), out.size(),
        "on tilted skin the range sensor reads too far by %.1f mm (1 sigma %.1f) times 1 - cos(tilt): removed",
        result.excess_mm[0], result.excess_sigma_mm);
  }
}

} // namespace bregma::registration
