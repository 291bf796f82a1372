// Facts about a case before it is used: sizes, deviations, distances.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "case_model/path_clearance.hpp"
#include "casefile/case.hpp"

namespace bregma::cli {

struct SurfaceFacts {
  std::string name;
  int vertices = 0;
  double volume_ml = 0.0;
  double area_cm2 = 0.0;
};

struct PointFacts {
  std::string name;
  std::string list; // "fiducial", "landmark", "target"
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  double to_scalp_mm = 0.0; // unsigned
};

struct TrajectoryFacts {
  std::string name;
  double length_mm = 0.0;
  std::vector<case_model::PathClearance> clearances; // nearest first
};

struct CaseFacts {
  std::vector<SurfaceFacts> surfaces; // scalp, brain where there is one, structures
  std::vector<PointFacts> points;
  std::vector<TrajectoryFacts> trajectories;
};

[[nodiscard]] CaseFacts facts_of(const casefile::Case &c);

[[nodiscard]] std::string facts_text(const casefile::Case &c, const CaseFacts &facts);
[[nodiscard]] nlohmann::json facts_json(const casefile::Case &c, const CaseFacts &facts);

// Warnings beyond the errors of load_case: sentences on what to check before using the case.
[[nodiscard]] std::vector<std::string> find_warnings(const casefile::Case &c, const CaseFacts &facts);

} // namespace bregma::cli
