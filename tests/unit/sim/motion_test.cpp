// Paths of the hand: end points, smoothness, distance from the head.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "drivers/sim/hand_planning.hpp"
#include "drivers/sim/motion.hpp"
#include "drivers/sim/optical_tracker.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim::test {

namespace {

HandPose at(const Vector3d &tip, double turned_rad = 0.0) {
  return {tip, Quaterniond(Eigen::AngleAxisd(turned_rad, Vector3d::UnitZ())), 1.0, 1.0};
}

// Largest speed and acceleration of the tip, by differences of 1 ms.
std::pair<double, double> extremes(const Movement &movement) {
  const double dt = 1e-3;
  double speed = 0.0;
  double acceleration = 0.0;
  for (double t = -0.1; t < movement.duration_s() + 0.1; t += dt) {
    const Vector3d a = movement.at(t - dt).tip_mm;
    const Vector3d b = movement.at(t).tip_mm;
    const Vector3d c = movement.at(t + dt).tip_mm;
    speed = std::max(speed, (c - b).norm() / dt);
    acceleration = std::max(acceleration, (c - 2.0 * b + a).norm() / (dt * dt));
  }
  return {speed, acceleration};
}

} // namespace

TEST(Reach, IsTheMinimumJerkMovement) {
  const Reach reach(at({0, 0, 0}), at({200, 0, 0}, 0.5), 200.0);
  EXPECT_DOUBLE_EQ(reach.duration_s(), 1.0);
  EXPECT_NEAR((reach.at(0.0).tip_mm - Vector3d(0, 0, 0)).norm(), 0.0, 1e-12);
  EXPECT_NEAR((reach.at(1.0).tip_mm - Vector3d(200, 0, 0)).norm(), 0.0, 1e-9);
  EXPECT_NEAR((reach.at(0.5).tip_mm - Vector3d(100, 0, 0)).norm(), 0.0, 1e-9);
  EXPECT_NEAR(geometry::rotation_log(reach.at(1.0).rotation).norm(), 0.5, 1e-9);
  const auto [speed, acceleration] = extremes(reach);
  EXPECT_NEAR(speed, 1.875 * 200.0, 1.0) << "peak speed of the movement is 15/8 of its mean";
  EXPECT_NEAR(acceleration, 10.0 / std::sqrt(3.0) * 200.0, 15.0);
}

TEST(Glide, PassesTheKnotsAtConstantSpeedWithSmoothEnds) {
  std::vector<HandPose> knots;
  for (int i = 0; i <= 100; ++i) { // a quarter of a circle of 100 mm
    const double angle = 0.5 * std::numbers::pi * i / 100.0;
    knots.push_back(at(100.0 * Vector3d(std::cos(angle), std::sin(angle), 0.0), angle));
  }
  const Glide glide(knots, 50.0);
  EXPECT_NEAR(glide.length_mm(), 50.0 * std::numbers::pi, 0.1);
  EXPECT_NEAR((glide.at(0.0).tip_mm - knots.front().tip_mm).norm(), 0.0, 1e-9);
  EXPECT_NEAR((glide.at(99.0).tip_mm - knots.back().tip_mm).norm(), 0.0, 1e-9);
  for (double t = 0.0; t < glide.duration_s(); t += 0.01) {
    ASSERT_NEAR(glide.at(t).tip_mm.norm(), 100.0, 0.05) << t;
  }
  const auto [speed, acceleration] = extremes(glide);
  EXPECT_LT(speed, 56.0);
  EXPECT_LT(acceleration, 400.0);
}

TEST(Swing, KeepsTheTipAndTurnsAboutTwoAxes) {
  const Swing swing(at({10, 20, 30}),
                    {{{Vector3d::UnitX(), 0.6, 0.5}, {Vector3d::UnitY(), 0.5, 0.37}, {Vector3d::UnitZ(), 0.2, 0.2}}},
                    8.0);
  Vector3d low = Vector3d::Constant(9.0);
  Vector3d high = -low;
  for (double t = 0.0; t <= 8.0; t += 0.01) {
    EXPECT_EQ(swing.at(t).tip_mm, Vector3d(10, 20, 30));
    const Vector3d w = geometry::rotation_log(swing.at(t).rotation);
    low = low.cwiseMin(w);
    high = high.cwiseMax(w);
  }
  EXPECT_GT((high - low).x(), 1.0);
  EXPECT_GT((high - low).y(), 0.8);
  EXPECT_NEAR(geometry::rotation_log(swing.at(0.0).rotation).norm(), 0.0, 1e-9);
  EXPECT_NEAR(geometry::rotation_log(swing.at(8.0).rotation).norm(), 0.0, 1e-9);
}

TEST(HandPlanning, ReachesAroundTheHead) {
  const Patient patient(make_case(), {}, 3);
  const OperatorParameters parameters;
  const HandPlanning planning(patient, parameters);
  const TrueTool &stylus = *patient.tool("Stylus");
  int bowed = 0;
  for (const auto &from : patient.fiducials) {
    for (const auto &to : patient.fiducials) {
      const auto a = patient.head.skin(from.position_mm);
      const auto b = patient.head.skin(to.position_mm);
      const HandPose start = planning.stand_off(planning.grip(stylus, from.position_mm, a.normal), a.normal);
      const HandPose end = planning.stand_off(planning.grip(stylus, to.position_mm, b.normal), b.normal);
      const auto reach = planning.reach(start, end);
      for (double t = 0.0; t <= reach->duration_s(); t += 0.01) {
        ASSERT_GT(patient.head.clearance_mm(reach->at(t).tip_mm), 15.0) << from.name << " to " << to.name;
      }
      bool through = false;
      for (int i = 0; i <= 20; ++i) {
        through = through || patient.head.clearance_mm(start.tip_mm + i / 20.0 * (end.tip_mm - start.tip_mm)) < 15.0;
      }
      bowed += through ? 1 : 0;
    }
  }
  EXPECT_GT(bowed, 5) << "some straight ways would have gone through the head";
}

TEST(HandPlanning, HoldsToolsSoThatTheCameraSeesThem) {
  const Patient patient(make_case(), {}, 3);
  const OperatorParameters parameters;
  const HandPlanning planning(patient, parameters);
  const OpticalTracker tracker(patient, {}, 3);
  const TrueTool &stylus = *patient.tool("Stylus");
  const auto seen = [&](const TrueTool &tool, const HandPose &pose) {
    return tracker.look(tool, patient.T_tracker_image * tool.body({pose.rotation, pose.tip_mm})).seen;
  };
  for (const auto &points : {patient.fiducials, patient.landmarks}) {
    for (const auto &point : points) {
      const auto skin = patient.head.skin(point.position_mm);
      const HandPose grip = planning.grip(stylus, point.position_mm, skin.normal);
      EXPECT_EQ(seen(stylus, grip), 0xFU) << point.name;
      EXPECT_EQ(seen(stylus, planning.stand_off(grip, skin.normal)), 0xFU) << point.name;
    }
  }
  EXPECT_EQ(seen(stylus, planning.in_dimple(stylus)), 0xFU);
  EXPECT_EQ(seen(stylus, planning.in_stand(stylus, 1)), 0xFU);
}

} // namespace bregma::sim::test
