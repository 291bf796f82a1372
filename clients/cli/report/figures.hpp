// The figures of a session's page as HTML fragments; empty when the session has no data for them.
#pragma once

#include <string>

#include "base/result.hpp"
#include "clients/cli/report/session_analysis.hpp"

namespace bregma::cli::report {

[[nodiscard]] std::string timeline_figure(const SessionAnalysis &session);
[[nodiscard]] std::string error_figure(const SessionAnalysis &session);       // true error and predicted TRE over time
[[nodiscard]] std::string calibration_figure(const SessionAnalysis &session); // predicted against true error
[[nodiscard]] std::string latency_figure(const SessionAnalysis &session);
// The shown tip and its plan, of the trajectory that was followed for the longest time.
[[nodiscard]] std::string deviation_figure(const SessionAnalysis &session); // lateral deviation over time
[[nodiscard]] std::string path_figure(const SessionAnalysis &session);      // beside the plan, along the plan
[[nodiscard]] base::Result<std::string> path_on_head_figure(const SessionAnalysis &session);
// The tissue under the probe: against depth while it moves, against time where it stands still.
[[nodiscard]] std::string tissue_still_figure(const SessionAnalysis &session);
[[nodiscard]] std::string tissue_force_figure(const SessionAnalysis &session);
[[nodiscard]] std::string tissue_stress_figure(const SessionAnalysis &session); // at the target
[[nodiscard]] std::string tissue_motion_figure(const SessionAnalysis &session); // motion of the target
[[nodiscard]] std::string residual_figure(const SessionAnalysis &session);      // distribution of scalp residuals
// Four views of the head with the traced points coloured by residual.
[[nodiscard]] base::Result<std::string> head_figure(const SessionAnalysis &session);

} // namespace bregma::cli::report
