// A run of a cell whose subject is the arm that navigates a case without a tracker, or the range sensor that it
// carries: simulated arm and sensor with their drivers at the level of the wire (tests/component/robot/robot_room.hpp).
//
// Its judge knows where the tool really is, when the fault began, and which samples never arrived:
//   too old      a pose is shown later than 100 ms after the fault's begin
//   outside      before and after the fault the true tip is where the covariance of a shown pose allows it (tail
//                Judge::kTail)
//   not counted  lost = the numbers that never arrived
//   no alarm     within 1 s
//   trusted      a pose, or a point of a scan, before a person has said that it is the right device
//   not back     poses or points again within 3 s of what the operator does, or of the fault's end
#pragma once

#include "tests/faults/run.hpp"

namespace bregma::faults {

[[nodiscard]] bool is_arm_cell(const Cell &cell);
// Sessions in which the fault means something.
[[nodiscard]] bool meets_arm(const Cell &cell, During session);
[[nodiscard]] Outcome run_arm(const Cell &cell, During session);

} // namespace bregma::faults
