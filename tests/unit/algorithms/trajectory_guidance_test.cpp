#include <cmath>

#include <gtest/gtest.h>

#include "algorithms/planning/trajectory_guidance.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using geometry::Vector3d;
using planning::guide;
using planning::PlannedLine;

const PlannedLine kLine{{10, 0, 80}, {10, 0, 20}}; // straight down, 60 mm

TEST(Guidance, FiguresBeforeAtAndBeyondTheTarget) {
  const Vector3d down = -Vector3d::UnitZ();
  auto g = guide(kLine, {10, 0, 50}, down);
  EXPECT_DOUBLE_EQ(g.distance_to_target_mm, 30.0);
  EXPECT_DOUBLE_EQ(g.remaining_depth_mm, 30.0);
  EXPECT_DOUBLE_EQ(g.lateral_deviation_mm, 0.0);
  EXPECT_DOUBLE_EQ(g.angle_rad, 0.0);
  g = guide(kLine, kLine.target_mm, down);
  EXPECT_DOUBLE_EQ(g.distance_to_target_mm, 0.0);
  g = guide(kLine, {10, 0, 17}, down);
  EXPECT_DOUBLE_EQ(g.remaining_depth_mm, -3.0);
  EXPECT_DOUBLE_EQ(g.distance_to_target_mm, 3.0);
}

TEST(Guidance, FiguresOffTheLineAndTilted) {
  const double tilt = 5.0 * M_PI / 180.0;
  const auto g = guide(kLine, {13, 4, 32}, {std::sin(tilt), 0.0, -std::cos(tilt)});
  EXPECT_DOUBLE_EQ(g.lateral_deviation_mm, 5.0);
  EXPECT_DOUBLE_EQ(g.remaining_depth_mm, 12.0);
  EXPECT_DOUBLE_EQ(g.distance_to_target_mm, 13.0);
  EXPECT_NEAR(g.angle_rad, tilt, 1e-12);
  EXPECT_NEAR(guide(kLine, {13, 4, 32}, Vector3d::UnitZ()).angle_rad, M_PI, 1e-12);
}

// A rigid motion of everything changes no figure, and small angles keep their precision.
TEST(Guidance, DoesNotDependOnTheCoordinates) {
  constexpr unsigned kSeed = 20260207;
  std::mt19937 rng(kSeed);
  for (int run = 0; run < 200; ++run) {
    const PlannedLine line{test::normal_vector(rng, 50.0), test::normal_vector(rng, 50.0)};
    const Vector3d tip = test::normal_vector(rng, 50.0);
    const Vector3d axis = test::normal_vector(rng, 1.0).normalized();
    const auto T = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
    const auto here = guide(line, tip, axis);
    const auto there = guide({T * line.entry_mm, T * line.target_mm}, T * tip, T.rotation() * axis);
    EXPECT_NEAR(here.distance_to_target_mm, there.distance_to_target_mm, 1e-9) << "seed " << kSeed;
    EXPECT_NEAR(here.lateral_deviation_mm, there.lateral_deviation_mm, 1e-9);
    EXPECT_NEAR(here.remaining_depth_mm, there.remaining_depth_mm, 1e-9);
    EXPECT_NEAR(here.angle_rad, there.angle_rad, 1e-9);
    EXPECT_NEAR(std::hypot(here.lateral_deviation_mm, here.remaining_depth_mm), here.distance_to_target_mm, 1e-9);
  }
  EXPECT_NEAR(guide(kLine, {10, 0, 50}, {1e-9, 0.0, -1.0}).angle_rad, 1e-9, 1e-15);
}

TEST(Guidance, ALineWithoutLengthHasNoFigures) {
  const auto g = guide({{1, 2, 3}, {1, 2, 3}}, {1, 2, 5}, Vector3d::UnitZ());
  EXPECT_DOUBLE_EQ(g.distance_to_target_mm, 2.0);
  EXPECT_TRUE(std::isnan(g.lateral_deviation_mm));
  EXPECT_TRUE(std::isnan(g.angle_rad));
  EXPECT_TRUE(std::isnan(g.remaining_depth_mm));
}

} // namespace
