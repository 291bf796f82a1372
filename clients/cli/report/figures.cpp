#include "clients/cli/report/figures.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "clients/cli/report/figure_layout.hpp"
#include "clients/cli/report/tip_analysis.hpp"

namespace bregma::cli::report {
namespace {

const char *state_colour(std::string_view state) {
  static constexpr std::array<std::pair<std::string_view, const char *>, 8> kColours{{{"idle", "#8a93a0"},
                                                                                      {"case loaded", "#6b7fa3"},
                                                                                      {"registering", "#b07d18"},
                                                                                      {"registered", "#8757a6"},
                                                                                      {"verified", "#2374ab"},
                                                                                      {"navigating", "#1b8a5a"},
                                                                                      {"degraded", "#c75a10"},
                                                                                      {"fault", "#b3261e"}}};
  const auto *found =
      std::find_if(kColours.begin(), kColours.end(), [&](const auto &one) { return one.first == state; });
  return found == kColours.end() ? "#8a93a0" : found->second;
}

const char *severity_colour(std::string_view severity) {
  return severity == "critical" ? "#b3261e" : severity == "warning" ? "#c77f0a" : "#2374ab";
}

} // namespace

std::string timeline_figure(const SessionAnalysis &session) {
  std::vector<base::TimelineRow> rows;
  if (!session.states.empty()) {
    base::TimelineRow &row = rows.emplace_back();
    row.name = "Session";
    for (const auto &span : session.states) {
      row.spans.push_back(
          {session.seconds(span.from_ns), session.seconds(span.to_ns), state_colour(span.state), span.state});
    }
  }
  std::vector<std::pair<std::string, std::size_t>> row_of; // row of each alarm that was raised
  const double end = session.seconds(session.end_ns);
  for (const auto &alarm : session.alarms) {
    const std::string name = alarm.kind + (alarm.subject.empty() ? "" : " " + alarm.subject);
    auto found = std::find_if(row_of.begin(), row_of.end(), [&](const auto &one) { return one.first == name; });
    if (found == row_of.end()) {
      row_of.emplace_back(name, rows.size());
      found = std::prev(row_of.end());
      rows.push_back({name, {}});
    }
    auto &spans = rows[found->second].spans;
    const double now = session.seconds(alarm.time_ns);
    if (!spans.empty() && spans.back().to == end) {
      spans.back().to = now; // the previous state ends here
    }
    if (alarm.state != "cleared") {
      spans.push_back({now, end, alarm.state == "raised" ? severity_colour(alarm.severity) : "#8a93a0", alarm.state});
    }
  }
  if (rows.empty()) {
    return {};
  }
  const base::Axis axis{"time, s", false, 0.0, end};
  return figure(responsive([&](int width) { return base::timeline_svg(rows, axis, width); }, 1060, 420),
                "States of the session, and every alarm from its raising to its end (red: critical, amber: warning, "
                "blue: information, grey: acknowledged).");
}

std::string latency_figure(const SessionAnalysis &session) {
  const auto &sent = session.sent_to_published_ms;
  const auto &exposed = session.exposure_to_published_ms;
  if (sent.count() == 0 && exposed.count() == 0) {
    return {};
  }
  base::Plot plot;
  plot.title = "Latency histogram";
  plot.x.label = "latency, ms";
  plot.x.logarithmic = true;
  plot.y.label = "states";
  plot.y.logarithmic = true;
  plot.y.from = 0.7;
  const auto lowest = [](const Distribution &values) {
    const auto found =
        std::find_if(values.sorted.begin(), values.sorted.end(), [](double value) { return value > 0.0; });
    return found == values.sorted.end() ? 1e9 : *found;
  };
  const double low = std::max(1e-3, 0.9 * std::min(lowest(sent), lowest(exposed)));
  const double top = std::max(sent.count() > 0 ? sent.max() : 0.0, exposed.count() > 0 ? exposed.max() : 0.0);
  const double high = std::max(1.2 * top, 2.0 * low);
  const int bins = 70;
  const double ratio = std::pow(high / low, 1.0 / bins);
  const auto histogram = [&](const Distribution &values, const char *name, const char *paint) {
    base::Series out;
    out.name = name;
    out.colour = paint;
    out.mark = base::Mark::kBars;
    for (int bin = 0; bin <= bins; ++bin) {
      const double from = low * std::pow(ratio, bin);
      const auto first = std::lower_bound(values.sorted.begin(), values.sorted.end(), from);
      const auto last = std::lower_bound(values.sorted.begin(), values.sorted.end(), from * ratio);
      out.points.push_back({from, static_cast<double>(last - first)});
    }
    plot.series.push_back(std::move(out));
  };
  histogram(exposed, "exposure to published", base::colour::kSky);
  histogram(sent, "sent to published", base::colour::kBlue);
  plot.x.from = low;
  plot.x.to = high;
  if (sent.count() > 0) {
    plot.rules.push_back({base::RuleKind::kVertical, sent.percentile(0.99), "99 % sent", "#374151"});
  }
  return half_width(plot, "From the exposure of a tracker frame, and from the driver's write of it, to the publication "
                          "of the state. Both axes are logarithmic, so that the rare late one is seen.");
}

std::string residual_figure(const SessionAnalysis &session) {
  if (session.trace.empty()) {
    return {};
  }
  std::vector<double> residuals;
  for (const auto &point : session.trace) {
    residuals.push_back(point.residual_mm);
  }
  const Distribution spread = distribution_of(std::move(residuals));
  const double reach = std::max({0.5, std::abs(spread.percentile(0.002)), std::abs(spread.percentile(0.998))}) * 1.1;
  const int bins = 40;
  base::Series bars;
  bars.mark = base::Mark::kBars;
  for (int bin = 0; bin <= bins; ++bin) {
    const double from = -reach + 2.0 * reach * bin / bins;
    const auto first = std::lower_bound(spread.sorted.begin(), spread.sorted.end(), from);
    const auto last = std::lower_bound(spread.sorted.begin(), spread.sorted.end(), from + 2.0 * reach / bins);
    bars.points.push_back({from, static_cast<double>(last - first)});
  }
  base::Plot plot;
  plot.title = "Distribution of scalp residuals";
  plot.x = {"signed distance to the scalp, mm (negative: inside)", false, -reach, reach};
  plot.y.label = "traced points";
  plot.y.from = 0.0;
  plot.series.push_back(std::move(bars));
  plot.rules.push_back({base::RuleKind::kVertical, 0.0, "", base::colour::kGrey});
  return full_width(plot, "Distances of the traced points from the scalp after registration. They show how well skin "
                          "and model agree, not the error at the target.");
}

} // namespace bregma::cli::report
