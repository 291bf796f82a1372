// Distances of an arm from its surroundings, checks of paths, and the program of a scan.
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include "algorithms/planning/arm_collision.hpp"
#include "algorithms/planning/guide_move.hpp"
#include "algorithms/planning/scan_program.hpp"
#include "algorithms/robot/straight_path.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/robot/arms.hpp"

namespace bregma::planning {
namespace {

using Eigen::Vector3d;

robot::JointAngles scanning() {
  robot::JointAngles out;
  out << 0.0, 1.4, 0.0, 0.1, -1.1, 0.0;
  return out;
}

ArmBodies with_guide() {
  ArmBodies out;
  out.tools.push_back({"guide", Vector3d::Zero(), Vector3d(0.0, 0.0, 120.0), 6.0});
  return out;
}

robot::FlangePose beside(const robot::FlangePose &pose, const Vector3d &by) {
  return {pose.rotation(), Vector3d(pose.translation() + by)};
}

TEST(ArmCollision, MeasuresTheNearestPart) {
  const auto arm = test::mz07f();
  const robot::FlangePose flange = arm.forward(scanning());
  const Vector3d tip = flange * Vector3d(0.0, 0.0, 120.0);
  const Vector3d ahead = flange.rotation() * Vector3d::UnitZ();
  ArmScene scene;
  scene.obstacles.push_back({"ball", test::make_sphere(5, 40.0, tip + 70.0 * ahead)});
  const ArmCollision collision(arm, with_guide(), scene);
  const Nearest found = collision.nearest(scanning());
  EXPECT_EQ(found.part, "guide");
  EXPECT_EQ(found.obstacle, "ball");
  EXPECT_NEAR(found.distance_mm, 70.0 - 40.0 - 6.0, 0.1); // the mesh lies a little within the sphere
  // The table under the forearm.
  ArmScene table;
  table.table_z_mm = -100.0;
  EXPECT_EQ(ArmCollision(arm, {}, table).nearest(scanning()).obstacle, "table");
  EXPECT_TRUE(std::isinf(ArmCollision(arm, {}, {}).nearest(scanning()).distance_mm));
}

TEST(ArmCollision, APartInsideAnObstacleTouchesIt) {
  const auto arm = test::mz07f();
  const Vector3d tip = arm.forward(scanning()) * Vector3d(0.0, 0.0, 60.0);
  ArmScene scene;
  scene.obstacles.push_back(block("cabinet", tip - Vector3d::Constant(400.0), tip + Vector3d::Constant(400.0)));
  EXPECT_EQ(ArmCollision(arm, with_guide(), scene).nearest(scanning()).distance_mm, 0.0);
}

TEST(ArmCollision, RefusesWhatItCannotMeasure) {
  const auto arm = test::mz07f();
  ArmScene open;
  open.obstacles.push_back(block("board", Vector3d::Zero(), Vector3d::Ones()));
  open.obstacles.back().mesh.triangles.pop_back();
  EXPECT_THROW(ArmCollision(arm, {}, open), std::invalid_argument);
  ArmBodies thin;
  thin.radius_mm[2] = 0.0;
  EXPECT_THROW(ArmCollision(arm, thin, {}), std::invalid_argument);
  ArmBodies endless = with_guide();
  endless.tools[0].to_mm.x() = std::nan("");
  EXPECT_THROW(ArmCollision(arm, endless, {}), std::invalid_argument);
}

TEST(ArmCollision, NoPointMovesFartherThanStated) {
  const auto arm = test::mz07f();
  const ArmCollision collision(arm, with_guide(), {});
  std::mt19937 rng(5);
  for (int run = 0; run < 500; ++run) {
    const robot::JointAngles from = test::random_joints(arm, rng);
    const robot::JointAngles to = from + 0.05 * robot::JointAngles::Random();
    const double moved =
        (arm.forward(from) * Vector3d(0.0, 0.0, 120.0) - arm.forward(to) * Vector3d(0.0, 0.0, 120.0)).norm();
    EXPECT_LE(moved, collision.moved_mm(from, to) + 1e-9);
  }
}

TEST(PathCheck, RefusesAMoveThroughTheHeadAndNamesThePlace) {
  const auto arm = test::mz07f();
  const robot::InverseKinematics inverse(arm);
  const robot::FlangePose start = arm.forward(scanning());
  const Vector3d tip = start * Vector3d(0.0, 0.0, 120.0);
  ArmScene scene; // a ball beside the tip: a move to the side leads through it
  scene.obstacles.push_back({"head", test::make_sphere(4, 30.0, tip + Vector3d(0.0, 80.0, 0.0))});
  const ArmCollision collision(arm, with_guide(), scene);
  const robot::FlangePose through = beside(start, {0.0, 160.0, 0.0});
  const PathCheck refused = check_path(collision, inverse, scanning(), {&through, 1});
  EXPECT_EQ(refused.verdict, PathVerdict::kTooClose);
  EXPECT_NE(refused.text.find("guide comes within"), std::string::npos) << refused.text;
  EXPECT_NE(refused.text.find("of head"), std::string::npos);
  EXPECT_NEAR(refused.at_mm, 80.0 - 30.0 - 6.0 - 10.0, 1.5);
  // Over it, in three lines.
  const std::vector<robot::FlangePose> over{beside(start, {0.0, 0.0, 180.0}), beside(start, {0.0, 160.0, 180.0}),
                                            through};
  const PathCheck clear = check_path(collision, inverse, scanning(), over);
  ASSERT_TRUE(clear.clear()) << clear.text;
  EXPECT_NEAR(clear.length_mm, 180.0 + 160.0 + 180.0, 1e-6);
  // Nowhere nearer than the bound, at samples that the check did not take.
  robot::StraightPath path(start);
  for (const robot::FlangePose &pose : over) {
    path.add(pose);
  }
  robot::JointAngles joints = scanning();
  double least = 1e9;
  for (double at = 0.0; at < path.length_mm(); at += 0.37) {
    const auto solution = inverse.nearest(path.pose(at), joints);
    ASSERT_TRUE(solution);
    joints = solution->joints;
    least = std::min(least, collision.nearest(joints).distance_mm);
  }
  EXPECT_GE(least, clear.bound_mm);
  EXPECT_GE(clear.bound_mm, 10.0);
  EXPECT_LT(least, clear.nearest.distance_mm + 1.0);
}

TEST(PathCheck, AThinObstacleBetweenTwoSamplesIsFound) {
  const auto arm = test::mz07f();
  const robot::InverseKinematics inverse(arm);
  const robot::FlangePose start = arm.forward(scanning());
  const Vector3d tip = start * Vector3d(0.0, 0.0, 120.0);
  ArmScene scene; // a wire of 0.2 mm
  scene.obstacles.push_back(block("wire", tip + Vector3d(-200.0, 44.9, -300.0), tip + Vector3d(200.0, 45.1, -5.0)));
  const robot::FlangePose to = beside(start, {0.0, 90.0, 0.0});
  PathCheckOptions coarse;
  coarse.step_mm = 90.0;
  coarse.min_distance_mm = 1.0;
  const PathCheck check = check_path(ArmCollision(arm, with_guide(), scene), inverse, scanning(), {&to, 1}, coarse);
  EXPECT_EQ(check.verdict, PathVerdict::kTooClose) << check.text;
}

TEST(PathCheck, SaysWhereTheArmDoesNotReach) {
  const auto arm = test::mz07f();
  const robot::InverseKinematics inverse(arm);
  const robot::FlangePose far = beside(arm.forward(scanning()), {2000.0, 0.0, 0.0});
  const PathCheck check = check_path(ArmCollision(arm, {}, {}), inverse, scanning(), {&far, 1});
  EXPECT_EQ(check.verdict, PathVerdict::kNotReached);
  EXPECT_GT(check.at_mm, 10.0);
  EXPECT_LT(check.at_mm, 900.0);
  EXPECT_EQ(check_path(ArmCollision(arm, {}, {}), inverse, scanning(), {}).verdict, PathVerdict::kClear);
}

TEST(ScanProgram, GoesThereAndBackOverTheArea) {
  const RasterScan scan{.from_x_mm = 400.0, .to_x_mm = 500.0, .from_y_mm = -11.0, .to_y_mm = 11.0, .line_mm = 10.0};
  const auto corners = raster_corners(scan);
  ASSERT_EQ(corners.size(), 6U);
  EXPECT_EQ(corners[0], Vector3d(400.0, -10.0, 200.0));
  EXPECT_EQ(corners[1], Vector3d(500.0, -10.0, 200.0));
  EXPECT_EQ(corners[2], Vector3d(500.0, 0.0, 200.0));
  EXPECT_EQ(corners[5], Vector3d(500.0, 10.0, 200.0));
  EXPECT_DOUBLE_EQ(length_mm(corners), 320.0);
  const std::string program = gcode(corners, 5.0, 50.0, "scan (1)\n");
  EXPECT_EQ(program.rfind("%\n(scan  1  )\nG21\nG90\nG94\nG0 X400.000 Y-10.000 Z250.000\n"
                          "G0 X400.000 Y-10.000 Z200.000\nG1 X500.000 Y-10.000 Z200.000 F300.0\n"
                          "G1 X500.000 Y0.000 Z200.000\n",
                          0),
            0U)
      << program;
  EXPECT_TRUE(program.ends_with("G0 X500.000 Y10.000 Z250.000\nM30\n%\n"));
  RasterScan empty = scan;
  empty.to_x_mm = 400.0;
  EXPECT_THROW(static_cast<void>(raster_corners(empty)), std::invalid_argument);
  empty = scan;
  empty.line_mm = 1e-6;
  EXPECT_THROW(static_cast<void>(raster_corners(empty)), std::invalid_argument);
}

TEST(ScanProgram, TheFlangeHoldsTheBeamOverThePosition) {
  const MountedSensor sensor{{12.0, -8.0, 45.0}, Vector3d(0.03, -0.05, 1.0).normalized()};
  const Vector3d at(450.0, 20.0, 200.0);
  for (const double yaw : {0.0, 0.7, -2.0}) {
    const robot::FlangePose flange = flange_above(at, sensor, yaw);
    EXPECT_LT((flange * sensor.origin_mm - at).norm(), 1e-9);
    EXPECT_LT((flange.rotation() * sensor.direction + Vector3d::UnitZ()).norm(), 1e-9);
  }
}

// A head in front of the guide, and goals around it.
struct GuideScene {
  robot::ArmModel arm = test::mz07f();
  robot::InverseKinematics inverse{arm};
  robot::FlangePose start = arm.forward(scanning());
  Vector3d ahead = start.rotation() * Vector3d::UnitZ();
  Vector3d middle = start * Vector3d(0.0, 0.0, 120.0) + 170.0 * ahead;
  double radius = 80.0;
  GuideOnFlange guide{Vector3d(0.0, 0.0, 120.0), Vector3d::UnitZ()};

  [[nodiscard]] ArmCollision collision() const {
    ArmScene scene;
    scene.obstacles.push_back({"head", test::make_sphere(4, radius, middle)});
    return {arm, with_guide(), scene};
  }
  // From outside on to the middle, turned off the guide's present axis by this angle.
  [[nodiscard]] GuideGoal goal(double off_rad, double standoff_mm) const {
    const Vector3d side = ahead.unitOrthogonal();
    GuideGoal out;
    out.direction = (std::cos(off_rad) * ahead + std::sin(off_rad) * side).normalized();
    out.entry_mm = middle - radius * out.direction;
    out.standoff_mm = standoff_mm;
    return out;
  }
};

TEST(GuideMove, BringsTheGuideOntoTheLine) {
  const GuideScene scene;
  for (const double off_rad : {0.0, 0.3, 0.6}) {
    const GuideGoal goal = scene.goal(off_rad, 40.0);
    const GuideMove move = plan_guide_move(scene.collision(), scene.inverse, scanning(), scene.guide, goal);
    ASSERT_TRUE(move.found()) << off_rad << ": " << move.check.text;
    EXPECT_GE(move.check.nearest.distance_mm, 10.0);
    const robot::FlangePose &end = move.waypoints.back();
    EXPECT_LT((end * scene.guide.tip_mm - (goal.entry_mm - 40.0 * goal.direction)).norm(), 1e-9);
    EXPECT_LT((end.rotation() * scene.guide.axis - goal.direction).norm(), 1e-9);
    const robot::FlangePose reached = scene.arm.forward(move.check.end);
    EXPECT_LT((reached.translation() - end.translation()).norm(), 1e-6);
  }
}

TEST(GuideMove, GoesAroundWhatIsInTheWay) {
  const GuideScene scene;
  const GuideGoal goal = scene.goal(0.6, 40.0);
  ArmScene around;
  around.obstacles.push_back({"head", test::make_sphere(4, scene.radius, scene.middle)});
  // A ball on the straight line of the tip.
  const Vector3d from = scene.start * scene.guide.tip_mm;
  const Vector3d to = goal.entry_mm - goal.standoff_mm * goal.direction;
  around.obstacles.push_back({"lamp", test::make_sphere(3, 6.0, 0.5 * (from + to))});
  const ArmCollision collision(scene.arm, with_guide(), around);
  const robot::FlangePose straight = flange_at_goal(scene.start, scene.guide, goal, 0.0);
  EXPECT_EQ(check_path(collision, scene.inverse, scanning(), {&straight, 1}).verdict, PathVerdict::kTooClose);
  const GuideMove move = plan_guide_move(collision, scene.inverse, scanning(), scene.guide, goal);
  ASSERT_TRUE(move.found()) << move.check.text;
  EXPECT_GE(move.check.nearest.distance_mm, 10.0);
}

TEST(GuideMove, SaysWhyThereIsNoPath) {
  const GuideScene scene;
  // The goal is too near to the head.
  const GuideMove near =
      plan_guide_move(scene.collision(), scene.inverse, scanning(), scene.guide, scene.goal(0.0, 5.0));
  EXPECT_FALSE(near.found());
  EXPECT_NE(near.check.text.find("of head"), std::string::npos) << near.check.text;
  // From behind the head it would have to go through it, or is out of reach.
  const GuideMove behind =
      plan_guide_move(scene.collision(), scene.inverse, scanning(), scene.guide, scene.goal(std::numbers::pi, 40.0));
  EXPECT_FALSE(behind.found()) << behind.check.text;
  // The arm is where nothing helps.
  ArmScene tight;
  tight.obstacles.push_back({"wall", test::make_sphere(3, 20.0, scene.start * Vector3d(0.0, 30.0, 120.0))});
  const GuideMove stuck = plan_guide_move(ArmCollision(scene.arm, with_guide(), tight), scene.inverse, scanning(),
                                          scene.guide, scene.goal(0.0, 40.0));
  EXPECT_FALSE(stuck.found());
  EXPECT_EQ(stuck.check.at_mm, 0.0);
}

} // namespace
} // namespace bregma::planning
