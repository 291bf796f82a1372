#include "drivers/frame/settings.hpp"

#include <cmath>

#include "idl/names.hpp"

namespace bregma::driver {
namespace {

std::int64_t nanoseconds(double seconds) { return std::llround(seconds * 1e9); }

} // namespace

void declare(base::ParameterSet &parameters, Settings &settings) {
  parameters
      .string("device", &settings.device,
              "Name of the device on the wire; bregmad knows the devices that it expects by name")
      .integer("domain_id", &settings.domain_id, "", 0, 230, "DDS domain of the daemon")
      .number("reconnect.first_s", &settings.first_delay_s, "s", 0.01, 60.0,
              "Delay before the second attempt to connect; doubled after each further failure")
      .number("reconnect.max_s", &settings.max_delay_s, "s", 0.01, 600.0, "The delay is never longer than this")
      .number("reconnect.silence_s", &settings.silence_s, "s", 0.0, 3600.0,
              "A connection that brings no sample for longer is taken for lost and made again; 0: never");
  base::declare_log_level(parameters, &settings.log_level, "Lines of this level and above go to standard error");
  if (settings.map_device_time) {
    parameters.number("clock.minimum_latency_ms", &settings.minimum_latency_ms, "ms", 0.0, 10'000.0,
                      "Time from the device's exposure to its arrival here at best, from the data sheet");
  }
}

base::Result<void> check(const Settings &settings) {
  if (settings.device.empty() || settings.device.size() > wire::kNameLength) {
    return base::failure("device = " + settings.device + ": must be 1 to " + std::to_string(wire::kNameLength) +
                         " bytes");
  }
  if (settings.first_delay_s > settings.max_delay_s) {
    return base::failure("reconnect.first_s must not be above reconnect.max_s");
  }
  return {};
}

LoopOptions loop_options(const Settings &settings) {
  return {.backoff = {.first_ns = nanoseconds(settings.first_delay_s), .max_ns = nanoseconds(settings.max_delay_s)},
          .silence_ns = nanoseconds(settings.silence_s)};
}

IoOptions io_options(const Settings &settings) {
  return {.device = settings.device,
          .map_device_time = settings.map_device_time,
          .minimum_latency_ns = nanoseconds(settings.minimum_latency_ms * 1e-3)};
}

} // namespace bregma::driver
