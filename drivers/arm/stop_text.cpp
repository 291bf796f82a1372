#include "drivers/arm/stop_text.hpp"

namespace bregma::arm {

std::string_view describe(wire::RobotStopCause cause) {
  switch (cause) {
  case bregma_wire_STOP_NONE:
    return "";
  case bregma_wire_STOP_COMMAND:
    return "stopped by command";
  case bregma_wire_STOP_DEADMAN_LOST:
    return "stopped: the deadman has not been received for 150 ms";
  case bregma_wire_STOP_DEADMAN_RELEASED:
    return "stopped: the deadman was released";
  case bregma_wire_STOP_LINK:
    return "stopped: the connection to the arm is lost";
  case bregma_wire_STOP_DAEMON_SILENT:
    return "stopped: the daemon is silent";
  case bregma_wire_STOP_DAEMON_REPLACED:
    return "stopped: the daemon is another one than at the start of the motion";
  case bregma_wire_STOP_NOT_VERIFIED:
    return "stopped: the registration is not verified";
  case bregma_wire_STOP_REGISTRATION_REPLACED:
    return "stopped: the accepted registration is another one than that of the path";
  case bregma_wire_STOP_EMERGENCY:
    return "stopped by the arm's emergency stop";
  case bregma_wire_STOP_ARM_FAULT:
    return "stopped by a fault of the arm";
  case bregma_wire_STOP_DRIVER_ENDED:
    return "stopped: the driver ends";
  case bregma_wire_STOP_PERMIT_LOST:
    return "stopped: the daemon's permit has not been received for 150 ms";
  case bregma_wire_STOP_PERMIT_WITHDRAWN:
    return "stopped: the daemon no longer permits the motion";
  default:
    return "stopped";
  }
}

} // namespace bregma::arm
