// The tissue model's answers while the probe was in the brain. Part of session_analysis.hpp.
#pragma once

#include "base/result.hpp"
#include "clients/cli/report/session_analysis.hpp"

namespace bregma::cli::report {

// Fills out.insertion; leaves it empty when no model followed a probe into the tissue.
[[nodiscard]] base::Result<void> analyse_tissue(const casefile::SessionReader &reader, SessionAnalysis &out);

} // namespace bregma::cli::report
