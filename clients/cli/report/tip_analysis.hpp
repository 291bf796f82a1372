// The published tips compared with the truth, if recorded. Part of analyse().
#pragma once

#include "clients/cli/report/session_analysis.hpp"

namespace bregma::cli::report {

// Fills tips, tools, latencies, navigation rate, at_target, path, approaches, has_truth and seed.
[[nodiscard]] base::Result<void> analyse_tips(const casefile::SessionReader &reader, SessionAnalysis &out);

[[nodiscard]] Distribution distribution_of(std::vector<double> values);

} // namespace bregma::cli::report
