#include <gtest/gtest.h>

#include <cmath>

#include "drivers/sim/robot_arm.hpp"
#include "drivers/sim/sensors.hpp"
#include "idl/names.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim::test {

namespace {

constexpr std::uint64_t kRobotSeed = 5;

Random &dice() {
  static Random random(kRobotSeed, "test");
  return random;
}

} // namespace

TEST(RobotArm, JointsAndFlangeAgree) {
  for (int i = 0; i < 200; ++i) {
    RobotArm::Joints joints;
    joints << 0.1, -1.0, 1.5, -1.8, -1.4, 0.2;
    RobotArm::Joints start = joints;
    for (int j = 0; j < RobotArm::kJoints; ++j) {
      joints[j] += dice().uniform(-0.3, 0.3);
    }
    const T_BaseFlange wanted = RobotArm::forward(joints);
    ASSERT_TRUE(RobotArm::inverse(wanted, start));
    const T_BaseFlange found = RobotArm::forward(start);
    EXPECT_LT((found.translation() - wanted.translation()).norm(), 1e-5);
    EXPECT_LT(geometry::angle_between(found.rotation(), wanted.rotation()), 1e-7);
  }
  RobotArm::Joints joints = RobotArm::Joints::Constant(0.5);
  EXPECT_FALSE(RobotArm::inverse({Quaterniond::Identity(), Vector3d(3000, 0, 0)}, joints)) << "out of reach";
  EXPECT_TRUE(joints.allFinite());
}

// To entries all over the front and both sides of the head: the guide stands where it should, the way there is smooth.
TEST(RobotArm, HoldsTheGuideOnThePlannedLine) {
  const Patient patient(make_case(), {}, kRobotSeed);
  RobotParameters parameters;
  parameters.encoder_noise_mrad = 0.0;
  const Vector3d target = bregma::test::kHeadCentre;
  for (const Vector3d &direction : {Vector3d(0.45, 0.45, 0.75), Vector3d(-0.45, 0.45, 0.75), Vector3d(0, 0.8, 0.6),
                                    Vector3d(0.9, 0.2, 0.4), Vector3d(-0.9, 0.2, 0.4)}) {
    RobotArm arm(patient, parameters, kRobotSeed);
    (void)arm.sample(kStart_ns);
    const Vector3d entry = bregma::test::on_head(direction);
    const Vector3d along = (target - entry).normalized();
    const auto goal = arm.looking(entry - 90.0 * along, along);
    arm.go(goal, kStart_ns);
    std::int64_t now = kStart_ns;
    double fastest = 0.0;
    while (!arm.arrived(now)) {
      now += 10'000'000;
      const auto state = arm.sample(now);
      ASSERT_EQ(state.mode, bregma_wire_ROBOT_ENABLED) << direction.transpose();
      for (int j = 0; j < RobotArm::kJoints; ++j) {
        fastest = std::max(fastest, std::abs(state.joint_velocity_rad_s[j]));
      }
    }
    EXPECT_LT(fastest, 3.0) << "rad/s, to " << direction.transpose();
    EXPECT_LT((arm.flange().translation() - goal.translation()).norm(), 1e-4);
    EXPECT_GT((arm.flange().rotation() * Vector3d::UnitZ()).dot(along), 1.0 - 1e-9);
  }
}

TEST(ForceSensor, FeelsTissueOnlyInTheHeadAndAgainstTheMotion) {
  const Patient patient(make_case(), {}, kRobotSeed);
  SensorParameters parameters;
  ForceSensor sensor(patient, parameters, kRobotSeed);
  const TrueTool &probe = *patient.tool("Probe");
  const Vector3d entry = bregma::test::on_head(Vector3d(0.45, 0.45, 0.75));
  const Vector3d along = (bregma::test::kHeadCentre - entry).normalized();
  const auto rotation = point_tool(probe.model, along, Vector3d::UnitX());
  double outside = 0.0;
  double inside = 0.0;
  double back = 0.0;
  std::int64_t now = kStart_ns;
  for (int i = 0; i < 3000; ++i, now += 5'000'000) {
    const double depth = i < 2000 ? -20.0 + 0.04 * i : 60.0 - 0.04 * (i - 2000); // 8 mm/s in, then out
    const auto sample = sensor.sample(&probe, {rotation, entry + depth * along}, now);
    const double axial = Vector3d(sample.force_N[0], sample.force_N[1], sample.force_N[2]).dot(probe.model.axis);
    outside += depth < -1.0 && i < 2000 ? axial / 475.0 : 0.0;
    inside += depth > 40.0 && i < 2000 ? axial / 500.0 : 0.0;
    back += depth > 40.0 && i > 2100 ? axial / 400.0 : 0.0;
  }
  EXPECT_NEAR(outside, 0.0, 0.01);
  EXPECT_LT(inside, -0.3) << "pushed back while it goes in";
  EXPECT_GT(back, 0.1) << "held while it comes out";
}

TEST(RangeSensor, MeasuresTheWayToTheSkin) {
  PatientParameters flat;
  flat.skin_sigma_mm = 0.0;
  const Patient patient(make_case(), flat, kRobotSeed);
  SensorParameters parameters;
  RangeSensor sensor(patient, parameters, kRobotSeed);
  const Vector3d direction = Vector3d(0.3, 0.8, 0.4).normalized();
  const Vector3d skin = bregma::test::on_head(direction);
  const Vector3d beam = (bregma::test::kHeadCentre - skin).normalized();
  const T_ImageFlange flange{Quaterniond::FromTwoVectors(Vector3d::UnitZ(), beam), skin - 123.0 * beam};
  double mean = 0.0;
  for (int i = 0; i < 1000; ++i) {
    const auto sample = sensor.sample(flange);
    ASSERT_TRUE(sample);
    EXPECT_EQ(sample->sigma_mm, parameters.range_noise_mm);
    mean += sample->range_mm / 1000.0;
  }
  EXPECT_NEAR(mean, 123.0, 0.5) << "the mesh is cut from the head's shape";
  const T_ImageFlange away{Quaterniond::FromTwoVectors(Vector3d::UnitZ(), Vector3d(-beam)), flange.translation()};
  EXPECT_FALSE(sensor.sample(away)) << "no echo, no sample";
}

} // namespace bregma::sim::test
