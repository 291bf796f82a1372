#include "base/svg.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace bregma::base {

std::string text_of(double value, const char *format) {
  char buffer[64];
  return {buffer, static_cast<std::size_t>(std::snprintf(buffer, sizeof(buffer), format, value))};
}

std::string tick_text(double value) {
  const double magnitude = std::abs(value);
  return text_of(magnitude < 1e-12 ? 0.0 : value, magnitude >= 1e5 ? "%.1e" : "%.6g");
}

double text_width(std::string_view text) { return kCharacter * static_cast<double>(text.size()); }

void Range::add(double value, bool positive_only) {
  if (std::isfinite(value) && (!positive_only || value > 0.0)) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
}

Range chosen_range(const Axis &axis, Range data, bool air) {
  if (data.empty()) {
    data = axis.logarithmic ? Range{0.1, 10.0} : Range{0.0, 1.0};
  }
  if (air && !axis.logarithmic) {
    const double extra = 0.06 * (data.high - data.low);
    data.low = data.low >= 0.0 && data.low < 0.5 * data.high ? 0.0 : data.low - extra; // lengths begin at zero
    data.high += extra;
  }
  if (axis.logarithmic && air) {
    data.low *= 0.8;
    data.high *= 1.25;
  }
  data.low = axis.from.value_or(data.low);
  data.high = axis.to.value_or(data.high);
  if (!(data.high > data.low)) {
    data.high = axis.logarithmic ? data.low * 10.0 : data.low + std::max(1.0, std::abs(data.low) * 0.1);
  }
  return data;
}

bool Scale::holds(double value) const { return std::isfinite(value) && (!logarithmic_ || value > 0.0); }

double Scale::operator()(double value) const {
  const double fraction =
      logarithmic_ ? std::log(value / low()) / std::log(high() / low()) : (value - low()) / (high() - low());
  return paper_from_ + fraction * (paper_to_ - paper_from_);
}

double Scale::clamped(double value) const { return (*this)(std::clamp(value, low(), high())); }

std::vector<double> Scale::ticks(int wanted) const {
  return logarithmic_ ? logarithmic_ticks(low(), high()) : linear_ticks(low(), high(), wanted);
}

std::string label_at(double x, double y, std::string_view anchor, std::string_view text, std::string_view attributes) {
  return "<text x='" + text_of(x) + "' y='" + text_of(y) + "' text-anchor='" + std::string(anchor) + "' " +
         std::string(attributes) + ">" + escape(text) + "</text>";
}

std::string line_between(double x1, double y1, double x2, double y2, std::string_view attributes) {
  return "<line x1='" + text_of(x1) + "' y1='" + text_of(y1) + "' x2='" + text_of(x2) + "' y2='" + text_of(y2) + "' " +
         std::string(attributes) + "/>";
}

std::string open_svg(Size size, std::string_view title) {
  return "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 " + std::to_string(size.width) + " " +
         std::to_string(size.height) + "' role='img' aria-label='" + escape(title) + "' font-size='" +
         text_of(kFont, "%.0f") + "' fill='#3b4350'>";
}

std::string x_axis(const Scale &x, const Frame &frame, const Axis &axis) {
  std::string out;
  const int wanted = std::max(4, static_cast<int>((frame.right - frame.left) / 75.0));
  for (const double tick : x.ticks(wanted)) {
    out += line_between(x(tick), frame.top, x(tick), frame.bottom, "stroke='#e7eaef'");
    out += label_at(x(tick), frame.bottom + 17.0, "middle", tick_text(tick));
  }
  out += label_at(0.5 * (frame.left + frame.right), frame.bottom + 36.0, "middle", axis.label, "fill='#5b6472'");
  return out;
}

std::string y_axis(const Scale &y, const Frame &frame, const Axis &axis) {
  std::string out;
  for (const double tick : y.ticks(5)) {
    out += line_between(frame.left, y(tick), frame.right, y(tick), "stroke='#e7eaef'");
    out += label_at(frame.left - 7.0, y(tick) + 4.5, "end", tick_text(tick));
  }
  const std::string middle = text_of(0.5 * (frame.top + frame.bottom));
  out += "<text transform='translate(13 " + middle + ") rotate(-90)' text-anchor='middle' fill='#5b6472'>" +
         escape(axis.label) + "</text>";
  return out;
}

std::string escape(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    switch (c) {
    case '&':
      out += "&amp;";
      break;
    case '<':
      out += "&lt;";
      break;
    case '>':
      out += "&gt;";
      break;
    case '"':
      out += "&quot;";
      break;
    case '\'':
      out += "&#39;";
      break;
    default:
      out += static_cast<unsigned char>(c) < 0x20U ? ' ' : c;
    }
  }
  return out;
}

std::vector<double> linear_ticks(double from, double to, int wanted) {
  std::vector<double> out;
  if (!(to > from) || !std::isfinite(to - from) || wanted < 1) {
    return out;
  }
  const double raw = (to - from) / wanted;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  const double digit = raw / power;
  const double step = power * (digit <= 1.0 ? 1.0 : digit <= 2.0 ? 2.0 : digit <= 5.0 ? 5.0 : 10.0);
  const double slack = 1e-9 * (to - from);
  for (double i = std::ceil((from - slack) / step); i * step <= to + slack; ++i) {
    out.push_back(i * step);
  }
  return out;
}

std::vector<double> logarithmic_ticks(double from, double to) {
  std::vector<double> out;
  if (!(from > 0.0) || !(to > from) || !std::isfinite(to)) {
    return out;
  }
  const bool few_decades = std::log10(to / from) < 2.5;
  for (double power = std::pow(10.0, std::floor(std::log10(from))); power <= to; power *= 10.0) {
    for (const double digit : {1.0, 2.0, 5.0}) {
      const double tick = digit * power;
      if ((digit == 1.0 || few_decades) && tick >= from * (1.0 - 1e-9) && tick <= to * (1.0 + 1e-9)) {
        out.push_back(tick);
      }
    }
  }
  return out;
}

} // namespace bregma::base
