// Records of the registration of a robot to a scanner, and of the tools that arms carry. Pure functions.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "clients/gateway/records.hpp"
#include "clients/live/snapshot.hpp"

namespace bregma::gateway {

// ms: of a time on the daemon's clock. Without pose, validity and next step of a daemon that is not alive.
[[nodiscard]] Scanner scanner_record(const wire::ScannerRegistration &state, bool daemon_alive,
                                     const std::function<double(std::int64_t)> &ms);
[[nodiscard]] std::vector<ScannerCoil> scanner_coil_records(const wire::ScannerRegistration &state);

// Without a pose if it must not be shown at now_ns (CLOCK_BOOTTIME), by valid_for_ns of the daemon.
[[nodiscard]] RobotTool robot_tool_record(const live::Received<wire::RobotTool> &state, bool daemon_alive,
                                          std::int64_t now_ns);

} // namespace bregma::gateway
