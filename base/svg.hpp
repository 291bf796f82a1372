// Elements of all plots: ranges, scales, ticks, frames, labels. Internal to plots.hpp's sources.
#pragma once

#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "base/plots.hpp"

namespace bregma::base {

inline constexpr double kFont = 13.0;              // height of text, in the units of the picture
inline constexpr double kCharacter = 0.55 * kFont; // mean width of one character
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Range {
  double low = kInfinity;
  double high = -kInfinity;
  void add(double value, bool positive_only);
  [[nodiscard]] bool empty() const { return low > high; }
};

// The range of the axis, otherwise of the data, optionally with a margin; never empty, so that a plot without data has
// a frame.
[[nodiscard]] Range chosen_range(const Axis &axis, Range data, bool air);

// Maps each value of a range to a position in the picture.
class Scale {
public:
  Scale(const Axis &axis, Range range, double paper_from, double paper_to)
      : logarithmic_(axis.logarithmic), range_(range), paper_from_(paper_from), paper_to_(paper_to) {}
  [[nodiscard]] bool holds(double value) const; // the value can be drawn
  [[nodiscard]] double operator()(double value) const;
  [[nodiscard]] double clamped(double value) const; // at the edge if outside
  [[nodiscard]] std::vector<double> ticks(int wanted) const;
  [[nodiscard]] double low() const { return range_.low; }
  [[nodiscard]] double high() const { return range_.high; }

private:
  bool logarithmic_;
  Range range_;
  double paper_from_;
  double paper_to_;
};

struct Frame {
  double left, top, right, bottom;
};

[[nodiscard]] std::string text_of(double value, const char *format = "%.1f"); // one printf conversion of a double
[[nodiscard]] std::string tick_text(double value);
[[nodiscard]] double text_width(std::string_view text);
[[nodiscard]] std::string label_at(double x, double y, std::string_view anchor, std::string_view text,
                                   std::string_view attributes = {});
[[nodiscard]] std::string line_between(double x1, double y1, double x2, double y2, std::string_view attributes);
[[nodiscard]] std::string open_svg(Size size, std::string_view title);
[[nodiscard]] std::string x_axis(const Scale &x, const Frame &frame, const Axis &axis);
[[nodiscard]] std::string y_axis(const Scale &y, const Frame &frame, const Axis &axis);

} // namespace bregma::base
