// The path of the navigated tip along its plan. Part of analyse().
#pragma once

#include <array>
#include <string>

#include "clients/cli/report/session_analysis.hpp"

namespace bregma::cli::report {

// Fills plans with the trajectories of the case that the file contains. A file without them, or with ones that cannot
// be read, leaves them empty: the path is then drawn without its directions.
void read_plans(const casefile::SessionReader &reader, SessionAnalysis &out);

// Fills path_summary from path and plans.
void summarise_path(SessionAnalysis &out);

// Two directions across a planned line, each turned towards the anatomical one that it is named after.
struct AcrossPlan {
  std::array<Eigen::Vector3d, 2> directions;
  std::array<std::string, 2> names; // "right", "anterior", "superior"
};
[[nodiscard]] AcrossPlan across(const casefile::Trajectory &plan);

// The plan with this name, or nullptr.
[[nodiscard]] const casefile::Trajectory *plan_of(const SessionAnalysis &session, const std::string &trajectory);

} // namespace bregma::cli::report
