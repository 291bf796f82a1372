// Plots as SVG text: axes with ticks, lines, points, bars, bands, rules, timelines. No scripts, no external resources.
// Pure functions of their arguments. Values that are not finite are left out; lines break there.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace bregma::base {

namespace colour { // distinguishable with red-green colour blindness [Okabe 2008]
inline constexpr const char *kBlue = "#0072b2";
inline constexpr const char *kOrange = "#d55e00";
inline constexpr const char *kGreen = "#009e73";
inline constexpr const char *kPurple = "#a0588a";
inline constexpr const char *kYellow = "#e69f00";
inline constexpr const char *kSky = "#56b4e9";
inline constexpr const char *kGrey = "#8a93a0";
} // namespace colour

struct PlotPoint {
  double x = 0.0;
  double y = 0.0;
};

struct Axis {
  std::string label;          // with its unit
  bool logarithmic = false;   // values at or below zero are left out
  std::optional<double> from; // default: from the data
  std::optional<double> to;
};

enum class Mark { kLine, kPoints, kBars };

struct Series {
  std::string name; // name in the legend; empty: none
  std::string colour = colour::kBlue;
  Mark mark = Mark::kLine;
  std::vector<PlotPoint> points; // bars: left edge and height; each ends where the next begins, and the last point
                                 // only ends the one before
  double size = 1.5;             // width of the line or radius of the point
  bool dashed = false;
  double opacity = 1.0;
};

struct Band { // from one x to another, behind the data
  double from = 0.0;
  double to = 0.0;
  std::string colour = "#eef2f7";
  std::string label; // shown if there is room
};

enum class RuleKind { kHorizontal, kVertical, kDiagonal }; // the last: y = x

struct Rule {
  RuleKind kind = RuleKind::kHorizontal;
  double at = 0.0; // not used for the diagonal
  std::string label;
  std::string colour = colour::kGrey;
};

struct Plot {
  std::string title; // for screen readers
  Axis x;
  Axis y;
  std::vector<Series> series;
  std::vector<Band> bands;
  std::vector<Rule> rules;
};

struct Size {
  int width = 960;
  int height = 300;
};

[[nodiscard]] std::string plot_svg(const Plot &plot, Size size);

struct Span {
  double from = 0.0;
  double to = 0.0;
  std::string colour;
  std::string label; // inside if there is room, otherwise in the tooltip only
};

struct TimelineRow {
  std::string name;
  std::vector<Span> spans;
};

[[nodiscard]] std::string timeline_svg(const std::vector<TimelineRow> &rows, const Axis &x, int width);

// A colour bar for values from low to high; stops run from left to right.
[[nodiscard]] std::string colour_bar_svg(const std::vector<std::string> &stops, double low, double high,
                                         std::string_view label);

// Ticks at 1, 2 or 5 times a power of ten, about `wanted` of them, inside the range.
[[nodiscard]] std::vector<double> linear_ticks(double from, double to, int wanted);
[[nodiscard]] std::vector<double> logarithmic_ticks(double from, double to);

// For text and attributes of HTML and SVG.
[[nodiscard]] std::string escape(std::string_view text);

} // namespace bregma::base
