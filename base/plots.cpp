#include <algorithm>
#include <cmath>

#include "base/plots.hpp"
#include "base/svg.hpp"

namespace bregma::base {
namespace {

// If there are more points than columns, only the minimum and maximum per column are drawn, which keeps all peaks.
std::string line_path(const Series &series, const Scale &x, const Scale &y) {
  std::string path;
  bool pen_down = false;
  const auto go = [&](double px, double py) {
    path += (pen_down ? "L" : "M") + text_of(px) + " " + text_of(py);
    pen_down = true;
  };
  double column = -kInfinity;
  Range in_column;
  double last = 0.0;
  const auto flush = [&] {
    if (in_column.low <= in_column.high) {
      const bool ends_high = last > 0.5 * (in_column.low + in_column.high);
      go(column, ends_high ? in_column.low : in_column.high);
      if (in_column.high - in_column.low > 0.05) {
        go(column, ends_high ? in_column.high : in_column.low);
      }
    }
    in_column = {};
  };
  for (const auto &point : series.points) {
    if (!x.holds(point.x) || !y.holds(point.y)) {
      flush();
      pen_down = false;
      continue;
    }
    const double px = std::round(2.0 * x(point.x)) / 2.0;
    if (px != column) {
      flush();
      column = px;
    }
    last = y.clamped(point.y);
    in_column.add(last, false);
  }
  flush();
  return "<path d='" + path + "' fill='none' stroke='" + series.colour + "' stroke-width='" + text_of(series.size) +
         "' stroke-linejoin='round'" + (series.dashed ? " stroke-dasharray='6 4'" : "") + " stroke-opacity='" +
         text_of(series.opacity, "%.2f") + "'/>";
}

std::string points_path(const Series &series, const Scale &x, const Scale &y) {
  // A path of zero-length dots with round caps takes a tenth of the text of circles.
  std::string path;
  for (const auto &point : series.points) {
    if (x.holds(point.x) && y.holds(point.y)) {
      path += "M" + text_of(x.clamped(point.x)) + " " + text_of(y.clamped(point.y)) + "h0";
    }
  }
  return "<path d='" + path + "' stroke='" + series.colour + "' stroke-width='" + text_of(2.0 * series.size) +
         "' stroke-linecap='round' stroke-opacity='" + text_of(series.opacity, "%.2f") + "' fill='none'/>";
}

std::string bars(const Series &series, const Scale &x, const Scale &y, const Frame &frame) {
  std::string out = "<g fill='" + series.colour + "'>";
  for (std::size_t i = 0; i + 1 < series.points.size(); ++i) {
    const auto &point = series.points[i];
    if (!x.holds(point.x) || !y.holds(point.y) || point.y <= 0.0) {
      continue;
    }
    const double left = x.clamped(point.x);
    const double width = std::max(0.5, x.clamped(series.points[i + 1].x) - left - 0.8);
    const double top = y.clamped(point.y);
    out += "<rect x='" + text_of(left) + "' y='" + text_of(top) + "' width='" + text_of(width) + "' height='" +
           text_of(std::max(0.0, frame.bottom - top)) + "'/>";
  }
  return out + "</g>";
}

std::string rule_line(const Rule &rule, const Scale &x, const Scale &y, const Frame &frame) {
  const std::string attributes = "stroke='" + rule.colour + "' stroke-width='1.3' stroke-dasharray='5 4'";
  const std::string fill = "fill='" + rule.colour + "' class='halo'";
  if (rule.kind == RuleKind::kDiagonal) {
    const double low = std::max(x.low(), y.low());
    const double high = std::min(x.high(), y.high());
    return high <= low ? std::string()
                       : line_between(x(low), y(low), x(high), y(high), attributes) +
                             label_at(x(high) - 6.0, y(high) + 18.0, "end", rule.label, fill);
  }
  if (rule.kind == RuleKind::kHorizontal) {
    const bool inside = rule.at >= y.low() && rule.at <= y.high();
    return !inside ? std::string()
                   : line_between(frame.left, y(rule.at), frame.right, y(rule.at), attributes) +
                         label_at(frame.right - 6.0, y(rule.at) - 5.0, "end", rule.label, fill);
  }
  const bool inside = rule.at >= x.low() && rule.at <= x.high();
  const bool on_the_right = inside && x(rule.at) > 0.5 * (frame.left + frame.right);
  return !inside ? std::string()
                 : line_between(x(rule.at), frame.top, x(rule.at), frame.bottom, attributes) +
                       label_at(x(rule.at) + (on_the_right ? -5.0 : 5.0), frame.top + 14.0,
                                on_the_right ? "end" : "start", rule.label, fill);
}

// Draws the legend above the frame in the necessary number of rows, and moves the frame's top below them.
std::string legend(const Plot &plot, Frame &frame) {
  constexpr double kRow = 20.0;
  std::string out;
  double x = frame.left;
  double top = 0.0;
  bool any = false;
  for (const auto &series : plot.series) {
    if (series.name.empty()) {
      continue;
    }
    const bool line = series.mark == Mark::kLine;
    const double mark = line ? 21.0 : 14.0;
    if (any && x + mark + text_width(series.name) > frame.right) {
      x = frame.left;
      top += kRow;
    }
    any = true;
    if (line) {
      const std::string dashes = series.dashed ? " stroke-dasharray='6 4'" : "";
      out += line_between(x, top + 11.5, x + 16.0, top + 11.5,
                          "stroke='" + series.colour + "' stroke-width='2.5'" + dashes);
    } else {
      out += "<rect x='" + text_of(x) + "' y='" + text_of(top + 7.0) + "' width='9' height='9' rx='1.5' fill='" +
             series.colour + "'/>";
    }
    out += label_at(x + mark, top + 16.0, "start", series.name);
    x += mark + text_width(series.name) + 18.0;
  }
  frame.top += any ? top + kRow : 0.0;
  return out;
}

} // namespace

std::string plot_svg(const Plot &plot, Size size) {
  Range x_data;
  Range y_data;
  bool has_bars = false;
  for (const auto &series : plot.series) {
    has_bars = has_bars || series.mark == Mark::kBars;
    for (const auto &point : series.points) {
      x_data.add(point.x, plot.x.logarithmic);
      y_data.add(point.y, plot.y.logarithmic);
    }
  }
  for (const auto &rule : plot.rules) {
    if (rule.kind != RuleKind::kDiagonal) {
      (rule.kind == RuleKind::kHorizontal ? y_data : x_data).add(rule.at, false);
    }
  }
  const Range x_range =
      chosen_range(plot.x, x_data, !has_bars && plot.series.size() == 1 && plot.series.front().mark == Mark::kPoints);
  const Range y_range = chosen_range(plot.y, y_data, true);

  double tick_width = 0.0;
  const auto provisional = Scale(plot.y, y_range, 0.0, 1.0).ticks(5);
  for (const double tick : provisional) {
    tick_width = std::max(tick_width, text_width(tick_text(tick)));
  }
  Frame frame{30.0 + tick_width, 8.0, size.width - 16.0, size.height - 44.0};
  const std::string legend_text = legend(plot, frame);

  const Scale x(plot.x, x_range, frame.left, frame.right);
  const Scale y(plot.y, y_range, frame.bottom, frame.top);
  std::string out = open_svg(size, plot.title) + legend_text;
  std::string band_labels;
  for (const auto &band : plot.bands) {
    const double left = x.clamped(band.from);
    const double width = x.clamped(band.to) - left;
    out += "<rect x='" + text_of(left) + "' y='" + text_of(frame.top) + "' width='" + text_of(std::max(0.0, width)) +
           "' height='" + text_of(frame.bottom - frame.top) + "' fill='" + band.colour + "'><title>" +
           escape(band.label) + "</title></rect>";
    if (width > text_width(band.label) + 6.0) {
      band_labels +=
          label_at(left + 0.5 * width, frame.top + 15.0, "middle", band.label, "fill='#7a8494' class='halo'");
    }
  }
  out += x_axis(x, frame, plot.x) + y_axis(y, frame, plot.y);
  for (const auto &series : plot.series) {
    out += series.mark == Mark::kLine     ? line_path(series, x, y)
           : series.mark == Mark::kPoints ? points_path(series, x, y)
                                          : bars(series, x, y, frame);
  }
  for (const auto &rule : plot.rules) {
    out += rule_line(rule, x, y, frame);
  }
  out += line_between(frame.left, frame.bottom, frame.right, frame.bottom, "stroke='#9aa3af'");
  out += line_between(frame.left, frame.top, frame.left, frame.bottom, "stroke='#9aa3af'");
  return out + band_labels + "</svg>";
}

} // namespace bregma::base
