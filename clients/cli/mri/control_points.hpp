// Control points of a phantom from files, and their report.
#pragma once

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "algorithms/geometry/points.hpp"
#include "algorithms/mri/distortion_field.hpp"
#include "algorithms/mri/point_matching.hpp"
#include "base/result.hpp"

namespace bregma::cli {

// Points of a list (.mrk.json, .fcsv, table), RAS, mm.
[[nodiscard]] base::Result<geometry::Points3> read_control_points(const std::string &file,
                                                                  std::vector<std::string> &notes);

// "matched 336 of 339 and 336 points ..." with every point that has no partner, numbered from 1 as in the file.
[[nodiscard]] std::string match_text(const mri::MatchResult &match, Eigen::Index reference_points,
                                     Eigen::Index imaged_points);
// Refused: a list of more points than a phantom has, a list that is another one as well, and lists of which that of CT
// is bent and that of MR is straight, so that they are exchanged. names: of CT, then of each scan.
[[nodiscard]] base::Result<void> check_lists(const geometry::Points3 &ct_mm,
                                             const std::vector<geometry::Points3> &scans_mm,
                                             const std::vector<std::string> &names);

// The reason, where the outcome is not matched.
[[nodiscard]] std::string why_not_matched(const mri::MatchResult &match, const geometry::Points3 &ct_mm,
                                          const geometry::Points3 &mr_mm);
[[nodiscard]] nlohmann::json match_json(const mri::MatchResult &match);

// Table 3 of [Tuna 2022] in its layout.
[[nodiscard]] std::string distortion_table(const mri::ErrorSummary &before, const mri::ErrorSummary &after);
[[nodiscard]] nlohmann::json summary_json(const mri::ErrorSummary &summary);

} // namespace bregma::cli
