// One pair of poses for `bregma calibrate hand-eye`: where the flange of a standing arm is, and the body on it.
//
// Both are the means of what arm and tracker have stated in the same interval, so that no common clock is needed.
//
// RobotBase, Tracker; mm, rad. Pure.
#pragma once

#include <vector>

#include "algorithms/geometry/rigid3.hpp"
#include "base/result.hpp"

namespace bregma::cli {

using StandingFlange = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::RobotFlange>;
using StandingBody = geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool>;

struct StandingPair {
  StandingFlange T_base_flange;
  StandingBody T_tracker_body;
};

// Of each at least.
inline constexpr std::size_t kStandingSamples = 10;
// An arm that stands stays within this.
inline constexpr double kStanding_mm = 0.1, kStanding_rad = 1e-3;

// Refused: too few samples, an arm that moves.
[[nodiscard]] base::Result<StandingPair> standing_pair(const std::vector<StandingFlange> &flanges,
                                                       const std::vector<StandingBody> &bodies);

} // namespace bregma::cli
