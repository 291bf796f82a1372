// Comparison of a run with the limits of its scenario, one by one.
#pragma once

#include <string>
#include <vector>

#include "algorithms/geometry/unknown.hpp"
#include "casefile/run_limits.hpp"
#include "clients/cli/report/session_analysis.hpp"

namespace bregma::cli::report {

struct Judgement {
  std::string name;                  // the limit's key in the scenario file
  std::string text;                  // description of the figure
  double value = geometry::kUnknown; // NaN: not in the file; the limit then counts as exceeded
  double limit = geometry::kUnknown;
  std::string unit;    // empty for counts and yes (1) or no (0)
  bool at_most = true; // false: at least
  bool holds = false;
};

// Only the limits in the scenario.
[[nodiscard]] std::vector<Judgement> judge(const SessionAnalysis &session, const casefile::RunLimits &limits);

[[nodiscard]] bool all_hold(const std::vector<Judgement> &judgements);

} // namespace bregma::cli::report
