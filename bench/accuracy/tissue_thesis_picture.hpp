// The picture of the thesis' set-up: von Mises stress on the section at each tool position, and over tool position.
#pragma once

#include <array>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "algorithms/tissue_plane/plane_solver.hpp"

namespace bregma::bench {

// A state of rest, reduced to the drawn squares of kPixel_mm around the probe.
struct ThesisFrame {
  static constexpr double kPixel_mm = 1.0;
  static constexpr int kColumns = 92; // from 7 mm before the surface on the axis
  static constexpr int kRows = 84;    // the axis in the middle
  static constexpr double kBefore_mm = 7.0;

  std::string title;
  std::vector<int> levels; // kRows x kColumns from the lower left; -1: no tissue
  double tip_mm = 0.0;     // from the surface on the axis
  double half_width_mm = 0.0;
  Eigen::Vector2d point_mm = Eigen::Vector2d::Zero(); // the evaluation point, from the surface on the axis
};

// origin_mm: intersection of the axis with the surface at rest.
[[nodiscard]] std::vector<int> stress_levels(const tissue_plane::PlaneSolver &solver, const Eigen::Vector2d &origin_mm);

struct ThesisPoint {
  double tool_m = 0.0;
  double stress_Pa = 0.0;
};

struct ThesisPicture {
  std::vector<ThesisFrame> frames;
  std::vector<ThesisPoint> curve; // computed, in order: the tool position does not change while the tissue ruptures
  std::vector<ThesisPoint> table; // table 6.1
  double contact_m = 0.0;
  double rupture_m = 0.0;
};

// Throws std::runtime_error when the file cannot be written.
void draw(const ThesisPicture &picture, const std::string &file);

} // namespace bregma::bench
