#include "clients/cli/wire_labels.hpp"

#include <array>
#include <cstddef>

#include "algorithms/tissue/model_verdict.hpp"

namespace bregma::cli {
namespace {

template <std::size_t N> std::string_view nth(const std::array<std::string_view, N> &words, std::int32_t value) {
  return value >= 0 && static_cast<std::size_t>(value) < N ? words[static_cast<std::size_t>(value)] : kNotKnownHere;
}

} // namespace

std::string_view session_label(wire::SessionState value) {
  static constexpr std::array<std::string_view, 9> kWords{
      "unknown", "idle", "case loaded", "registering", "registered", "verified", "navigating", "degraded", "fault"};
  return nth(kWords, value);
}

std::string_view pose_label(wire::PoseStatus value) {
  static constexpr std::array<std::string_view, 10> kWords{
      "unknown",          "live",           "unverified",     "stale",      "lost", "tool hidden",
      "reference hidden", "not calibrated", "not registered", "implausible"};
  return nth(kWords, value);
}

std::string_view plausibility_label(wire::PlausibilityReason value) {
  static constexpr std::array<std::string_view, 8> kWords{
      "unknown", "plausible", "frozen", "not a rotation", "outside the volume", "jump", "marker residual", "markers"};
  return nth(kWords, value);
}

std::string_view registration_label(wire::RegistrationStatus value) {
  static constexpr std::array<std::string_view, 5> kWords{"unknown", "none", "refused", "candidate", "accepted"};
  return nth(kWords, value);
}

std::string_view refusal_label(wire::RefusalReason value) {
  static constexpr std::array<std::string_view, 8> kWords{"unknown",
                                                          "none",
                                                          "too few fiducials",
                                                          "collinear fiducials",
                                                          "contradicting fiducial",
                                                          "direction not fixed",
                                                          "residual too large",
                                                          "not converged"};
  return nth(kWords, value);
}

std::string_view deformation_label(wire::DeformationStatus value) {
  static constexpr std::array<std::string_view, 5> kWords{"unknown", "no model", "valid", "extrapolating", "invalid"};
  return nth(kWords, value);
}

std::string_view deformation_reason_label(wire::DeformationReason value) {
  // The model's own reasons follow "none" in the order of tissue::ModelReason.
  constexpr std::int32_t kNone = bregma_wire_DEFORMATION_REASON_NONE;
  static_assert(bregma_wire_DEFORMATION_REASON_DIVERGED - kNone == static_cast<int>(tissue::ModelReason::kDiverged));
  if (value > kNone && value <= bregma_wire_DEFORMATION_REASON_DIVERGED) {
    return tissue::sentence_of(static_cast<tissue::ModelReason>(value - kNone));
  }
  switch (value) {
  case bregma_wire_DEFORMATION_REASON_UNKNOWN:
    return "unknown";
  case kNone:
    return "none";
  case bregma_wire_DEFORMATION_REASON_BUILDING:
    return "the model is being built";
  case bregma_wire_DEFORMATION_REASON_REFUSED:
    return "there is no model of this case's brain";
  case bregma_wire_DEFORMATION_REASON_POINT_OUTSIDE:
    return "the point is outside the mesh";
  default:
    return kNotKnownHere;
  }
}

std::string_view followed_label(wire::FollowedKind value) {
  static constexpr std::array<std::string_view, 3> kWords{"unknown", "target", "landmark"};
  return nth(kWords, value);
}

std::string_view phase_label(wire::ProbePhase value) {
  static constexpr std::array<std::string_view, 5> kWords{"unknown", "outside", "indentation", "penetration",
                                                          "withdrawal"};
  return nth(kWords, value);
}

std::string_view reject_label(wire::RejectReason value) {
  static constexpr std::array<std::string_view, 9> kWords{"unknown",        "not finite",         "not a rotation",
                                                          "time backwards", "time in the future", "unknown device",
                                                          "unknown tool",   "duplicate",          "malformed"};
  return nth(kWords, value);
}

std::string_view device_kind_label(wire::DeviceKind value) {
  static constexpr std::array<std::string_view, 7> kWords{"unknown", "tracker", "robot", "range",
                                                          "force",   "scanner", "coils"};
  return nth(kWords, value);
}

std::string_view device_status_label(wire::DeviceStatus value) {
  static constexpr std::array<std::string_view, 5> kWords{"unknown", "never seen", "live", "stale", "lost"};
  return nth(kWords, value);
}

std::string_view transit_source_label(wire::TransitSource value) {
  static constexpr std::array<std::string_view, 5> kWords{"unknown", "same host", "synchronised", "held", "envelope"};
  return nth(kWords, value);
}

std::string_view driver_state_label(wire::DriverState value) {
  static constexpr std::array<std::string_view, 5> kWords{"unknown", "connecting", "connected", "waiting", "stopped"};
  return nth(kWords, value);
}

std::string_view alarm_label(wire::AlarmState value) {
  static constexpr std::array<std::string_view, 4> kWords{"unknown", "raised", "acknowledged", "cleared"};
  return nth(kWords, value);
}

std::string_view severity_label(wire::AlarmSeverity value) {
  static constexpr std::array<std::string_view, 4> kWords{"unknown", "info", "warning", "critical"};
  return nth(kWords, value);
}

std::string_view result_label(wire::CommandResult value) {
  static constexpr std::array<std::string_view, 6> kWords{"unknown", "done",      "refused by state",
                                                          "refused", "malformed", "unsupported"};
  return nth(kWords, value);
}

} // namespace bregma::cli
