// Common parts of the stages' parameters.
#pragma once

#include <cstdint>
#include <string>

#include "base/parameters.hpp"

namespace bregma::server {

inline constexpr double kLookRate_hz = 20.0; // at which a worker with long work looks for some

[[nodiscard]] constexpr std::int64_t ns_of_ms(double milliseconds) {
  return static_cast<std::int64_t>(milliseconds * 1e6);
}
[[nodiscard]] constexpr std::int64_t period_ns(double rate_hz) { return static_cast<std::int64_t>(1e9 / rate_hz); }

inline void declare_priority(base::ParameterSet &set, const std::string &stage, std::int64_t &priority) {
  set.integer("realtime." + stage + "_priority", &priority, "", 0, 98,
              "SCHED_FIFO priority of the " + stage + " loop; 0: the ordinary scheduler.");
}

} // namespace bregma::server
