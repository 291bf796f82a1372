#include "bench/accuracy/tissue_thesis_picture.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace bregma::bench {
namespace {

using Eigen::Vector2d;

struct Level {
  double up_to_Pa;
  const char *colour;
};
// Steps of about two, from pale to dark ([ColorBrewer] YlOrRd): distinguishable in greyscale too.
constexpr std::array<Level, 8> kLevels = {{{10, "#f7f5ee"},
                                           {20, "#ffeda0"},
                                           {50, "#fed976"},
                                           {100, "#feb24c"},
                                           {200, "#fd8d3c"},
                                           {500, "#f03b20"},
                                           {1000, "#bd0026"},
                                           {INFINITY, "#67000d"}}};

std::size_t pixel(int row, int column) {
  return static_cast<std::size_t>(row) * ThesisFrame::kColumns + static_cast<std::size_t>(column);
}

int level_of(double stress_Pa) {
  int level = 0;
  while (stress_Pa > kLevels[static_cast<std::size_t>(level)].up_to_Pa) {
    ++level;
  }
  return level;
}

constexpr double kScale = 2.9; // units of the picture per mm
constexpr double kPanelWidth = ThesisFrame::kColumns * ThesisFrame::kPixel_mm * kScale;
constexpr double kPanelHeight = ThesisFrame::kRows * ThesisFrame::kPixel_mm * kScale;
constexpr double kGap = 14.0;
constexpr double kTitle = 20.0;
constexpr int kAcross = 3;
constexpr double kMargin = 16.0;
constexpr double kWidth = 2.0 * kMargin + kAcross * kPanelWidth + (kAcross - 1) * kGap;

// Squares of one level, row by row, as one path.
void draw_levels(std::ostream &out, const ThesisFrame &frame) {
  for (int level = 0; level < static_cast<int>(kLevels.size()); ++level) {
    std::ostringstream path;
    for (int row = 0; row < ThesisFrame::kRows; ++row) {
      const auto at = [&](int column) { return frame.levels[pixel(row, column)]; };
      for (int from = 0; from < ThesisFrame::kColumns;) {
        int to = from;
        while (to < ThesisFrame::kColumns && at(to) == level) {
          ++to;
        }
        if (to > from) {
          path << 'M' << from << ' ' << ThesisFrame::kRows - 1 - row << 'h' << to - from << "v1h" << from - to << 'z';
        }
        from = std::max(to, from + 1);
      }
    }
    if (!path.str().empty()) {
      out << "<path fill='" << kLevels[static_cast<std::size_t>(level)].colour << "' d='" << path.str() << "'/>";
    }
  }
}

void draw_frame(std::ostream &out, const ThesisFrame &frame, double left, double top) {
  out << "<text x='" << left << "' y='" << top - 6 << "'>" << frame.title << "</text><svg x='" << left << "' y='" << top
      << "' width='" << kPanelWidth << "' height='" << kPanelHeight << "' viewBox='0 0 " << ThesisFrame::kColumns << ' '
      << ThesisFrame::kRows << "'><g shape-rendering='crispEdges'>";
  draw_levels(out, frame);
  out << "</g>";
  const double tip = frame.tip_mm + ThesisFrame::kBefore_mm;
  const double axis = ThesisFrame::kRows / 2.0;
  const double half = frame.half_width_mm;
  out << "<path fill='#8a93a0' fill-opacity='.85' stroke='#333' stroke-width='.4' d='M-2 " << axis - half << 'H'
      << tip - half << 'A' << half << ' ' << half << " 0 0 1 " << tip - half << ' ' << axis + half << "H-2'/>";
  const double x = frame.point_mm.x() + ThesisFrame::kBefore_mm;
  const double y = axis - frame.point_mm.y();
  out << "<path stroke='#0072b2' stroke-width='.7' d='M" << x - 2 << ' ' << y << "h4M" << x << ' ' << y - 2
      << "v4'/></svg><rect x='" << left << "' y='" << top << "' width='" << kPanelWidth << "' height='" << kPanelHeight
      << "' fill='none' stroke='#bbb'/>";
}

void draw_key(std::ostream &out, double left, double top) {
  out << "<text x='" << left << "' y='" << top + 11 << "'>von Mises stress (41), Pa</text>";
  double x = left + 165.0;
  for (const Level &level : kLevels) {
    out << "<rect x='" << x << "' y='" << top << "' width='26' height='14' fill='" << level.colour
        << "' stroke='#999'/>";
    x += 32.0;
    out << "<text x='" << x << "' y='" << top + 11 << "'>";
    if (std::isfinite(level.up_to_Pa)) {
      out << "&#8804; " << level.up_to_Pa;
    } else {
      out << "more";
    }
    out << "</text>";
    x += 48.0;
  }
}

void draw_curve(std::ostream &out, const std::vector<ThesisPoint> &points, const ThesisPicture &picture,
                const char *title, double left, double top, double width, double height) {
  constexpr double kFrom_m = 0.038;
  constexpr double kTo_m = 0.082;
  double high_Pa = 0.0;
  for (const ThesisPoint &p : points) {
    high_Pa = std::max(high_Pa, p.stress_Pa);
  }
  const double tick_Pa = high_Pa > 100.0 ? 50.0 : 10.0;
  high_Pa = tick_Pa * std::ceil(1.05 * high_Pa / tick_Pa);
  const auto x = [&](double tool_m) { return left + width * (tool_m - kFrom_m) / (kTo_m - kFrom_m); };
  const auto y = [&](double stress_Pa) { return top + height * (1.0 - stress_Pa / high_Pa); };
  const auto band = [&](double from_m, double to_m, const char *fill, const char *name) {
    out << "<rect x='" << x(from_m) << "' y='" << top << "' width='" << x(to_m) - x(from_m) << "' height='" << height
        << "' fill='" << fill << "'/><text x='" << 0.5 * (x(from_m) + x(to_m)) << "' y='" << top + 14
        << "' text-anchor='middle' fill='#555'>" << name << "</text>";
  };
  out << "<text x='" << left << "' y='" << top - 8 << "'>" << title << "</text>";
  band(picture.contact_m, picture.rupture_m, "#eaf2f8", "1 indentation");
  band(picture.rupture_m, kTo_m, "#fdf1e3", "3 penetration");
  out << "<path stroke='#d55e00' stroke-dasharray='4 3' d='M" << x(picture.rupture_m) << ' ' << top << 'v' << height
      << "'/><text x='" << x(picture.rupture_m) - 4 << "' y='" << top + 30
      << "' text-anchor='end' fill='#d55e00'>2 rupture</text>";
  for (double tick = 0.0; tick <= high_Pa; tick += tick_Pa) {
    out << "<path stroke='#ddd' d='M" << left << ' ' << y(tick) << 'h' << width << "'/><text x='" << left - 5 << "' y='"
        << y(tick) + 4 << "' text-anchor='end'>" << tick << "</text>";
  }
  for (int mm = 40; mm <= 80; mm += 10) {
    out << "<text x='" << x(1e-3 * mm) << "' y='" << top + height + 15 << "' text-anchor='middle'>0.0" << mm / 10
        << "</text>";
  }
  out << "<text x='" << left + width / 2 << "' y='" << top + height + 31
      << "' text-anchor='middle'>tool position, m</text><path fill='none' stroke='#0072b2' stroke-width='1.6' d='";
  char command = 'M';
  for (const ThesisPoint &p : points) {
    out << command << x(p.tool_m) << ' ' << y(p.stress_Pa);
    command = 'L';
  }
  out << "'/>";
  for (const ThesisPoint &p : points) {
    out << "<circle cx='" << x(p.tool_m) << "' cy='" << y(p.stress_Pa) << "' r='2.2' fill='#0072b2'/>";
  }
  out << "<rect x='" << left << "' y='" << top << "' width='" << width << "' height='" << height
      << "' fill='none' stroke='#999'/>";
}

} // namespace

std::vector<int> stress_levels(const tissue_plane::PlaneSolver &solver, const Vector2d &origin_mm) {
  std::vector<int> out(static_cast<std::size_t>(ThesisFrame::kRows * ThesisFrame::kColumns), -1);
  const std::vector<tissue_plane::PlaneStress> nodal = solver.nodal_stress();
  const Vector2d corner =
      origin_mm - Vector2d(ThesisFrame::kBefore_mm, 0.5 * ThesisFrame::kRows * ThesisFrame::kPixel_mm);
  for (const Eigen::Vector3i &t : solver.mesh().triangles) {
    std::array<Vector2d, 3> p;
    std::array<double, 3> stress{};
    for (std::size_t k = 0; k < 3; ++k) {
      const int node = t[static_cast<int>(k)];
      p[k] = (solver.position_mm(node) - corner) / ThesisFrame::kPixel_mm;
      stress[k] = nodal[static_cast<std::size_t>(node)].von_mises_plane();
    }
    const Vector2d low = p[0].cwiseMin(p[1]).cwiseMin(p[2]);
    const Vector2d high = p[0].cwiseMax(p[1]).cwiseMax(p[2]);
    const auto cross = [](const Vector2d &a, const Vector2d &b) { return a.x() * b.y() - a.y() * b.x(); };
    const double area = cross(p[1] - p[0], p[2] - p[0]);
    for (int row = std::max(0, static_cast<int>(low.y())); row < std::min(ThesisFrame::kRows * 1.0, high.y()); ++row) {
      for (int column = std::max(0, static_cast<int>(low.x()));
           column < std::min(ThesisFrame::kColumns * 1.0, high.x()); ++column) {
        const Vector2d at(column + 0.5, row + 0.5);
        const double b = cross(at - p[0], p[2] - p[0]) / area;
        const double c = cross(p[1] - p[0], at - p[0]) / area;
        if (std::min({b, c, 1.0 - b - c}) >= 0.0) {
          out[pixel(row, column)] = level_of((1.0 - b - c) * stress[0] + b * stress[1] + c * stress[2]);
        }
      }
    }
  }
  return out;
}

void draw(const ThesisPicture &picture, const std::string &file) {
  const int rows = (static_cast<int>(picture.frames.size()) + kAcross - 1) / kAcross;
  const double frames_high = rows * (kPanelHeight + kTitle + kGap);
  constexpr double kCurveHigh = 190.0;
  const double height = kMargin + frames_high + 40.0 + kCurveHigh + 60.0;
  std::ostringstream out;
  out.precision(5);
  out << "<svg xmlns='http://www.w3.org/2000/svg' width='" << kWidth << "' height='" << height << "' viewBox='0 0 "
      << kWidth << ' ' << height << "' font-family='sans-serif' font-size='12'><rect width='100%' height='100%' "
      << "fill='white'/>";
  for (std::size_t i = 0; i < picture.frames.size(); ++i) {
    const auto column = static_cast<double>(i % kAcross);
    const std::size_t row = i / kAcross;
    draw_frame(out, picture.frames[i], kMargin + column * (kPanelWidth + kGap),
               kMargin + kTitle + static_cast<double>(row) * (kPanelHeight + kTitle + kGap));
  }
  const double below = kMargin + frames_high;
  draw_key(out, kMargin, below);
  const double half = 0.5 * (kWidth - 2.0 * kMargin) - 50.0;
  draw_curve(out, picture.curve, picture, "von Mises stress at the evaluation point (blue cross), Pa: computed",
             kMargin + 40.0, below + 48.0, half, kCurveHigh);
  draw_curve(out, picture.table, picture, "the thesis' table 6.1, Pa", kMargin + half + 110.0, below + 48.0, half,
             kCurveHigh);
  out << "</svg>\n";
  std::ofstream stream(file);
  stream << out.str();
  if (!stream.flush()) {
    throw std::runtime_error("cannot write " + file);
  }
}

} // namespace bregma::bench
