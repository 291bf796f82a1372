#include "clients/cli/wire_labels.hpp"

#include <array>
#include <cstddef>

namespace bregma::cli {
namespace {

template <class Enum, std::size_t N> std::string_view nth(const std::array<std::string_view, N> &words, Enum value) {
  const auto index = static_cast<std::size_t>(value);
  return index < N ? words[index] : "invalid";
}

} // namespace

std::string_view label(wire::SessionState value) {
  static constexpr std::array<std::string_view, 8> kWords{"idle",     "case loaded", "registering", "registered",
                                                          "verified", "navigating",  "degraded",    "fault"};
  return nth(kWords, value);
}

std::string_view label(wire::PoseStatus value) {
  static constexpr std::array<std::string_view, 9> kWords{
      "unknown",          "live",           "unverified",    "stale", "lost", "tool hidden",
      "reference hidden", "not calibrated", "not registered"};
  return nth(kWords, value);
}

std::string_view label(wire::RegistrationStatus value) {
  static constexpr std::array<std::string_view, 4> kWords{"none", "refused", "candidate", "accepted"};
  return nth(kWords, value);
}

std::string_view label(wire::RefusalReason value) {
  static constexpr std::array<std::string_view, 7> kWords{"none",
                                                          "too few fiducials",
                                                          "collinear fiducials",
                                                          "contradicting fiducial",
                                                          "direction not fixed",
                                                          "residual too large",
                                                          "not converged"};
  return nth(kWords, value);
}

std::string_view label(wire::DeformationStatus value) {
  static constexpr std::array<std::string_view, 4> kWords{"no model", "valid", "extrapolating", "invalid"};
  return nth(kWords, value);
}

std::string_view label(wire::DeformationReason value) {
  static constexpr std::array<std::string_view, 13> kWords{"none",
                                                           "the tissue still swings",
                                                           "the probe is not seen",
                                                           "the probe has jumped",
                                                           "the probe's path is not known",
                                                           "too slow",
                                                           "the probe has left the mesh",
                                                           "tissue is turned inside out for a moment",
                                                           "a step was taken back",
                                                           "put back to rest",
                                                           "the model is being built",
                                                           "no model can be made of this brain",
                                                           "the point is outside the mesh"};
  return nth(kWords, value);
}

std::string_view label(wire::FollowedKind value) {
  static constexpr std::array<std::string_view, 2> kWords{"target", "landmark"};
  return nth(kWords, value);
}

std::string_view label(wire::ProbePhase value) {
  static constexpr std::array<std::string_view, 4> kWords{"outside", "indentation", "penetration", "withdrawal"};
  return nth(kWords, value);
}

std::string_view label(wire::RejectReason value) {
  static constexpr std::array<std::string_view, bregma_wire_REJECT_REASONS> kWords{
      "not finite",     "not a rotation", "time backwards", "time in the future",
      "unknown device", "unknown tool",   "duplicate",      "malformed"};
  return nth(kWords, value);
}

std::string_view label(wire::DeviceKind value) {
  static constexpr std::array<std::string_view, 4> kWords{"tracker", "robot", "range", "force"};
  return nth(kWords, value);
}

std::string_view label(wire::DeviceStatus value) {
  static constexpr std::array<std::string_view, 4> kWords{"never seen", "live", "stale", "lost"};
  return nth(kWords, value);
}

std::string_view label(wire::AlarmState value) {
  static constexpr std::array<std::string_view, 3> kWords{"raised", "acknowledged", "cleared"};
  return nth(kWords, value);
}

std::string_view label(wire::AlarmSeverity value) {
  static constexpr std::array<std::string_view, 3> kWords{"info", "warning", "critical"};
  return nth(kWords, value);
}

std::string_view label(wire::CommandKind value) {
  static constexpr std::array<std::string_view, 15> kWords{
      "load case",          "start pivot",          "finish pivot",
      "start registration", "capture fiducial",     "remove fiducial",
      "start trace",        "stop trace",           "accept registration",
      "check touch",        "confirm verification", "start navigation",
      "stop navigation",    "acknowledge alarm",    "close case"};
  return nth(kWords, value);
}

std::string_view label(wire::CommandResult value) {
  static constexpr std::array<std::string_view, 4> kWords{"done", "refused by state", "refused", "malformed"};
  return nth(kWords, value);
}

} // namespace bregma::cli
