#include "clients/cli/report/figures.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "clients/cli/report/plots.hpp"
#include "clients/cli/report/tip_analysis.hpp"

namespace bregma::cli::report {
namespace {

constexpr std::array kToolColours{colour::kBlue, colour::kOrange, colour::kPurple, colour::kGreen, colour::kYellow};
constexpr std::int64_t kGap_ns = 300'000'000; // a longer silence breaks a line
constexpr std::size_t kMaxDots = 3000;

const char *tool_colour(std::size_t tool) { return kToolColours[tool % kToolColours.size()]; }

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

// Two pictures of the same: one for a desk, one for a phone; the style sheet shows the one that fits.
template <class Draw> std::string responsive(Draw &&draw, int wide, int narrow) {
  return "<div class='wide'>" + draw(wide) + "</div><div class='narrow'>" + draw(narrow) + "</div>";
}

std::string figure(const std::string &picture, std::string_view caption) {
  return "<figure>" + picture + "<figcaption>" + escape(caption) + "</figcaption></figure>";
}

std::string full_width(const Plot &plot, std::string_view caption) {
  return figure(responsive(
                    [&](int width) {
                      return plot_svg(plot, {width, width > 600 ? 320 : 300});
                    },
                    1060, 420),
                caption);
}

std::string half_width(const Plot &plot, std::string_view caption) {
  return figure(responsive(
                    [&](int width) {
                      return plot_svg(plot, {width, width > 450 ? 370 : 340});
                    },
                    520, 420),
                caption);
}

std::vector<Band> navigating_bands(const SessionAnalysis &session) {
  std::vector<Band> out;
  for (const auto &span : session.states) {
    if (span.state == "navigating") {
      out.push_back({session.seconds(span.from_ns), session.seconds(span.to_ns), "#eaf5ef", "navigating"});
    }
  }
  return out;
}

template <class Value> Series line_of_tool(const SessionAnalysis &session, std::uint32_t tool, Value &&value) {
  Series out;
  std::int64_t last_ns = 0;
  for (const auto &tip : session.tips) {
    if (tip.tool == tool) {
      if (last_ns != 0 && tip.time_ns - last_ns > kGap_ns) {
        out.points.push_back({kNotKnown, kNotKnown});
      }
      last_ns = tip.time_ns;
      out.points.push_back({session.seconds(tip.time_ns), value(tip)});
    }
  }
  return out;
}

// The axis ends where all but the outermost 0.2 % of the data end: one glitch must not flatten the rest.
double axis_end(std::vector<double> values, double margin) {
  const double end = distribution_of(std::move(values)).percentile(0.998);
  return std::isfinite(end) && end > 0.0 ? end * margin : 1.0;
}

} // namespace

std::string timeline_figure(const SessionAnalysis &session) {
  std::vector<TimelineRow> rows;
  if (!session.states.empty()) {
    TimelineRow &row = rows.emplace_back();
    row.name = "Session";
    for (const auto &span : session.states) {
      row.spans.push_back(
          {session.seconds(span.from_ns), session.seconds(span.to_ns), state_colour(span.state), span.state});
    }
  }
  std::vector<std::pair<std::string, std::size_t>> row_of; // of each alarm that was ever raised
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
      spans.back().to = now; // whatever it was, it is something else from here on
    }
    if (alarm.state != "cleared") {
      spans.push_back({now, end, alarm.state == "raised" ? severity_colour(alarm.severity) : "#8a93a0", alarm.state});
    }
  }
  if (rows.empty()) {
    return {};
  }
  const Axis axis{"time, s", false, 0.0, end};
  return figure(responsive([&](int width) { return timeline_svg(rows, axis, width); }, 1060, 420),
                "States of the session, and every alarm from its raising to its end (red: critical, amber: warning, "
                "blue: information, grey: acknowledged).");
}

std::string error_figure(const SessionAnalysis &session) {
  if (session.tips.empty()) {
    return {};
  }
  Plot plot;
  plot.title = "Error of the shown tip over time";
  plot.x.label = "time, s";
  plot.y.label = "error of the shown tip, mm";
  plot.bands = navigating_bands(session);
  std::vector<double> heights;
  for (std::uint32_t tool = 0; tool < session.tools.size(); ++tool) {
    auto truth = line_of_tool(session, tool, [](const TipSample &tip) { return tip.true_error_mm; });
    if (truth.points.empty()) {
      continue;
    }
    if (session.has_truth) {
      truth.name = session.tools[tool] + ", true";
      truth.colour = tool_colour(tool);
      truth.size = 1.0;
      plot.series.push_back(std::move(truth));
    }
    auto predicted = line_of_tool(session, tool, [](const TipSample &tip) { return tip.predicted_rms_mm; });
    predicted.name = session.tools[tool] + ", predicted RMS";
    predicted.colour = session.has_truth ? "#1f2937" : tool_colour(tool);
    predicted.size = 1.8;
    predicted.dashed = session.has_truth;
    plot.series.push_back(std::move(predicted));
  }
  for (const auto &tip : session.tips) {
    heights.push_back(tip.true_error_mm);
    heights.push_back(tip.predicted_rms_mm);
  }
  plot.y.from = 0.0;
  plot.y.to = axis_end(std::move(heights), 1.15);
  return full_width(plot, session.has_truth
                              ? "How far the shown tip was from the true one, and what the daemon predicted at that "
                                "moment. Lines break where no pose was shown."
                              : "The error that the daemon predicted. The session holds no truth, so the true error "
                                "is not known.");
}

std::string honesty_figure(const SessionAnalysis &session) {
  if (!session.has_truth || session.tips.empty()) {
    return {};
  }
  Plot plot;
  plot.title = "Predicted against true error";
  plot.x.label = "predicted error (TRE, RMS), mm";
  plot.y.label = "true error, mm";
  plot.rules.push_back({RuleKind::kDiagonal, 0.0, "true = predicted", colour::kGrey});
  const std::size_t stride = session.tips.size() / kMaxDots + 1;
  std::vector<double> both;
  for (std::uint32_t tool = 0; tool <= session.tools.size(); ++tool) {
    const bool held = tool == session.tools.size(); // the last series: all that was held at the target, on top
    Series dots;
    dots.mark = Mark::kPoints;
    dots.size = held ? 2.2 : 1.6;
    dots.colour = held ? "#111827" : tool_colour(tool);
    for (std::size_t i = 0; i < session.tips.size(); i += stride) {
      const auto &tip = session.tips[i];
      if (std::isfinite(tip.true_error_mm) && (held ? tip.at_target : tip.tool == tool && !tip.at_target)) {
        dots.points.push_back({tip.predicted_rms_mm, tip.true_error_mm});
        both.push_back(tip.true_error_mm);
        both.push_back(tip.predicted_rms_mm);
      }
    }
    if (!dots.points.empty()) {
      dots.name = held ? "held at the target" : session.tools[tool];
      plot.series.push_back(std::move(dots));
    }
  }
  const double end = axis_end(std::move(both), 1.1);
  plot.x.from = plot.y.from = 0.0;
  plot.x.to = plot.y.to = end;
  return half_width(plot, "One dot a published pose. An honest prediction has most dots below about one and a half "
                          "times the diagonal, and not all of them far below it.");
}

std::string latency_figure(const SessionAnalysis &session) {
  const auto &sent = session.sent_to_published_ms;
  const auto &exposed = session.exposure_to_published_ms;
  if (sent.count() == 0 && exposed.count() == 0) {
    return {};
  }
  Plot plot;
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
    Series out;
    out.name = name;
    out.colour = paint;
    out.mark = Mark::kBars;
    for (int bin = 0; bin <= bins; ++bin) {
      const double from = low * std::pow(ratio, bin);
      const auto first = std::lower_bound(values.sorted.begin(), values.sorted.end(), from);
      const auto last = std::lower_bound(values.sorted.begin(), values.sorted.end(), from * ratio);
      out.points.push_back({from, static_cast<double>(last - first)});
    }
    plot.series.push_back(std::move(out));
  };
  histogram(exposed, "exposure to published", colour::kSky);
  histogram(sent, "sent to published", colour::kBlue);
  plot.x.from = low;
  plot.x.to = high;
  if (sent.count() > 0) {
    plot.rules.push_back({RuleKind::kVertical, sent.percentile(0.99), "99 % sent", "#374151"});
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
  Series bars;
  bars.mark = Mark::kBars;
  for (int bin = 0; bin <= bins; ++bin) {
    const double from = -reach + 2.0 * reach * bin / bins;
    const auto first = std::lower_bound(spread.sorted.begin(), spread.sorted.end(), from);
    const auto last = std::lower_bound(spread.sorted.begin(), spread.sorted.end(), from + 2.0 * reach / bins);
    bars.points.push_back({from, static_cast<double>(last - first)});
  }
  Plot plot;
  plot.title = "Distribution of scalp residuals";
  plot.x = {"signed distance to the scalp, mm (negative: inside)", false, -reach, reach};
  plot.y.label = "traced points";
  plot.y.from = 0.0;
  plot.series.push_back(std::move(bars));
  plot.rules.push_back({RuleKind::kVertical, 0.0, "", colour::kGrey});
  return full_width(plot, "Distances of the traced points to the scalp after registration. They tell how well skin "
                          "and model agree, not how well the target is hit.");
}

} // namespace bregma::cli::report
