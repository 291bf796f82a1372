#include <algorithm>

#include "base/plots.hpp"
#include "base/svg.hpp"

namespace bregma::base {

std::string timeline_svg(const std::vector<TimelineRow> &rows, const Axis &axis, int width) {
  constexpr double kRow = 26.0;
  double name_width = 0.0;
  Range data;
  for (const auto &row : rows) {
    name_width = std::max(name_width, text_width(row.name));
    for (const auto &span : row.spans) {
      data.add(span.from, false);
      data.add(span.to, false);
    }
  }
  const Frame frame{std::min(name_width + 14.0, 0.4 * width), 4.0, width - 16.0,
                    4.0 + kRow * static_cast<double>(rows.size())};
  const Range range = chosen_range(axis, data, false);
  const Scale x(axis, range, frame.left, frame.right);
  std::string out = open_svg({width, static_cast<int>(frame.bottom + 44.0)}, axis.label);
  out += x_axis(x, frame, axis);
  double top = frame.top;
  for (const auto &row : rows) {
    const auto room = static_cast<std::size_t>(std::max(4.0, (frame.left - 12.0) / kCharacter));
    const std::string name = row.name.size() > room ? row.name.substr(0, room - 1) + "\u2026" : row.name;
    out += label_at(frame.left - 8.0, top + 17.0, "end", name);
    for (const auto &span : row.spans) {
      const double left = x.clamped(span.from);
      const double length = std::max(2.0, x.clamped(span.to) - left);
      out += "<rect x='" + text_of(left) + "' y='" + text_of(top + 3.0) + "' width='" + text_of(length) + "' height='" +
             text_of(kRow - 6.0) + "' rx='2' fill='" + span.colour + "' stroke='#fff'><title>" + escape(span.label) +
             "</title></rect>";
      if (length > text_width(span.label) + 8.0) {
        out += label_at(left + 0.5 * length, top + 17.5, "middle", span.label, "fill='#ffffff'");
      }
    }
    top += kRow;
  }
  return out + line_between(frame.left, frame.bottom, frame.right, frame.bottom, "stroke='#9aa3af'") + "</svg>";
}

std::string colour_bar_svg(const std::vector<std::string> &stops, double low, double high, std::string_view label) {
  constexpr Size kSize{420, 62};
  const Frame frame{20.0, 4.0, kSize.width - 20.0, 18.0};
  std::string out = open_svg(kSize, label) + "<defs><linearGradient id='bar'>";
  for (std::size_t i = 0; i < stops.size(); ++i) {
    const double fraction = stops.size() > 1 ? static_cast<double>(i) / static_cast<double>(stops.size() - 1) : 0.0;
    out += "<stop offset='" + text_of(fraction, "%.4f") + "' stop-color='" + stops[i] + "'/>";
  }
  out += "</linearGradient></defs><rect x='" + text_of(frame.left) + "' y='" + text_of(frame.top) + "' width='" +
         text_of(frame.right - frame.left) + "' height='" + text_of(frame.bottom - frame.top) +
         "' rx='2' fill='url(#bar)'/>";
  const Axis axis{std::string(label), false, {}, {}};
  const Scale x(axis, Range{low, high}, frame.left, frame.right);
  for (const double tick : x.ticks(6)) {
    out += label_at(x(tick), frame.bottom + 15.0, "middle", (tick > 0 ? "+" : "") + tick_text(tick));
  }
  return out + label_at(0.5 * kSize.width, frame.bottom + 35.0, "middle", label, "fill='#5b6472'") + "</svg>";
}

} // namespace bregma::base
