#include "clients/cli/mri/field_of_scans.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "algorithms/mri/lattice.hpp"
#include "clients/cli/mri/control_points.hpp"
#include "clients/cli/mri/read_out.hpp"
#include "clients/cli/output.hpp"

namespace bregma::cli {

namespace {

using Eigen::Index;
using Eigen::Vector3d;
using geometry::Points3;
using mri::PhantomScan;

std::vector<PhantomScan> some_points(const std::vector<PhantomScan> &scans, const std::vector<Index> &points) {
  std::vector<PhantomScan> out;
  for (const PhantomScan &scan : scans) {
    out.push_back({scan.imaged_mm(Eigen::all, points), scan.mm_per_Hz});
  }
  return out;
}

Points3 finite_columns(const Points3 &points) {
  std::vector<Index> kept;
  for (Index i = 0; i < points.cols(); ++i) {
    if (points.col(i).allFinite()) {
      kept.push_back(i);
    }
  }
  return points(Eigen::all, kept);
}

// Residuals at the points that a scan shows, by the field of one scan.
base::Result<Points3> by_one_scan(const Points3 &real, const PhantomScan &used, const Points3 &tested_real,
                                  const PhantomScan &tested) {
  std::vector<Index> kept, shown;
  for (Index i = 0; i < real.cols(); ++i) {
    if (used.imaged_mm.col(i).allFinite()) {
      kept.push_back(i);
    }
  }
  for (Index i = 0; i < tested_real.cols(); ++i) {
    if (tested.imaged_mm.col(i).allFinite()) {
      shown.push_back(i);
    }
  }
  const auto field = mri::DistortionField::fit(real(Eigen::all, kept), used.imaged_mm(Eigen::all, kept));
  if (!field) {
    return base::failure(field.error());
  }
  return finite_columns(mri::residuals(*field, tested_real(Eigen::all, shown), tested.imaged_mm(Eigen::all, shown)));
}

std::string cell(const Points3 &residuals) {
  const auto row = mri::summarise(residuals).overall;
  return fixed(row.mean_mm, 2) + ", " + fixed(row.max_mm, 2);
}

} // namespace

std::string missing_in(const ScanProtocols &protocols, std::size_t scans) {
  if (protocols.read_outs.size() != scans) {
    return std::to_string(scans) + (scans == 1 ? " scan needs" : " scans need") + " --read-out once per scan";
  }
  if (!(protocols.pixel_mm > 0.0) || !(protocols.bandwidth_Hz > 0.0)) {
    return "--read-out needs --pixel-mm and --bandwidth-Hz: B0 displaces by pixel / bandwidth";
  }
  if (!protocols.slices.empty() &&
      (protocols.slices.size() != scans || !(protocols.thickness_mm > 0.0) || !(protocols.pulse_Hz > 0.0))) {
    return "--slice-shift is needed once per scan, with --thickness-mm and --pulse-Hz";
  }
  return {};
}

base::Result<Vector3d> scan_movement(const ScanProtocols &protocols, std::size_t scan) {
  const auto read_out = ras_direction(protocols.read_outs[scan]);
  if (!read_out) {
    return tl::unexpected(read_out.error());
  }
  if (protocols.slices.empty()) {
    return mri::b0_movement(*read_out, protocols.pixel_mm, protocols.bandwidth_Hz);
  }
  const auto normal = ras_direction(protocols.slices[scan]);
  if (!normal) {
    return tl::unexpected(normal.error());
  }
  return mri::b0_movement(*read_out, protocols.pixel_mm, protocols.bandwidth_Hz, *normal, protocols.thickness_mm,
                          protocols.pulse_Hz);
}

base::Result<FieldOfScans> field_of_scans(const Points3 &ct, const std::vector<Points3> &scans,
                                          const std::vector<std::string> &names, const ScanProtocols &protocols,
                                          const mri::MatchOptions &options) {
  if (const std::string text = missing_in(protocols, scans.size()); !text.empty()) {
    return base::failure(text);
  }
  std::vector<PhantomScan> matched;
  std::string text;
  for (std::size_t s = 0; s < scans.size(); ++s) {
    const auto d = scan_movement(protocols, s);
    if (!d) {
      return tl::unexpected(d.error());
    }
    const mri::MatchResult match = mri::match_points(ct, scans[s], options);
    text += names[s] + "\n" + match_text(match, ct.cols(), scans[s].cols());
    if (match.outcome != mri::MatchOutcome::kMatched) {
      return base::failure(names[s] + ": " + mri::name(match.outcome) + " (" + std::to_string(match.pairs.size()) +
                           " pairs): " + why_not_matched(match, ct, scans[s]));
    }
    matched.push_back(mri::phantom_scan(match, ct.cols(), scans[s], *d));
  }
  const auto real = mri::place_reference(ct, matched);
  if (!real) {
    return base::failure("fewer than three control points are shown by all scans");
  }
  nlohmann::json placements = nlohmann::json::array();
  if (protocols.own_placement) {
    const auto relative = mri::relative_placements(*real, matched);
    for (std::size_t s = 1; s < matched.size(); ++s) {
      matched[s] = mri::without(relative[s], *real, std::move(matched[s]));
      const Vector3d scale = relative[s].slope.diagonal() + Vector3d::Ones();
      text += names[s] + " against " + names[0] + ", perpendicular to the read-outs: shift " +
              vector_text(relative[s].shift_mm, 2) + " mm, scale " + vector_text(scale, 4) + "; taken out\n";
      placements.push_back({{"scan", names[s]},
                            {"shift_mm", json_vector(relative[s].shift_mm)},
                            {"slope", json_matrix(relative[s].slope)}});
    }
  }
  auto field = mri::separate_fields(*real, matched);
  if (!field) {
    return base::failure(field.error());
  }
  // Held out as in section VI-A: every other point.
  const auto [used, tested] = mri::every_other(*real);
  const Points3 used_real = (*real)(Eigen::all, used), tested_real = (*real)(Eigen::all, tested);
  const std::vector<PhantomScan> used_scans = some_points(matched, used), tested_scans = some_points(matched, tested);
  const auto half = mri::separate_fields(used_real, used_scans);
  if (!half) {
    return base::failure("every other control point does not determine the fields: " + half.error());
  }
  Table table({"Scan", "Initial mean, max mm", "By the first scan", "By this scan alone", "By all scans"});
  nlohmann::json rows = nlohmann::json::array();
  for (std::size_t s = 0; s < matched.size(); ++s) {
    const auto first = by_one_scan(used_real, used_scans[0], tested_real, tested_scans[s]);
    const auto own = by_one_scan(used_real, used_scans[s], tested_real, tested_scans[s]);
    if (!first || !own) {
      return tl::unexpected(first ? own.error() : first.error());
    }
    const Points3 all = finite_columns(mri::residuals(*half, tested_real, tested_scans[s]));
    const Points3 initial = finite_columns(tested_scans[s].imaged_mm - tested_real);
    table.row({names[s], cell(initial), cell(*first), cell(*own), cell(all)});
    rows.push_back({{"scan", names[s]},
                    {"initial", summary_json(mri::summarise(initial))},
                    {"by_first_scan", summary_json(mri::summarise(*first))},
                    {"by_this_scan", summary_json(mri::summarise(*own))},
                    {"by_all_scans", summary_json(mri::summarise(all))}});
  }
  std::vector<double> shown_b0; // elsewhere the series is an extrapolation
  for (Index i = 0; i < real->cols(); ++i) {
    if (std::all_of(matched.begin(), matched.end(),
                    [i](const PhantomScan &scan) { return scan.imaged_mm.col(i).allFinite(); })) {
      shown_b0.push_back(field->b0_Hz(real->col(i)));
    }
  }
  const Eigen::VectorXd b0 = Eigen::Map<const Eigen::VectorXd>(shown_b0.data(), static_cast<Index>(shown_b0.size()));
  const double rms = std::sqrt(b0.squaredNorm() / static_cast<double>(b0.size()));
  text += "\nResidual at every other point, held out, of each scan (mean, max mm)\n" + table.text() +
          "B0 on the phantom: " + fixed(rms, 1, "Hz") + " RMS, " + fixed(b0.minCoeff(), 0) + " to " +
          fixed(b0.maxCoeff(), 0, "Hz") + "; separated in " + std::to_string(field->iterations) + " iterations\n";
  nlohmann::json figures = {{"scans", rows},
                            {"placements", placements},
                            {"iterations", field->iterations},
                            {"b0_rms_Hz", json_number(rms)},
                            {"b0_min_Hz", json_number(b0.minCoeff())},
                            {"b0_max_Hz", json_number(b0.maxCoeff())}};
  return FieldOfScans{std::move(*field), matched.front().mm_per_Hz, std::move(text), std::move(figures)};
}

} // namespace bregma::cli
