#include "tests/faults/report.hpp"

#include <cmath>
#include <cstdio>

#include <nlohmann/json.hpp>

namespace bregma::faults {
namespace {

const char *text_of(Verdict verdict) {
  static constexpr const char *kTexts[] = {"yes", "known", "NO"};
  return kTexts[static_cast<std::size_t>(verdict)];
}

// Figures that a run does not have are negative.
std::string figure(double value) {
  char text[32];
  (void)std::snprintf(text, sizeof text, "%.0f", value);
  return value < 0.0 ? "-" : text;
}

nlohmann::ordered_json json_figure(double value) {
  return value < 0.0 || !std::isfinite(value) ? nlohmann::ordered_json() : nlohmann::ordered_json(value);
}

std::string violation_line(const Planned &planned, const Violation &violation) {
  char when[64];
  (void)std::snprintf(when, sizeof when, " (%llu times, first %.0f ms after the fault)",
                      static_cast<unsigned long long>(violation.count), violation.after_ms);
  std::string out = "    " + violation.rule + ": " + violation.text + when + "\n";
  if (const KnownFailure *known = find_known(*planned.cell, planned.session, violation)) {
    out += "      known: " + known->reason + "\n";
  }
  return out;
}

} // namespace

std::string table_header() {
  char text[160];
  (void)std::snprintf(text, sizeof text, "%-44s %-11s %6s %-5s %9s %9s %7s %7s %7s\n", "cell", "session", "seed",
                      "holds", "shown ms", "displayed", "alarm", "gap", "back");
  return text;
}

std::string table_rows(const Planned &planned, const Outcome &outcome) {
  const Figures &figures = outcome.figures;
  char text[200];
  (void)std::snprintf(text, sizeof text, "%-44s %-11s %6llu %-5s %9s %9s %7s %7s %7s\n", planned.cell->name().c_str(),
                      name_of(planned.session),
                      static_cast<unsigned long long>(seed_of(*planned.cell, planned.session)),
                      text_of(judge(planned, outcome)), figure(figures.oldest_shown_ms).c_str(),
                      figure(figures.oldest_displayed_ms).c_str(), figure(figures.alarm_ms).c_str(),
                      figure(figures.gap_ms).c_str(), figure(figures.back_ms).c_str());
  std::string out = text;
  for (const Violation &violation : outcome.violations) {
    out += violation_line(planned, violation);
  }
  return out;
}

std::string json_line(const Planned &planned, const Outcome &outcome) {
  const Figures &figures = outcome.figures;
  nlohmann::ordered_json out{{"subject", name_of(planned.cell->subject)},
                             {"fault", name_of(planned.cell->fault)},
                             {"variant", planned.cell->variant},
                             {"session", name_of(planned.session)},
                             {"seed", seed_of(*planned.cell, planned.session)},
                             {"holds", outcome.holds()},
                             {"known", judge(planned, outcome) == Verdict::kKnownFailure},
                             {"shown", figures.shown},
                             {"oldest_shown_ms", json_figure(figures.oldest_shown_ms)},
                             {"oldest_displayed_ms", json_figure(figures.oldest_displayed_ms)},
                             {"age_understated_ms", json_figure(figures.age_understated_ms)},
                             {"largest_error_ratio", json_figure(figures.largest_error_ratio)},
                             {"alarm_ms", json_figure(figures.alarm_ms)},
                             {"gap_ms", json_figure(figures.gap_ms)},
                             {"back_ms", json_figure(figures.back_ms)},
                             {"virtual_s", outcome.virtual_s},
                             {"violations", nlohmann::ordered_json::array()}};
  for (const Violation &violation : outcome.violations) {
    const KnownFailure *known = find_known(*planned.cell, planned.session, violation);
    out["violations"].push_back({{"rule", violation.rule},
                                 {"text", violation.text},
                                 {"after_ms", violation.after_ms},
                                 {"count", violation.count},
                                 {"known", known != nullptr ? known->reason : ""}});
  }
  return out.dump() + "\n";
}

std::string table_row(int number, const Kill &kill, bool holds) {
  char text[128];
  (void)std::snprintf(text, sizeof text,
                      "kill %3d: %-3s registered after %.2f s, recorded after %.0f ms, %5.1f ms of record lost ",
                      number, holds ? "yes" : "NO", kill.registered_s, kill.late_ms, kill.lost_ms);
  return text + kill.failure + "\n";
}

std::string json_line(int number, const Kill &kill, bool holds) {
  const nlohmann::ordered_json out{
      {"kill", number},          {"holds", holds},          {"registered_s", kill.registered_s},
      {"late_ms", kill.late_ms}, {"lost_ms", kill.lost_ms}, {"failure", kill.failure}};
  return out.dump() + "\n";
}

} // namespace bregma::faults
