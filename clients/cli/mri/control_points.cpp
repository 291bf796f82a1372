#include "clients/cli/mri/control_points.hpp"

#include <array>
#include <cmath>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/mri/lattice.hpp"

#include "clients/cli/output.hpp"
#include "clients/cli/registration/point_file.hpp"

namespace bregma::cli {

using nlohmann::json;

namespace {

constexpr Eigen::Index kMostPoints = 10000; // their correspondence takes minutes
constexpr double kBent_mm = 0.5;            // no CT bends a lattice so far
constexpr double kSameSpacing = 1.15;       // ratio of the spacings of one phantom in two images

std::string unmatched_lines(const char *side, const std::vector<mri::UnmatchedPoint> &points) {
  std::string out;
  for (const mri::UnmatchedPoint &p : points) {
    out += std::string(side) + " point " + std::to_string(p.index + 1) + ": " + mri::name(p.reason) + " (" +
           fixed(p.distance_mm, 1, "mm") + ")\n";
  }
  return out;
}

json unmatched_json(const std::vector<mri::UnmatchedPoint> &points) {
  json out = json::array();
  for (const mri::UnmatchedPoint &p : points) {
    out.push_back(
        {{"point", p.index + 1}, {"reason", mri::name(p.reason)}, {"distance_mm", json_number(p.distance_mm)}});
  }
  return out;
}

std::string cell(const mri::ErrorSummary::Row &row) {
  return fixed(row.mean_mm, 2) + " (" + fixed(row.deviation_mm, 2) + ")";
}

} // namespace

base::Result<geometry::Points3> read_control_points(const std::string &file, std::vector<std::string> &notes) {
  auto read = read_point_file(file);
  if (!read) {
    return tl::unexpected(read.error());
  }
  notes.insert(notes.end(), read->notes.begin(), read->notes.end());
  geometry::Points3 out(3, static_cast<Eigen::Index>(read->points.size()));
  for (std::size_t i = 0; i < read->points.size(); ++i) {
    out.col(static_cast<Eigen::Index>(i)) = read->points[i].position_mm;
  }
  return out;
}

base::Result<void> check_lists(const geometry::Points3 &ct_mm, const std::vector<geometry::Points3> &scans_mm,
                               const std::vector<std::string> &names) {
  std::vector<const geometry::Points3 *> lists{&ct_mm};
  for (const geometry::Points3 &scan : scans_mm) {
    lists.push_back(&scan);
  }
  for (std::size_t i = 0; i < lists.size(); ++i) {
    if (lists[i]->cols() > kMostPoints) {
      return base::failure(names[i] + " holds " + std::to_string(lists[i]->cols()) +
                           " points, control points of a phantom are at most " + std::to_string(kMostPoints));
    }
  }
  for (std::size_t i = 0; i < lists.size(); ++i) {
    for (std::size_t j = i + 1; j < lists.size(); ++j) {
      if (lists[i]->cols() == lists[j]->cols() && *lists[i] == *lists[j]) {
        return base::failure(names[i] + " and " + names[j] + " hold the same points: one of them is the wrong file");
      }
    }
  }
  const auto of_ct = mri::bend_mm(ct_mm);
  for (std::size_t s = 0; s < scans_mm.size(); ++s) {
    const auto of_mr = mri::bend_mm(scans_mm[s]);
    if (of_ct && of_mr && *of_ct > kBent_mm && *of_ct > 2.0 * *of_mr) {
      return base::failure("the points of " + names[0] + " are bent by " + fixed(*of_ct, 1, "mm") +
                           " (RMS), those of " + names[s + 1] + " by " + fixed(*of_mr, 1, "mm") +
                           ": CT does not distort, so the files are exchanged");
    }
  }
  return {};
}

std::string why_not_matched(const mri::MatchResult &match, const geometry::Points3 &ct_mm,
                            const geometry::Points3 &mr_mm) {
  const double ct = mri::median(mri::nearest_distances(ct_mm)), mr = mri::median(mri::nearest_distances(mr_mm));
  switch (match.outcome) {
  case mri::MatchOutcome::kTooFewPoints:
    return "no field: " + std::to_string(mri::kFewestMatched) + " points are needed in each list, there are " +
           std::to_string(ct_mm.cols()) + " in CT and " + std::to_string(mr_mm.cols()) + " in MR";
  case mri::MatchOutcome::kNoMatch:
    if (ct > 0.0 && mr > 0.0 && std::abs(std::log(mr / ct)) > std::log(kSameSpacing)) {
      return "no field: neighbouring points are " + fixed(ct, 2, "mm") + " apart in CT and " + fixed(mr, 2, "mm") +
             " in MR: are both of one phantom, and in one unit?";
    }
    break;
  case mri::MatchOutcome::kTurned:
    return "no field: the points fit where the phantom is turned; if it lies otherwise in MR than in CT, say "
           "--any-orientation";
  case mri::MatchOutcome::kAmbiguous:
  case mri::MatchOutcome::kMatched:
    break;
  }
  return "no field: the correspondence must be matched";
}

std::string match_text(const mri::MatchResult &match, Eigen::Index reference_points, Eigen::Index imaged_points) {
  std::string out = "Control points: " + std::string(mri::name(match.outcome)) + ", " +
                    std::to_string(match.pairs.size()) + " pairs of " + std::to_string(reference_points) +
                    " points in CT and " + std::to_string(imaged_points) + " in MR, " +
                    fixed(match.rms_residual_mm, 2, "mm") + " RMS from a smooth distortion\n";
  if (match.alternative) {
    out += "Another placement, turned by " + fixed(match.alternative->rotation_rad / geometry::kRadiansPerDegree, 0) +
           " degrees and moved by " + fixed(match.alternative->shift_mm, 1, "mm") + ", explains " +
           std::to_string(match.alternative->pairs) + " pairs\n";
  }
  return out + unmatched_lines("CT", match.reference_unmatched) + unmatched_lines("MR", match.imaged_unmatched);
}

json match_json(const mri::MatchResult &match) {
  json out = {{"outcome", mri::name(match.outcome)},
              {"pairs", json::array()},
              {"rms_residual_mm", json_number(match.rms_residual_mm)},
              {"ct_unmatched", unmatched_json(match.reference_unmatched)},
              {"mr_unmatched", unmatched_json(match.imaged_unmatched)}};
  for (const mri::MatchedPair &p : match.pairs) {
    out["pairs"].push_back({p.reference + 1, p.imaged + 1});
  }
  if (match.alternative) {
    out["alternative"] = {{"rotation_deg", json_number(match.alternative->rotation_rad / geometry::kRadiansPerDegree)},
                          {"shift_mm", json_number(match.alternative->shift_mm)},
                          {"pairs", match.alternative->pairs}};
  }
  return out;
}

std::string distortion_table(const mri::ErrorSummary &before, const mri::ErrorSummary &after) {
  Table table({"Axis", "Initial mean (SD) mm", "max mm", "Residual mean (SD) mm", "max mm"});
  constexpr std::array kAxes = {"x", "y", "z"};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    table.row({kAxes[axis], cell(before.axis[axis]), fixed(before.axis[axis].max_mm, 2), cell(after.axis[axis]),
               fixed(after.axis[axis].max_mm, 2)});
  }
  table.row({"e", cell(before.overall), fixed(before.overall.max_mm, 2), cell(after.overall),
             fixed(after.overall.max_mm, 2)});
  return table.text();
}

json summary_json(const mri::ErrorSummary &summary) {
  const auto row = [](const mri::ErrorSummary::Row &r) {
    return json{{"mean_mm", json_number(r.mean_mm)},
                {"deviation_mm", json_number(r.deviation_mm)},
                {"max_mm", json_number(r.max_mm)}};
  };
  return {{"x", row(summary.axis[0])},
          {"y", row(summary.axis[1])},
          {"z", row(summary.axis[2])},
          {"overall", row(summary.overall)}};
}

} // namespace bregma::cli
