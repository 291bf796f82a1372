// The limits of a whole run: the table [limits] of a scenario file. The simulated operating room reads the file to run
// it, `bregma report` to evaluate the run; they are independent of each other.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "base/result.hpp"
#include "base/table_reader.hpp"

namespace bregma::casefile {

// A limit that the file does not contain is not checked.
struct RunLimits {
  std::optional<double> max_tip_error_at_target_mm; // true error of the shown tip while held at the target, median
  std::optional<double> max_fre_mm;                 // FRE of the accepted registration
  std::optional<double> max_predicted_tre_mm;       // RMS, at the target, of the accepted registration
  std::optional<double> max_check_mm;               // any check touch
  std::optional<double> min_navigation_rate_hz;     // states per second while navigating
  std::optional<double> max_latency_p99_ms;         // tracker's write to the published state
  std::optional<double> max_lost_samples_percent;   // lost tracker frames, from gaps in the numbers
  std::optional<double> min_clearance_mm;           // true tip to the nearest critical structure
  std::optional<std::int64_t> max_rejected;         // samples, of all devices and reasons
  std::optional<std::int64_t> min_fiducials;        // captured
  std::optional<std::int64_t> min_surface_samples;
  std::optional<std::int64_t> max_unacknowledged_critical_alarms;
  bool require_inside_95 = false; // the true error at the target lies in the predicted 95 % ellipsoid
  bool require_verified = false;  // the operator confirmed the registration before navigating
};

// Reads the keys of [limits]; the reader keeps errors, and the caller checks its finish().
[[nodiscard]] RunLimits read_run_limits(base::TableReader &limits);

// The [limits] of a scenario file; the rest of the file is ignored. A file without the table has no limits.
[[nodiscard]] base::Result<RunLimits> load_run_limits(const std::filesystem::path &scenario_file);

} // namespace bregma::casefile
