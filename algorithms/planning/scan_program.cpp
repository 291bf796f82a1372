#include "algorithms/planning/scan_program.hpp"

#include <cmath>
#include <cstdio>
#include <stdexcept>

#include <Eigen/Geometry>

namespace bregma::planning {

using Eigen::Vector3d;

namespace {

constexpr int kMaxLines = 10'000;
constexpr double kSecondsPerMinute = 60.0;

std::string block_of(const char *code, const Vector3d &p) {
  char line[120];
  std::snprintf(line, sizeof line, "%s X%.3f Y%.3f Z%.3f", code, p.x(), p.y(), p.z());
  return line;
}

} // namespace

std::vector<Vector3d> raster_corners(const RasterScan &scan) {
  const double across = scan.to_y_mm - scan.from_y_mm;
  if (!(scan.to_x_mm > scan.from_x_mm) || !(across >= 0.0) || !std::isfinite(across) ||
      !std::isfinite(scan.to_x_mm - scan.from_x_mm)) {
    throw std::invalid_argument("the area of the scan has no extent");
  }
  if (!(scan.line_mm > 0.0) || across / scan.line_mm > kMaxLines) {
    throw std::invalid_argument("line_mm = " + std::to_string(scan.line_mm) +
                                ": must be positive and give at most 10000 lines");
  }
  // As many lines as fit, in the middle of the area.
  const int lines = static_cast<int>(across / scan.line_mm + 1e-9) + 1;
  const double first_y = scan.from_y_mm + 0.5 * (across - scan.line_mm * (lines - 1));
  const double z = scan.table_z_mm + scan.height_mm;
  std::vector<Vector3d> out;
  for (int i = 0; i < lines; ++i) {
    const double y = first_y + i * scan.line_mm;
    out.emplace_back(i % 2 == 0 ? scan.from_x_mm : scan.to_x_mm, y, z);
    out.emplace_back(i % 2 == 0 ? scan.to_x_mm : scan.from_x_mm, y, z);
  }
  return out;
}

double length_mm(std::span<const Vector3d> positions) {
  double out = 0.0;
  for (std::size_t i = 1; i < positions.size(); ++i) {
    out += (positions[i] - positions[i - 1]).norm();
  }
  return out;
}

robot::FlangePose flange_above(const Vector3d &sensor_mm, const MountedSensor &sensor, double yaw_rad) {
  const Vector3d down = -Vector3d::UnitZ();
  const Eigen::Quaterniond turn = Eigen::Quaterniond(Eigen::AngleAxisd(yaw_rad, Vector3d::UnitZ())) *
                                  Eigen::Quaterniond::FromTwoVectors(sensor.direction, down);
  return {turn, Vector3d(sensor_mm - turn * sensor.origin_mm)};
}

std::string gcode(std::span<const Vector3d> positions, double speed_mm_s, double approach_mm, const std::string &name) {
  std::string out = "%\n(";
  for (const char c : name) { // a comment ends with its bracket
    out += c == '(' || c == ')' || static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  }
  out += ")\nG21\nG90\nG94\n";
  if (positions.empty()) {
    return out + "M30\n%\n";
  }
  const Vector3d up(0.0, 0.0, approach_mm);
  out += block_of("G0", positions.front() + up) + "\n" + block_of("G0", positions.front()) + "\n";
  char feed[40];
  std::snprintf(feed, sizeof feed, " F%.1f", kSecondsPerMinute * speed_mm_s);
  for (std::size_t i = 1; i < positions.size(); ++i) {
    out += block_of("G1", positions[i]) + (i == 1 ? feed : "") + "\n";
  }
  return out + block_of("G0", positions.back() + up) + "\nM30\n%\n";
}

} // namespace bregma::planning
