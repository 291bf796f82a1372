// The operator of a case with an arm instead of a tracker (robot_room.hpp): what he does, step by step. Every step
// throws std::runtime_error with the daemon's text when it does not succeed.
#pragma once

#include <initializer_list>
#include <string_view>

#include "tests/component/robot/robot_room.hpp"

namespace bregma::test {

class RobotOperator {
public:
  RobotOperator(const RobotCase &a_case, RobotRoom &room) : case_(a_case.loaded()), room_(room) {}

  // The command must be done.
  void done(wire::CommandKind kind, std::initializer_list<std::string_view> values = {});
  void move(const std::vector<RobotRoom::Flange> &path, double speed_mm_s);
  // Loads the case and starts a registration.
  void begin();
  // The whole raster, and the search of the pose.
  void scan(double spacing_mm, double speed_mm_s);
  // Touches a point with the tip, from 30 mm before it and back, and returns the reply to the command.
  wire::CommandReply touch(wire::CommandKind kind, const casefile::NamedPoint &point);
  void touch_fiducials();
  void verify();
  // Registered by touches.
  void register_by_touches();
  // Registered by touches, verified, and navigating.
  void navigate();

  // Of the newest state.
  [[nodiscard]] bool live() const {
    return !room_.states.empty() && room_.states.back().status == bregma_wire_POSE_LIVE;
  }

private:
  const casefile::Case &case_;
  RobotRoom &room_;
};

// A pose that displays draw.
[[nodiscard]] inline bool shown(const wire::NavigationState &state) {
  return state.status == bregma_wire_POSE_LIVE || state.status == bregma_wire_POSE_UNVERIFIED;
}

} // namespace bregma::test
