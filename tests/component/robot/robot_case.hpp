// A case with an arm, for tests: its folder, and the truth behind the calibrations in it.
#pragma once

#include <cstdint>

#include "algorithms/geometry/rigid3.hpp"
#include "casefile/case.hpp"
#include "drivers/sim/arm/simulated_arm.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::test {

// With the pose at which the arm begins.
[[nodiscard]] sim::ArmSettings arm_settings();

// What the case says about its range sensor.
struct RangeKnowledge {
  bool corrected = true;  // the curve's file has the corrections of the power law
  double excess_mm = 5.0; // in the file of the arm's tools
};

// A case with an arm: a head with a relief, which no motion maps onto itself, and the calibrations of tip, beam and
// curve as `bregma calibrate` writes them, with errors of the size that they state.
class RobotCase {
public:
  // beside_tracker: with a tracker beside the arm. Its hand-eye calibration is made from 20 measured poses.
  // flange_body: the case states the body on the flange, which checks it.
  explicit RobotCase(std::uint64_t seed, bool beside_tracker = false, bool flange_body = true,
                     const RangeKnowledge &known = {});
  [[nodiscard]] const casefile::Case &loaded() const { return case_; }

  // The truth behind the calibrations.
  [[nodiscard]] const geometry::Vector3d &beam_origin_mm() const { return origin_mm_; }
  [[nodiscard]] const geometry::Vector3d &beam_direction() const { return direction_; }
  [[nodiscard]] const geometry::Vector3d &tip_mm() const { return tip_mm_; }
  using T_BaseTracker = geometry::Rigid3<geometry::frame::RobotBase, geometry::frame::Tracker>;
  using T_FlangeBody = geometry::Rigid3<geometry::frame::RobotFlange, geometry::frame::Tool>;
  [[nodiscard]] const T_BaseTracker &T_base_tracker() const { return T_base_tracker_; }
  [[nodiscard]] const T_FlangeBody &T_flange_body() const { return T_flange_body_; }

private:
  void write_equipment(const RangeKnowledge &known) const;
  void write_hand_eye(std::uint64_t seed) const;

  TemporaryFolder folder_;
  casefile::Case case_;
  geometry::Vector3d origin_mm_, direction_, tip_mm_;
  T_BaseTracker T_base_tracker_;
  T_FlangeBody T_flange_body_;
};

} // namespace bregma::test
