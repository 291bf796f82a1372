// The words with which the wire's states are shown to a person and written to JSON. A value that the wire does not
// define is "invalid", never the nearest word.
#pragma once

#include <string_view>

#include "idl/topics.hpp"

namespace bregma::cli {

[[nodiscard]] std::string_view label(wire::SessionState value);
[[nodiscard]] std::string_view label(wire::PoseStatus value);
[[nodiscard]] std::string_view label(wire::RegistrationStatus value);
[[nodiscard]] std::string_view label(wire::RefusalReason value);
[[nodiscard]] std::string_view label(wire::DeformationStatus value);
[[nodiscard]] std::string_view label(wire::DeformationReason value);
[[nodiscard]] std::string_view label(wire::FollowedKind value);
[[nodiscard]] std::string_view label(wire::ProbePhase value);
[[nodiscard]] std::string_view label(wire::RejectReason value);
[[nodiscard]] std::string_view label(wire::DeviceKind value);
[[nodiscard]] std::string_view label(wire::DeviceStatus value);
[[nodiscard]] std::string_view label(wire::AlarmState value);
[[nodiscard]] std::string_view label(wire::AlarmSeverity value);
[[nodiscard]] std::string_view label(wire::CommandKind value);
[[nodiscard]] std::string_view label(wire::CommandResult value);

} // namespace bregma::cli
