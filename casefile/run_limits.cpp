#include "casefile/run_limits.hpp"

namespace bregma::casefile {

RunLimits read_run_limits(base::TableReader &limits) {
  const auto number = [&limits](std::string_view key, std::string_view unit, double max) {
    return limits.optional_number(key, unit, 0.0, max);
  };
  const auto integer = [&limits](std::string_view key) -> std::optional<std::int64_t> {
    return limits.has(key) ? std::optional(limits.require_integer(key, "", 0, 1'000'000'000)) : std::nullopt;
  };
  RunLimits out;
  out.max_tip_error_at_target_mm = number("max_tip_error_at_target_mm", "mm", 1000.0);
  out.max_fre_mm = number("max_fre_mm", "mm", 1000.0);
  out.max_predicted_tre_mm = number("max_predicted_tre_mm", "mm", 1000.0);
  out.max_check_mm = number("max_check_mm", "mm", 1000.0);
  out.min_navigation_rate_hz = number("min_navigation_rate_hz", "Hz", 10000.0);
  out.max_latency_p99_ms = number("max_latency_p99_ms", "ms", 60000.0);
  out.max_lost_samples_percent = number("max_lost_samples_percent", "%", 100.0);
  out.min_clearance_mm = number("min_clearance_mm", "mm", 1000.0);
  out.max_rejected = integer("max_rejected");
  out.min_fiducials = integer("min_fiducials");
  out.min_surface_samples = integer("min_surface_samples");
  out.max_unacknowledged_critical_alarms = integer("max_unacknowledged_critical_alarms");
  out.require_inside_95 = limits.flag("require_inside_95", false);
  out.require_verified = limits.flag("require_verified", false);
  return out;
}

base::Result<RunLimits> load_run_limits(const std::filesystem::path &scenario_file) {
  const auto document = base::TomlDocument::read(scenario_file);
  if (!document) {
    return tl::unexpected(document.error());
  }
  auto limits = document->root().table("limits");
  if (!limits) {
    return RunLimits{};
  }
  const RunLimits out = read_run_limits(*limits);
  if (const auto ok = limits->finish(); !ok) {
    return tl::unexpected(ok.error());
  }
  return out;
}

} // namespace bregma::casefile
