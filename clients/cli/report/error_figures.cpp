#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "algorithms/geometry/unknown.hpp"
#include "clients/cli/report/figure_layout.hpp"
#include "clients/cli/report/figures.hpp"
#include "clients/cli/report/tip_analysis.hpp"

namespace bregma::cli::report {
namespace {

constexpr std::array kToolColours{base::colour::kBlue, base::colour::kOrange, base::colour::kPurple,
                                  base::colour::kGreen, base::colour::kYellow};
constexpr double kGap_s = 0.3;         // a longer gap interrupts a line
constexpr double kWindow_s = 0.5;      // window of the median
constexpr std::size_t kMaxDots = 1500; // per colour

struct ShownTool {
  std::string name;
  const char *colour;
  std::vector<const TipSample *> tips;
};

std::vector<ShownTool> shown_tools(const SessionAnalysis &session) {
  std::vector<std::vector<const TipSample *>> tips(session.tools.size());
  for (const auto &tip : session.tips) {
    tips[tip.tool].push_back(&tip);
  }
  std::vector<ShownTool> out;
  for (std::size_t tool = 0; tool < tips.size(); ++tool) {
    if (!tips[tool].empty()) {
      out.push_back({session.tools[tool], kToolColours[out.size() % kToolColours.size()], std::move(tips[tool])});
    }
  }
  return out;
}

std::vector<base::Band> navigating_bands(const SessionAnalysis &session) {
  std::vector<base::Band> out;
  for (const auto &span : session.states) {
    if (span.state == "navigating") {
      out.push_back({session.seconds(span.from_ns), session.seconds(span.to_ns), "#eaf5ef", "navigating"});
    }
  }
  return out;
}

template <class Value> base::Series line_of(const SessionAnalysis &session, const ShownTool &tool, Value &&value) {
  base::Series out;
  out.colour = tool.colour;
  for (const auto *tip : tool.tips) {
    const double time_s = session.seconds(tip->time_ns);
    if (!out.points.empty() && time_s - out.points.back().x > kGap_s) {
      out.points.push_back({geometry::kUnknown, geometry::kUnknown});
    }
    out.points.push_back({time_s, value(*tip)});
  }
  return out;
}

// Median in each window, which removes the tracker's noise from a line.
base::Series median_of(const base::Series &line) {
  base::Series out = line;
  out.points.clear();
  std::vector<double> window;
  double begin = 0.0;
  const auto close_window = [&] {
    if (!window.empty()) {
      out.points.push_back({begin + 0.5 * kWindow_s, distribution_of(std::move(window)).percentile(0.5)});
      window.clear();
    }
  };
  for (const auto &point : line.points) {
    if (!std::isfinite(point.x)) {
      close_window();
      out.points.push_back(point);
    } else {
      if (window.empty() || point.x - begin > kWindow_s) {
        close_window();
        begin = point.x;
      }
      window.push_back(point.y);
    }
  }
  close_window();
  return out;
}

// The axis covers 99.8 % of the data, so that one outlier does not compress the rest.
double axis_end(std::vector<double> values, double margin) {
  const double end = distribution_of(std::move(values)).percentile(0.998);
  return std::isfinite(end) && end > 0.0 ? end * margin : 1.0;
}

} // namespace

std::string error_figure(const SessionAnalysis &session) {
  if (session.tips.empty()) {
    return {};
  }
  base::Plot plot;
  plot.title = "Error of the shown tip over time";
  plot.x.label = "time, s";
  plot.y.label = "error of the shown tip, mm";
  plot.bands = navigating_bands(session);
  std::vector<double> heights;
  std::vector<base::Series> medians; // drawn on top of the samples of all tools
  for (const auto &tool : shown_tools(session)) {
    if (session.has_truth) {
      auto noisy = line_of(session, tool, [](const TipSample &tip) { return tip.true_error_mm; });
      noisy.size = 1.0;
      noisy.opacity = 0.22;
      auto median = median_of(noisy);
      median.name = tool.name + ", true";
      median.size = 2.2;
      median.opacity = 1.0;
      plot.series.push_back(std::move(noisy));
      medians.push_back(std::move(median));
    }
    auto predicted = line_of(session, tool, [](const TipSample &tip) { return tip.predicted_rms_mm; });
    predicted.name = tool.name + ", predicted";
    predicted.size = 2.0;
    predicted.dashed = true;
    medians.push_back(std::move(predicted));
  }
  std::move(medians.begin(), medians.end(), std::back_inserter(plot.series));
  for (const auto &tip : session.tips) {
    heights.push_back(tip.true_error_mm);
    heights.push_back(tip.predicted_rms_mm);
  }
  plot.y.from = 0.0;
  plot.y.to = axis_end(std::move(heights), 1.15);
  return full_width(plot, session.has_truth
                              ? "Error of the shown tip (pale: each state; line: median of half a "
                                "second), and what the daemon predicted at that moment (dashed: TRE, RMS). Lines "
                                "break where no pose was shown."
                              : "The error that the daemon predicted. The session holds no truth, so the true error "
                                "is not known.");
}

std::string calibration_figure(const SessionAnalysis &session) {
  if (!session.has_truth || session.tips.empty()) {
    return {};
  }
  base::Plot plot;
  plot.title = "Predicted against true error";
  plot.x.label = "predicted error (TRE, RMS), mm";
  plot.y.label = "true error, mm";
  plot.rules.push_back({base::RuleKind::kDiagonal, 0.0, "true = predicted", base::colour::kGrey});
  std::vector<double> both;
  base::Series held;
  held.name = "held at the target";
  held.colour = "#111827";
  const auto add = [&](base::Series dots, double radius) {
    // Thins the samples of each tool separately, because the states of two tools alternate.
    const std::size_t stride = dots.points.size() / kMaxDots + 1;
    std::vector<base::PlotPoint> kept;
    for (std::size_t i = 0; i < dots.points.size(); i += stride) {
      kept.push_back(dots.points[i]);
      both.push_back(dots.points[i].x);
      both.push_back(dots.points[i].y);
    }
    dots.points = std::move(kept);
    dots.mark = base::Mark::kPoints;
    dots.size = radius;
    dots.opacity = 0.5;
    if (!dots.points.empty()) {
      plot.series.push_back(std::move(dots));
    }
  };
  for (const auto &tool : shown_tools(session)) {
    base::Series dots;
    dots.name = tool.name;
    dots.colour = tool.colour;
    for (const auto *tip : tool.tips) {
      if (std::isfinite(tip->true_error_mm)) {
        (tip->at_target ? held : dots).points.push_back({tip->predicted_rms_mm, tip->true_error_mm});
      }
    }
    add(std::move(dots), 1.6);
  }
  add(std::move(held), 1.9);
  const double end = axis_end(std::move(both), 1.1);
  plot.x.from = plot.y.from = 0.0;
  plot.x.to = plot.y.to = end;
  return half_width(plot,
                    "One dot per published pose. With a realistic prediction most dots lie below about one and a half "
                    "times the diagonal, and not all of them far below.");
}

} // namespace bregma::cli::report
