// Names of the wire's states for output and JSON. A value that the wire does not define is "invalid".
#pragma once

#include <string_view>

#include "idl/topics.hpp"

namespace bregma::cli {

inline constexpr std::string_view kNotKnownHere = "not known here"; // a newer program's value, or nonsense

[[nodiscard]] std::string_view session_label(wire::SessionState value);
[[nodiscard]] std::string_view pose_label(wire::PoseStatus value);
[[nodiscard]] std::string_view plausibility_label(wire::PlausibilityReason value);
[[nodiscard]] std::string_view registration_label(wire::RegistrationStatus value);
[[nodiscard]] std::string_view refusal_label(wire::RefusalReason value);
[[nodiscard]] std::string_view deformation_label(wire::DeformationStatus value);
[[nodiscard]] std::string_view deformation_reason_label(wire::DeformationReason value);
[[nodiscard]] std::string_view followed_label(wire::FollowedKind value);
[[nodiscard]] std::string_view phase_label(wire::ProbePhase value);
[[nodiscard]] std::string_view reject_label(wire::RejectReason value);
[[nodiscard]] std::string_view device_kind_label(wire::DeviceKind value);
[[nodiscard]] std::string_view device_status_label(wire::DeviceStatus value);
[[nodiscard]] std::string_view transit_source_label(wire::TransitSource value);
[[nodiscard]] std::string_view driver_state_label(wire::DriverState value);
[[nodiscard]] std::string_view alarm_label(wire::AlarmState value);
[[nodiscard]] std::string_view severity_label(wire::AlarmSeverity value);
[[nodiscard]] std::string_view result_label(wire::CommandResult value);

} // namespace bregma::cli
