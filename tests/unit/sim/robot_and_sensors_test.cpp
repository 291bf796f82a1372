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

// Entries all over the front and both sides of the head: the guide reaches its pose on a smooth path.
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

// Hertz: 4/3 E / (1 - nu^2) sqrt(R) d^1.5, with a nu of 0.45.
double hertz_N(const TissueParameters &tissue, double depth_mm) {
  return 4.0 / 3.0 * 1e-6 * tissue.young_Pa / (1.0 - 0.45 * 0.45) * std::sqrt(tissue.tip_radius_mm) *
         std::pow(depth_mm, 1.5);
}

// A probe pushed along a line into a ball of brain and withdrawn; forces along its shaft.
class BallOfBrain {
public:
  static constexpr double kRadius_mm = 60.0;
  ForceSensor sensor{bregma::test::make_sphere(4, kRadius_mm, Vector3d::Zero()), {}, {}, kRobotSeed};
  TrueTool probe{*Patient(make_case(), {}, kRobotSeed).tool("Probe")};

  // Mean force between two depths, at 8 mm/s.
  double drive(double from_mm, double to_mm, double aside_mm = 0.0) {
    const Vector3d along(0, 0, -1);
    const auto rotation = point_tool(probe.model, along, Vector3d::UnitX());
    const Vector3d axis = probe.model.axis.normalized();
    const double step_mm = from_mm < to_mm ? 0.04 : -0.04;
    const int steps = static_cast<int>(std::lround((to_mm - from_mm) / step_mm));
    double sum = 0.0;
    for (int i = 0; i < steps; ++i, now_ns_ += 5'000'000) {
      const Vector3d tip(aside_mm, 0, kRadius_mm - from_mm - step_mm * i);
      const auto sample = sensor.sample(&probe, {rotation, tip}, now_ns_);
      sum -= Vector3d::Map(sample.force_N).dot(axis);
    }
    return sum / steps;
  }

private:
  std::int64_t now_ns_ = kStart_ns;
};

TEST(ForceSensor, MeasuresIndentationCuttingAndReverseFriction) {
  const TissueParameters truth;
  BallOfBrain ball;
  EXPECT_NEAR(ball.drive(-20.0, 0.0), 0.0, 0.002);
  EXPECT_NEAR(ball.drive(0.0, 3.5), 0.4 * hertz_N(truth, 3.5), 0.003) << "the mean of d^1.5";
  EXPECT_NEAR(ball.drive(3.5, 4.5), hertz_N(truth, 4.0), 0.003);
  (void)ball.drive(4.5, 30.0);
  const double slow = 8.0 / 8.5; // reduced slightly at low speed
  EXPECT_NEAR(ball.drive(30.0, 40.0), slow * (truth.cutting_N + 35.0 * truth.friction_N_per_mm), 0.002);
  (void)ball.drive(40.0, 39.0); // the sensor smooths the speed
  EXPECT_NEAR(ball.drive(39.0, 29.0), -slow * 34.0 * truth.friction_N_per_mm, 0.002);
}

TEST(ForceSensor, ARupturedSurfaceHasNoResistanceAnIntactOneHas) {
  BallOfBrain ball;
  (void)ball.drive(-2.0, 20.0);
  (void)ball.drive(20.0, -2.0);
  const double again_N = ball.drive(4.5, 5.0);
  (void)ball.drive(5.0, -2.0);
  const double beside_N = ball.drive(4.5, 5.0, 12.0); // there the ball's surface lies 1.2 mm lower
  EXPECT_LT(again_N, 0.065) << "through the hole: cutting, no indentation";
  EXPECT_NEAR(beside_N, hertz_N({}, 4.75 - 1.2), 0.01);
}

TEST(RangeSensor, MeasuresTheDistanceToTheSkin) {
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
