// A path of the flange in straight lines between waypoints. Its length counts a rotation as the way of a point 250 mm
// off the flange's axis, so that a speed along the path limits both.
//
// Not for several threads at a time.
#pragma once

#include <cstddef>
#include <vector>

#include "algorithms/robot/arm_model.hpp"

namespace bregma::robot {

class StraightPath {
public:
  static constexpr double kLever_mm = 250.0;

  explicit StraightPath(const FlangePose &start) : poses_{start}, ends_mm_{0.0} {}
  void add(const FlangePose &waypoint);

  [[nodiscard]] double length_mm() const { return ends_mm_.back(); }
  [[nodiscard]] std::size_t waypoints() const { return poses_.size() - 1; }
  // The waypoint that a position along the path leads to, from 0; the last one at the end.
  [[nodiscard]] std::size_t leads_to(double at_mm) const;
  // Where the segment ends that holds this position.
  [[nodiscard]] double segment_end_mm(double at_mm) const { return ends_mm_[leads_to(at_mm) + 1]; }
  [[nodiscard]] FlangePose pose(double at_mm) const;

private:
  std::vector<FlangePose> poses_; // the start, then the waypoints
  std::vector<double> ends_mm_;   // position of each
};

} // namespace bregma::robot
