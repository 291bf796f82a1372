#include "algorithms/robot/straight_path.hpp"

#include <algorithm>

namespace bregma::robot {

void StraightPath::add(const FlangePose &waypoint) {
  const FlangePose &last = poses_.back();
  const double straight_mm = (waypoint.translation() - last.translation()).norm();
  const double turned_mm = kLever_mm * last.rotation().angularDistance(waypoint.rotation());
  poses_.push_back(waypoint);
  ends_mm_.push_back(ends_mm_.back() + std::max(straight_mm, turned_mm));
}

std::size_t StraightPath::leads_to(double at_mm) const {
  const auto end = std::upper_bound(ends_mm_.begin() + 1, ends_mm_.end(), at_mm);
  const auto found = static_cast<std::size_t>(end - ends_mm_.begin()) - 1;
  return waypoints() == 0 ? 0 : std::min(found, waypoints() - 1);
}

FlangePose StraightPath::pose(double at_mm) const {
  if (waypoints() == 0) {
    return poses_.front();
  }
  const std::size_t to = leads_to(at_mm);
  const double length_mm = ends_mm_[to + 1] - ends_mm_[to];
  const double part = length_mm > 0.0 ? std::clamp((at_mm - ends_mm_[to]) / length_mm, 0.0, 1.0) : 1.0;
  const FlangePose &from = poses_[to];
  const FlangePose &target = poses_[to + 1];
  return {from.rotation().slerp(part, target.rotation()),
          Vector3d((1.0 - part) * from.translation() + part * target.translation())};
}

} // namespace bregma::robot
