// Why an arm was stopped, for the operator. Any thread; no allocation.
#pragma once

#include <string_view>

#include "idl/topics.hpp"

namespace bregma::arm {

// Empty for STOP_NONE.
[[nodiscard]] std::string_view describe(wire::RobotStopCause cause);

} // namespace bregma::arm
