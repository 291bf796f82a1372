#include "clients/cli/mri/report/run_page.hpp"

#include <cmath>

#include "algorithms/geometry/unknown.hpp"
#include "base/plots.hpp"
#include "clients/cli/mri/control_points.hpp"
#include "clients/cli/mri/report/run_figures.hpp"
#include "clients/cli/mri/scanner_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/report/page_parts.hpp"

namespace bregma::cli::mri_report {

namespace {

std::string left_out_text(const RunRecord &record) {
  return record.left_out() > 0
             ? ", " + std::to_string(record.left_out()) + " left out: malformed, doubled, or more than are kept"
             : "";
}

using report::HtmlTable;
using report::Judgement;
using report::section;

// Of the residual (14) at points held out, mm.
constexpr double kMaxMeanResidual_mm = 0.20, kMaxResidual_mm = 0.70;

std::size_t tips_shown(const RunRecord &record) {
  std::size_t out = 0;
  for (const CorrectedPicture &picture : record.corrected()) {
    out += picture.said.tip_status == bregma_wire_POSE_LIVE ? 1 : 0;
  }
  return out;
}

std::string value_text(const Judgement &one) {
  return one.unit.empty() ? fixed(one.value, 0) : fixed(one.value, 2, one.unit);
}
std::string limit_text(const Judgement &one) {
  return std::string(one.at_most ? "at most " : "at least ") +
         (one.unit.empty() ? fixed(one.limit, 0) : fixed(one.limit, 2, one.unit));
}

std::string header(const RunRecord &record, const std::vector<Judgement> &judgements) {
  const bool good = report::all_hold(judgements);
  std::size_t slices = 0;
  for (const ReceivedSeries &series : record.series()) {
    slices += series.received();
  }
  const std::string sub = std::to_string(record.series().size()) + " series, " + std::to_string(slices) +
                          " slices received, " + std::to_string(record.corrected().size()) + " corrected" +
                          left_out_text(record);
  return "<header><h1>Robot to scanner: distortion and registration</h1><span class='badge " +
         std::string(good ? "good'>all checks hold" : "bad'>a check fails") + "</span><p class='sub'>" +
         base::escape(sub) + "</p></header>";
}

std::string cards(const RunRecord &record, const RunAnalysis &analysis) {
  std::string out = "<div class='cards'>";
  out += report::card("Predicted error at the target", known(analysis.predicted_95_mm, 2, "mm"),
                      "95 %, of the accepted registration");
  out += report::card("True error at the target", known(analysis.target_error_mm, 2, "mm"), "known to the simulation");
  out += report::card("True error of the shown tip", known(analysis.tip_error_mm, 2, "mm"),
                      "stated: " + known(analysis.tip_predicted_95_mm, 2, "mm") + " (95 %)");
  if (analysis.phantom) {
    out += report::card("Distortion before", fixed(analysis.phantom->before.overall.mean_mm, 2, "mm"),
                        "largest " + fixed(analysis.phantom->before.overall.max_mm, 2, "mm"));
    out += report::card("Left after correction", fixed(analysis.phantom->after.overall.mean_mm, 2, "mm"),
                        "at points held out; largest " + fixed(analysis.phantom->after.overall.max_mm, 2, "mm"));
  }
  if (record.state()) {
    out += report::card("Consistency of the coils (FRE)", known(record.state()->fre_mm, 2, "mm"),
                        "expected " + known(record.state()->fre_expected_mm, 2, "mm") + "; not an accuracy");
  }
  return out + "</div>";
}

std::string checks(const std::vector<Judgement> &judgements) {
  HtmlTable table({"What", "#Value", "#Wanted", "Holds"});
  for (const Judgement &one : judgements) {
    table.row({one.text, value_text(one), limit_text(one), one.holds ? "yes" : "no"}, one.holds ? "yes" : "no");
  }
  return table.text();
}

std::string table_3(const PhantomAnalysis &phantom) {
  HtmlTable table({"Axis", "#Before: mean mm", "#std", "#max", "#After: mean mm", "#std", "#max"});
  for (std::size_t a = 0; a < 4; ++a) {
    const auto &before = a < 3 ? phantom.before.axis[a] : phantom.before.overall;
    const auto &after = a < 3 ? phantom.after.axis[a] : phantom.after.overall;
    table.row({a < 3 ? std::string(1, "xyz"[a]) : "overall", fixed(before.mean_mm, 2), fixed(before.deviation_mm, 2),
               fixed(before.max_mm, 2), fixed(after.mean_mm, 2), fixed(after.deviation_mm, 2), fixed(after.max_mm, 2)});
  }
  table.row({"paper, x", "0.68", "0.66", "4.13", "0.17", "0.16", "1.29"});
  table.row({"paper, y", "0.59", "0.44", "2.36", "0.10", "0.09", "0.96"});
  table.row({"paper, z", "0.51", "0.49", "2.57", "0.15", "0.15", "1.22"});
  table.row({"paper, overall", "1.20", "0.72", "4.14", "0.29", "0.20", "1.47"});
  return table.text() + "<p class='note'>" + std::to_string(phantom.true_mm.cols()) + " control points matched, " +
         std::to_string(phantom.unmatched) +
         " without a partner. After: every other point, held out (14). The paper's z is along the normal of its "
         "slices, as y here.</p>";
}

std::string coils_table(const wire::ScannerRegistration &state) {
  HtmlTable table({"Coil", "Part", "#x mm", "#y mm", "#z mm", "#Sigma mm", "#Residual mm"});
  for (std::uint32_t i = 0; i < state.coil_count && i < bregma_wire_MAX_COILS; ++i) {
    const wire::CoilReport &coil = state.coils[i];
    if (coil.outcome == bregma_wire_COIL_IDLE || coil.outcome == bregma_wire_COIL_OUTCOME_UNKNOWN) {
      continue;
    }
    table.row({std::string(coil.coil, strnlen(coil.coil, sizeof coil.coil)),
               std::string(coil_outcome_label(coil.outcome)), fixed(coil.scanner_mm[0], 2),
               fixed(coil.scanner_mm[1], 2), fixed(coil.scanner_mm[2], 2), fixed(coil.sigma_mm, 2),
               fixed(coil.residual_mm, 2)});
  }
  return table.any() ? table.text() : std::string();
}

} // namespace

std::vector<Judgement> judge(const RunRecord &record, const RunInputs &inputs, const RunAnalysis &analysis) {
  std::vector<Judgement> out;
  const auto add = [&](const char *name, const char *text, double value, double limit, const char *unit, bool at_most) {
    out.push_back({name, text, value, limit, unit, at_most, at_most ? value <= limit : value >= limit});
  };
  const bool valid = record.state() && record.state()->validity == bregma_wire_SCANNER_VALID;
  add("accepted", "The registration is accepted and valid (1: yes)", valid ? 1.0 : 0.0, 1.0, "", false);
  if (inputs.phantom_mm.cols() > 0) {
    const bool there = analysis.phantom.has_value();
    add("residual", "Residual of the field at points held out, mean",
        there ? analysis.phantom->after.overall.mean_mm : geometry::kUnknown, kMaxMeanResidual_mm, "mm", true);
    add("residual_max", "The same, largest", there ? analysis.phantom->after.overall.max_mm : geometry::kUnknown,
        kMaxResidual_mm, "mm", true);
  }
  if (inputs.T_device_base) {
    add("target", "True error at the target, against the predicted 95 % error", analysis.target_error_mm,
        analysis.predicted_95_mm, "mm", true);
    if (record.tool()) {
      add("tip", "True error of the shown tip, against the stated 95 % error", analysis.tip_error_mm,
          analysis.tip_predicted_95_mm, "mm", true);
    }
  }
  add("tips", "Corrected slices with the tip of the tool", static_cast<double>(tips_shown(record)),
      record.tool() ? 1.0 : 0.0, "", false);
  add("refused", "Slices refused by the daemon",
      record.state() ? static_cast<double>(record.state()->slices_refused) : geometry::kUnknown, 0.0, "", true);
  return out;
}

std::string summary_text(const RunRecord &record, const RunAnalysis &analysis,
                         const std::vector<Judgement> &judgements) {
  std::string out;
  if (analysis.phantom) {
    out += distortion_table(analysis.phantom->before, analysis.phantom->after) + "\n";
  } else {
    out += "The phantom: " + analysis.phantom_missing + "\n";
  }
  if (record.state()) {
    out += scanner_text(*record.state()) + "\n";
  }
  out += record.left_out() > 0 ? "Received" + left_out_text(record) + "\n" : "";
  Table table({"Check", "Value", "Wanted", ""});
  for (const Judgement &one : judgements) {
    table.row({one.text, value_text(one), limit_text(one), one.holds ? "holds" : "FAILS"});
  }
  return out + table.text();
}

nlohmann::json summary_json(const RunRecord &record, const RunAnalysis &analysis,
                            const std::vector<Judgement> &judgements) {
  nlohmann::json out;
  out["series"] = record.series().size();
  out["corrected"] = record.corrected().size();
  out["target_error_mm"] = json_number(analysis.target_error_mm);
  out["predicted_error_95_mm"] = json_number(analysis.predicted_95_mm);
  out["tip_error_mm"] = json_number(analysis.tip_error_mm);
  if (analysis.phantom) {
    out["before"] = cli::summary_json(analysis.phantom->before);
    out["after"] = cli::summary_json(analysis.phantom->after);
  }
  if (record.state()) {
    out["state"] = scanner_json(*record.state());
  }
  for (const Judgement &one : judgements) {
    out["checks"].push_back({{"name", one.name},
                             {"value", json_number(one.value)},
                             {"limit", json_number(one.limit)},
                             {"holds", one.holds}});
  }
  return out;
}

base::Result<std::string> html_page(const RunRecord &record, const RunAnalysis &analysis,
                                    const std::vector<Judgement> &judgements) {
  std::string out = header(record, judgements) + cards(record, analysis);
  out += section("Checks", checks(judgements));
  out += section("The procedure", procedure_figure(record));
  const auto draw = [&](const char *heading, const base::Result<std::string> &figure,
                        const std::string &more = {}) -> base::Result<void> {
    if (!figure) {
      return tl::unexpected(figure.error());
    }
    out += section(heading, *figure + more);
    return {};
  };
  base::Result<void> drawn;
  if (analysis.phantom) {
    const PhantomAnalysis &phantom = *analysis.phantom;
    drawn = draw("Figure 3: control points in a slice", steps_figure(phantom));
    out += section("Table 3: distortion of the phantom", table_3(phantom));
    out += section("Figure 2: correction of one plane", correction_figure(phantom));
    out += section("Figure 11: distortion of each plane", plane_figure(phantom));
    drawn = drawn ? draw("Figure 12: distortion maps", map_figure(phantom)) : drawn;
  } else {
    out += section("The phantom", "<p>" + base::escape(analysis.phantom_missing) + "</p>");
  }
  for (std::size_t i = 0; i < analysis.coils.size() && drawn; ++i) {
    const CoilAnalysis &coils = analysis.coils[i];
    drawn = draw(("Figure 6: scan \"" + coils.protocol + "\"").c_str(), subtraction_figure(coils));
    if (drawn && i == 0) {
      drawn = draw("Figure 7: artefact of a coil", artefact_figure(coils));
    }
  }
  drawn = drawn ? draw("Corrected slice with the tip", tip_figure(record)) : drawn;
  if (!drawn) {
    return tl::unexpected(drawn.error());
  }
  out += report::columns(section("Figure 13: control points and coils",
                                 analysis.phantom ? coil_plan_figure(*analysis.phantom, record) : std::string()),
                         section("Coils", record.state() ? coils_table(*record.state()) : std::string(), "long"));
  out += "<footer>Lengths in millimetres, frame of the scanner: x to the right, y up, z to the viewer, seen from the "
         "front of the magnet; the isocentre is the origin. Figures and tables are numbered as in Tuna 2022.</footer>";
  return report::page("Robot to scanner", out);
}

} // namespace bregma::cli::mri_report
