#include "bench/accuracy/tissue_shift_picture.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace bregma::bench {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

struct ShiftLevel {
  double up_to_mm;
  const char *colour;
};
// [ColorBrewer] YlGnBu: distinguishable in greyscale too.
constexpr std::array<ShiftLevel, 8> kShiftLevels = {{{1, "#ffffd9"},
                                                     {2, "#edf8b1"},
                                                     {4, "#c7e9b4"},
                                                     {6, "#7fcdbb"},
                                                     {8, "#41b6c4"},
                                                     {10, "#1d91c0"},
                                                     {15, "#225ea8"},
                                                     {INFINITY, "#0c2c84"}}};

constexpr double kPixel_mm = 1.0;
constexpr double kUnits = 2.2; // units of the picture per mm
constexpr double kMargin_mm = 12.0;
constexpr double kTop = 40.0;
constexpr double kKey = 60.0;

// A view of a section. The two axes in its plane: the first to the right, the second up.
class View {
public:
  View(const ShiftPicture &picture, const ShiftSection &section)
      : picture_(picture), section_(section), right_(section.normal == 0 ? 1 : 0), up_(section.normal == 2 ? 1 : 2) {
    low_.setConstant(INFINITY);
    high_.setConstant(-INFINITY);
    for (std::size_t i = 0; i < picture.mesh->nodes_mm.size(); ++i) {
      for (const Vector3d &at : {rest(static_cast<int>(i)), now(static_cast<int>(i))}) {
        low_ = low_.cwiseMin(flat(at));
        high_ = high_.cwiseMax(flat(at));
      }
    }
    low_.array() = (low_.array() - kMargin_mm).floor();
    high_.array() = (high_.array() + kMargin_mm).ceil();
    columns_ = static_cast<int>((high_.x() - low_.x()) / kPixel_mm);
    rows_ = static_cast<int>((high_.y() - low_.y()) / kPixel_mm);
  }

  [[nodiscard]] double width() const { return kUnits * (high_.x() - low_.x()); }
  [[nodiscard]] double height() const { return kUnits * (high_.y() - low_.y()); }

  void draw(std::ostream &out, double left, double top) const {
    out << "<text x='" << left << "' y='" << top - 8 << "'>" << section_.title << "</text><svg x='" << left << "' y='"
        << top << "' width='" << width() << "' height='" << height() << "' viewBox='0 0 " << high_.x() - low_.x() << ' '
        << high_.y() - low_.y() << "'>";
    draw_fluid(out);
    draw_tissue(out);
    draw_outline(out);
    out << "</svg>";
    draw_gravity(out, left, top);
    out << "<rect x='" << left << "' y='" << top << "' width='" << width() << "' height='" << height()
        << "' fill='none' stroke='#bbb'/>";
  }

private:
  [[nodiscard]] std::size_t pixel(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(column);
  }
  [[nodiscard]] const Vector3d &rest(int node) const { return picture_.mesh->nodes_mm[static_cast<std::size_t>(node)]; }
  [[nodiscard]] Vector3d now(int node) const {
    return rest(node) + (*picture_.displacement_mm)[static_cast<std::size_t>(node)];
  }
  [[nodiscard]] Vector2d flat(const Vector3d &p) const { return {p[right_], p[up_]}; }
  [[nodiscard]] Vector2d on_paper(const Vector2d &p) const { return {p.x() - low_.x(), high_.y() - p.y()}; }

  // The remaining fluid, as a tint in the background. Only for sections that show the fluid level as a line.
  void draw_fluid(std::ostream &out) const {
    const Vector2d down = flat(picture_.gravity);
    if (down.norm() < 0.99) {
      return;
    }
    const Vector2d across(-down.y(), down.x());
    const Vector2d from = -picture_.fluid_height_mm * down;
    out << "<path fill='#e8f1f8' d='";
    char command = 'M';
    for (const Vector2d &corner :
         {Vector2d(from - 999.0 * across), Vector2d(from + 999.0 * across), Vector2d(from + 999.0 * (across + down)),
          Vector2d(from - 999.0 * (across - down))}) {
      out << command << on_paper(corner).x() << ' ' << on_paper(corner).y();
      command = 'L';
    }
    out << "z'/>";
  }

  // Levels of displacement on the displaced section, in rows from the top; -1 outside the tissue.
  [[nodiscard]] std::vector<int> levels() const {
    std::vector<int> out(pixel(rows_, 0), -1);
    for (const Eigen::Vector4i &t : picture_.mesh->tetrahedra) {
      Eigen::Matrix4d corners; // homogeneous coordinates in columns
      Vector2d low = Vector2d::Constant(INFINITY);
      Vector2d high = Vector2d::Constant(-INFINITY);
      for (int i = 0; i < 4; ++i) {
        corners.col(i) = now(t[i]).homogeneous();
        low = low.cwiseMin(on_paper(flat(now(t[i]))));
        high = high.cwiseMax(on_paper(flat(now(t[i]))));
      }
      if (corners.row(section_.normal).minCoeff() > section_.offset_mm ||
          corners.row(section_.normal).maxCoeff() < section_.offset_mm) {
        continue;
      }
      const Eigen::Matrix4d barycentric_of = corners.inverse();
      for (int row = static_cast<int>(low.y() / kPixel_mm); row < high.y() / kPixel_mm; ++row) {
        for (int column = static_cast<int>(low.x() / kPixel_mm); column < high.x() / kPixel_mm; ++column) {
          Vector3d at;
          at[section_.normal] = section_.offset_mm;
          at[right_] = low_.x() + (column + 0.5) * kPixel_mm;
          at[up_] = high_.y() - (row + 0.5) * kPixel_mm;
          const Eigen::Vector4d barycentric = barycentric_of * at.homogeneous();
          if (barycentric.minCoeff() >= 0.0) {
            out[pixel(row, column)] = level_of(moved_mm(t, barycentric));
          }
        }
      }
    }
    return out;
  }

  [[nodiscard]] double moved_mm(const Eigen::Vector4i &t, const Eigen::Vector4d &barycentric) const {
    Vector3d moved = Vector3d::Zero();
    for (int i = 0; i < 4; ++i) {
      moved += barycentric[i] * (*picture_.displacement_mm)[static_cast<std::size_t>(t[i])];
    }
    return moved.norm();
  }

  [[nodiscard]] static int level_of(double moved_mm) {
    int level = 0;
    while (moved_mm > kShiftLevels[static_cast<std::size_t>(level)].up_to_mm) {
      ++level;
    }
    return level;
  }

  // Pixels of one level, row by row, as one path.
  void draw_tissue(std::ostream &out) const {
    const std::vector<int> all = levels();
    out << "<g shape-rendering='crispEdges'>";
    for (int level = 0; level < static_cast<int>(kShiftLevels.size()); ++level) {
      out << "<path fill='" << kShiftLevels[static_cast<std::size_t>(level)].colour << "' d='";
      for (int row = 0; row < rows_; ++row) {
        const auto at = [&](int column) { return all[pixel(row, column)]; };
        for (int from = 0; from < columns_;) {
          int to = from;
          while (to < columns_ && at(to) == level) {
            ++to;
          }
          if (to > from) {
            out << 'M' << from << ' ' << row << 'h' << to - from << "v1h" << from - to << 'z';
          }
          from = std::max(to, from + 1);
        }
      }
      out << "'/>";
    }
    out << "</g>";
  }

  // The surface at rest where the section cuts it: the skull, and its opening.
  void draw_outline(std::ostream &out) const {
    std::ostringstream skull, opening;
    for (const Eigen::Vector3i &t : tissue::boundary_of(*picture_.mesh).triangles) {
      std::vector<Vector3d> cuts;
      for (int i = 0; i < 3; ++i) {
        const Vector3d &a = rest(t[i]);
        const Vector3d &b = rest(t[(i + 1) % 3]);
        const double from = a[section_.normal] - section_.offset_mm;
        const double to = b[section_.normal] - section_.offset_mm;
        if ((from < 0.0) != (to < 0.0)) {
          cuts.emplace_back(a + from / (from - to) * (b - a));
        }
      }
      if (cuts.size() == 2) {
        const Vector3d middle = 0.5 * (cuts[0] + cuts[1]);
        const bool open = (middle - picture_.craniotomy_mm).norm() < picture_.craniotomy_radius_mm;
        const Vector2d a = on_paper(flat(cuts[0]));
        const Vector2d b = on_paper(flat(cuts[1]));
        (open ? opening : skull) << 'M' << a.x() << ' ' << a.y() << 'L' << b.x() << ' ' << b.y();
      }
    }
    out << "<path fill='none' stroke='#444' stroke-width='.9' stroke-linecap='round' d='" << skull.str()
        << "'/><path fill='none' stroke='#d55e00' stroke-width='.9' stroke-dasharray='1.5 1.5' d='" << opening.str()
        << "'/>";
  }

  void draw_gravity(std::ostream &out, double left, double top) const {
    const Vector2d down = flat(picture_.gravity);
    if (down.norm() < 0.1) {
      return;
    }
    const Vector2d along(down.x(), -down.y());
    const Vector2d across(-along.y(), along.x());
    const Vector2d from(left + width() - 40.0, top + height() - 44.0);
    const Vector2d to = from + 26.0 * along;
    out << "<path stroke='#333' stroke-width='1.4' fill='none' d='M" << from.x() << ' ' << from.y() << 'L' << to.x()
        << ' ' << to.y();
    for (const double side : {-4.0, 4.0}) {
      const Vector2d barb = to - 7.0 * along + side * across;
      out << 'M' << barb.x() << ' ' << barb.y() << 'L' << to.x() << ' ' << to.y();
    }
    out << "'/><text x='" << from.x() + 6.0 << "' y='" << from.y() - 6.0 << "' text-anchor='middle'>gravity</text>";
  }

  const ShiftPicture &picture_;
  const ShiftSection &section_;
  int right_, up_;
  Vector2d low_, high_;
  int columns_ = 0, rows_ = 0;
};

void draw_shift_key(std::ostream &out, double top) {
  double x = 16.0;
  out << "<text x='" << x << "' y='" << top + 11 << "'>displacement, mm</text>";
  x += 112.0;
  for (const ShiftLevel &level : kShiftLevels) {
    out << "<rect x='" << x << "' y='" << top << "' width='24' height='14' fill='" << level.colour
        << "' stroke='#999'/><text x='" << x + 29.0 << "' y='" << top + 11 << "'>";
    if (std::isfinite(level.up_to_mm)) {
      out << "&#8804; " << level.up_to_mm;
    } else {
      out << "more";
    }
    out << "</text>";
    x += 69.0;
  }
  out << "<text x='16' y='" << top + 34
      << "'>dark line: the surface as it was imaged; dashed: where the skull is open; tinted: fluid</text>";
}

} // namespace

void draw(const ShiftPicture &picture, const std::string &file) {
  constexpr double kGap = 16.0;
  std::vector<View> views;
  double width = kGap;
  double height = 0.0;
  for (const ShiftSection &section : picture.sections) {
    views.emplace_back(picture, section);
    width += views.back().width() + kGap;
    height = std::max(height, views.back().height());
  }
  std::ostringstream out;
  out.precision(5);
  const double all_high = kTop + height + kKey;
  out << "<svg xmlns='http://www.w3.org/2000/svg' width='" << width << "' height='" << all_high << "' viewBox='0 0 "
      << width << ' ' << all_high << "' font-family='sans-serif' font-size='12'><rect width='100%' height='100%' "
      << "fill='white'/>";
  double left = kGap;
  for (const View &view : views) {
    view.draw(out, left, kTop);
    left += view.width() + kGap;
  }
  draw_shift_key(out, kTop + height + 16.0);
  out << "</svg>\n";
  std::ofstream stream(file);
  stream << out.str();
  if (!stream.flush()) {
    throw std::runtime_error("cannot write " + file);
  }
}

} // namespace bregma::bench
