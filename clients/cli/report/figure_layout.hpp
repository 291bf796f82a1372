// Layout of plots as figures of the page. Internal to figures.hpp's sources.
#pragma once

#include <string>
#include <string_view>

#include "base/plots.hpp"

namespace bregma::cli::report {

// Two versions of a picture, wide and narrow; the style sheet shows the one that fits the screen.
template <class Draw> std::string responsive(Draw &&draw, int wide, int narrow) {
  return "<div class='wide'>" + draw(wide) + "</div><div class='narrow'>" + draw(narrow) + "</div>";
}

inline std::string figure(const std::string &picture, std::string_view caption) {
  return "<figure>" + picture + "<figcaption>" + base::escape(caption) + "</figcaption></figure>";
}

inline std::string full_width(const base::Plot &plot, std::string_view caption) {
  return figure(responsive(
                    [&](int width) {
                      return base::plot_svg(plot, {width, width > 600 ? 320 : 300});
                    },
                    1060, 420),
                caption);
}

inline std::string half_width(const base::Plot &plot, std::string_view caption) {
  return figure(responsive(
                    [&](int width) {
                      return base::plot_svg(plot, {width, width > 450 ? 370 : 340});
                    },
                    520, 420),
                caption);
}

} // namespace bregma::cli::report
