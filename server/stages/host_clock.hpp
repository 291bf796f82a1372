// The clocks of this host at a step, for the input check.
#pragma once

#include "server/inputs/driver_transit.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

[[nodiscard]] inline inputs::HostClock host_clock(const Moment &now, const wire::BootIdentity &boot_id) noexcept {
  return {.boot_id = boot_id,
          .utc_minus_boot_ns = now.utc_ns - now.boot_ns,
          .wall_minus_boot_ns = now.wall_minus_boot_ns,
          .wall_error_ns = now.wall_error_ns};
}

} // namespace bregma::server
