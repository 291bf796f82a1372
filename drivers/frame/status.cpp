#include "drivers/frame/status.hpp"

#include "idl/names.hpp"

namespace bregma::driver {

std::optional<std::string> dropped_text(const StatusValues &before, const StatusValues &now) {
  std::string out;
  const auto add = [&out](std::uint64_t count, const std::string &what) {
    if (count > 0) {
      out += (out.empty() ? "dropped: " : "; ") + std::to_string(count) + " " + what;
    }
  };
  add(now.skipped - before.skipped, "unreadable (last: " + now.skip_reason + ")");
  add(now.out_of_step - before.out_of_step, "out of step with the device's clock");
  add(now.refused - before.refused, "refused by DDS");
  return out.empty() ? std::nullopt : std::optional(out);
}

wire::DriverHealth to_wire(const StatusValues &values, const std::string &device, std::int64_t now_ns,
                           std::int64_t started_ns) {
  wire::DriverHealth out{};
  (void)wire::set_name(out.device, device); // its length was checked with the settings
  out.time_ns = now_ns;
  out.started_time_ns = started_ns;
  out.state = static_cast<wire::DriverState>(values.state);
  out.connections = values.connections;
  out.failures = values.failures;
  out.published = values.published;
  out.refused = values.refused;
  out.out_of_step = values.out_of_step;
  out.skipped = values.skipped;
  out.clock_offset_ms = values.clock_offset_ms;
  out.clock_drift_ppm = values.clock_drift_ppm;
  out.clock_resyncs = values.clock_resyncs;
  wire::set_text(out.failure, values.failure);
  return out;
}

} // namespace bregma::driver
