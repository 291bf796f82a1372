// A tracker beside the arm, tied to it by hand-eye: the scan is made in the frame of the tracked reference, so that the
// patient may move while it is made and afterwards. The simulated tracker measures markers with noise; the hand-eye
// calibration is made from poses with noise, so that it has the error that its covariance states.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "idl/commands.hpp"
#include "idl/names.hpp"
#include "server/session/case_checksum.hpp"
#include "server/session/messages.hpp"
#include "tests/component/robot/robot_test.hpp"

namespace bregma::test {
namespace {

using geometry::Vector3d;

class ArmBesideTracker : public RobotTest {
protected:
  ArmBesideTracker() : RobotTest(true) {}
  [[nodiscard]] double tip_error_mm() const {
    return (Vector3d::Map(room.states.back().T_image_tip.translation_mm) - room.tip_in_image()).norm();
  }
  // RMS distance of the published points from the true skin.
  [[nodiscard]] double rms_from_skin_mm() const {
    const sim::Head head(the_case.loaded().scalp.mesh, 0.0, 15.0, 1);
    double sum = 0.0;
    for (const Vector3d &point : room.points) {
      sum += std::pow(head.clearance_mm(room.T_image_reference() * point), 2);
    }
    return std::sqrt(sum / static_cast<double>(room.points.size()));
  }
};

TEST_F(ArmBesideTracker, TheCalibrationIsPartOfTheCasesChecksum) {
  casefile::Case other = the_case.loaded();
  const std::string before = server::case_checksum(other);
  other.robot->equipment.hand_eye->joint(0, 0) *= 2.0;
  EXPECT_NE(server::case_checksum(other), before);
}

TEST_F(ArmBesideTracker, TheScanOfAPatientWhoMovesRegistersTheReference) {
  ASSERT_NO_FATAL_FAILURE(begin());
  room.move_patient(displacement({0.05, -0.04, 0.07}, {30.0, -25.0, 10.0}), 28.0);
  ASSERT_NO_FATAL_FAILURE(scan());
  ASSERT_GT(room.registration.surface_count, 150U) << room.registration.text;
  EXPECT_EQ(wire::view(room.batches.back().frame_name), "Reference");
  EXPECT_LT(rms_from_skin_mm(), 2.0);
  const wire::CommandReply accepted = room.command(bregma_wire_COMMAND_ACCEPT_REGISTRATION);
  ASSERT_EQ(accepted.result, bregma_wire_COMMAND_DONE) << accepted.text;
  verify();
  room.run(0.2);
  const double bound_mm = room.accuracy.targets[0].tre_95.semi_axes_mm[0];
  std::printf(
      "scan of a moving patient: %u points, RMS from the skin %.2f mm, error at the target %.2f mm, predicted RMS "
      "%.2f mm, 95 %% %.2f mm\n",
      room.registration.surface_count, rms_from_skin_mm(), target_error_mm(), room.accuracy.targets[0].tre_rms_mm,
      bound_mm);
  EXPECT_LT(target_error_mm(), bound_mm);

  expect_done(room.command(bregma_wire_COMMAND_START_NAVIGATION, {"Pointer", "Biopsy"}));
  ASSERT_TRUE(room.run(1.0, [&] { return live(); }));
  EXPECT_EQ(room.states.back().source_kind, bregma_wire_DEVICE_TRACKER);
  EXPECT_EQ(wire::view(room.states.back().source), "Tracker");
  EXPECT_EQ(room.states.back().patient, bregma_wire_PATIENT_TRACKED);
  // The patient moves on, and the pose follows.
  room.move_patient(displacement({0.02, 0.0, -0.05}, {-15.0, 10.0, 30.0}), 2.0);
  double worst = 0.0; // error relative to the bound that is shown with the pose
  for (int i = 0; i < 30; ++i) {
    room.run(0.1);
    ASSERT_TRUE(live());
    worst = std::max(worst, tip_error_mm() / room.states.back().tre_95.semi_axes_mm[0]);
  }
  std::printf("while the patient moves by 60 mm the tip is at most %.2f of its 95 %% bound off, then %.2f of %.2f mm\n",
              worst, tip_error_mm(), room.states.back().tre_95.semi_axes_mm[0]);
  EXPECT_LT(worst, 1.5);
  EXPECT_FALSE(room.alarm_raised(server::alarm::kHandEye, "Tracker"));
  EXPECT_FALSE(room.alarm_raised(server::alarm::kCheckExpired, "Reference"));
}

TEST_F(ArmBesideTracker, WithoutTheReferenceThereAreNoPointsAndWithoutEitherDeviceNoPose) {
  ASSERT_NO_FATAL_FAILURE(begin());
  const auto path = room.raster(40.0, 50.0, 8.0);
  ASSERT_TRUE(room.move({path.front()}, 80.0));
  expect_done(room.command(bregma_wire_COMMAND_START_SURFACE_SCAN, {"Robot", "Range", "0", "3"}));
  room.start_move(path, 20.0);
  ASSERT_TRUE(room.run(10.0, [&] { return room.points.size() > 10; }));
  room.hide_reference = true;
  room.run(0.5); // points that were measured before
  const std::size_t before = room.points.size();
  room.run(2.0);
  EXPECT_EQ(room.points.size(), before);
  EXPECT_TRUE(room.alarm_raised(server::alarm::kScanLost, "Range"));
  EXPECT_TRUE(room.alarm_raised(server::alarm::kScanStalled, "Range"));
  room.hide_reference = false;
  ASSERT_TRUE(room.run(5.0, [&] { return room.points.size() > before + 5; }));
  EXPECT_LT(rms_from_skin_mm(), 2.0);
  room.release_deadman();
  expect_done(room.command(bregma_wire_COMMAND_STOP_SURFACE_SCAN, {"Robot"}));
}

TEST_F(ArmBesideTracker, ATrackerThatWasMovedAgainstTheArmIsFoundAndNothingIsShown) {
  ASSERT_NO_FATAL_FAILURE(navigate());
  EXPECT_LT(target_error_mm(), 1.5);
  std::printf("touches beside a tracker: error at the target %.2f mm, predicted RMS %.2f mm, 95 %% %.2f mm\n",
              target_error_mm(), room.accuracy.targets[0].tre_rms_mm, room.accuracy.targets[0].tre_95.semi_axes_mm[0]);

  room.hide_reference = true;
  ASSERT_NO_FATAL_FAILURE(expect_not_live(0.5));
  EXPECT_EQ(room.states.back().status, bregma_wire_POSE_REFERENCE_HIDDEN);
  room.hide_reference = false;
  ASSERT_TRUE(room.run(1.0, [&] { return live(); }));

  room.deliver_tracker = false;
  ASSERT_NO_FATAL_FAILURE(expect_not_live(1.0));
  EXPECT_TRUE(room.alarm_raised(server::alarm::kTrackerLost, "Tracker"));
  room.deliver_tracker = true;
  ASSERT_TRUE(room.run(3.0, [&] { return live(); }));

  room.deliver_arm = false;
  ASSERT_NO_FATAL_FAILURE(expect_not_live(1.0));
  EXPECT_TRUE(room.alarm_raised(server::alarm::kRobotLost, "Robot"));
  room.deliver_arm = true;
  ASSERT_TRUE(room.run(3.0, [&] { return live(); }));

  // Numbers and times go on, and nothing is measured.
  room.tamper = room.frozen_values();
  ASSERT_NO_FATAL_FAILURE(expect_not_live(1.0));
  EXPECT_TRUE(room.alarm_raised(server::alarm::kImplausible, "Pointer"));
  room.tamper = [](wire::RobotState &) {};
  ASSERT_TRUE(room.run(3.0, [&] { return live(); }));

  // Slower than any test of a jump sees.
  double moved_mm = 0.0;
  while (moved_mm < 5.0 && live()) {
    moved_mm += 0.02;
    room.bump_tracker(moved_mm * Vector3d(1.0, 0.3, -0.2).normalized());
    room.run(0.008);
  }
  room.run(0.2);
  std::printf("the tracker was moved by %.1f mm when its poses were refused\n", moved_mm);
  EXPECT_LT(moved_mm, 5.0);
  EXPECT_FALSE(shown(room.states.back()));
  EXPECT_EQ(room.states.back().status, bregma_wire_POSE_IMPLAUSIBLE);
  EXPECT_TRUE(room.alarm_raised(server::alarm::kHandEye, "Tracker"));
  room.bump_tracker(Vector3d::Zero());
  room.run(2.0);
  EXPECT_FALSE(room.alarm_active(server::alarm::kHandEye));
}

} // namespace
} // namespace bregma::test
