// Parameters of every driver.
#pragma once

#include <string>

#include "base/parameters.hpp"
#include "drivers/frame/loop.hpp"

namespace bregma::driver {

struct Settings {
  std::string device;         // on the wire
  std::int64_t domain_id = 0; // DDS domain
  LogLevel log_level = LogLevel::kInfo;
  double first_delay_s = 0.5;
  double max_delay_s = 10.0;
  double silence_s = 2.0;
  bool map_device_time = true; // not a parameter; false if samples must be published unchanged
  double minimum_latency_ms = 0.0;
};

void declare(base::ParameterSet &parameters, Settings &settings);
// Checks beyond the ranges of single parameters.
[[nodiscard]] base::Result<void> check(const Settings &settings);

[[nodiscard]] LoopOptions loop_options(const Settings &settings);
[[nodiscard]] IoOptions io_options(const Settings &settings);

} // namespace bregma::driver
