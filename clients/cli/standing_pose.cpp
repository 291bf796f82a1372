#include "clients/cli/standing_pose.hpp"

#include <cstdio>
#include <string>

namespace bregma::cli {

namespace {

// Of poses that are close together: the mean of their turns from the first one.
template <class Pose> Pose mean_of(const std::vector<Pose> &poses) {
  geometry::Vector3d place = geometry::Vector3d::Zero(), turn = geometry::Vector3d::Zero();
  for (const Pose &pose : poses) {
    place += pose.translation();
    turn += geometry::rotation_log(poses.front().rotation().conjugate() * pose.rotation());
  }
  const auto count = static_cast<double>(poses.size());
  return {poses.front().rotation() * geometry::rotation_exp(turn / count), geometry::Vector3d(place / count)};
}

} // namespace

base::Result<StandingPair> standing_pair(const std::vector<StandingFlange> &flanges,
                                         const std::vector<StandingBody> &bodies) {
  if (flanges.size() < kStandingSamples) {
    return base::failure("the arm states no pose (" + std::to_string(flanges.size()) +
                         " samples): is its driver running?");
  }
  if (bodies.size() < kStandingSamples) {
    return base::failure("the body on the flange was seen in " + std::to_string(bodies.size()) + " frames, " +
                         std::to_string(kStandingSamples) +
                         " are needed: is it hidden, or turned away from the tracker?");
  }
  StandingPair out{mean_of(flanges), mean_of(bodies)};
  for (const StandingFlange &flange : flanges) {
    const double way_mm = (flange.translation() - out.T_base_flange.translation()).norm();
    const double turn_rad = geometry::angle_between(flange.rotation(), out.T_base_flange.rotation());
    if (!(way_mm <= kStanding_mm && turn_rad <= kStanding_rad)) {
      return base::failure("the arm moves: the pose must be one at which it stands");
    }
  }
  return out;
}

} // namespace bregma::cli
