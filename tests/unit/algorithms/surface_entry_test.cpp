#include "algorithms/planning/surface_entry.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::planning {
namespace {

using Eigen::Vector3d;

const Vector3d kCentre_mm{5.0, -12.0, 30.0};
constexpr double kRadius_mm = 70.0;

const surface::TriangleMesh &facets() {
  static const surface::TriangleMesh mesh = tests::sphere(kCentre_mm, kRadius_mm, 5);
  return mesh;
}

const surface::SurfaceModel &ball() {
  static const surface::SurfaceModel model(facets());
  return model;
}

// Radius of the ball inside all facets.
double inner_radius_mm() {
  double least = kRadius_mm;
  for (const Eigen::Vector3i &t : facets().triangles) {
    const auto vertex = [&](int i) -> const Vector3d & { return facets().vertices_mm[static_cast<std::size_t>(t[i])]; };
    const Vector3d normal = (vertex(1) - vertex(0)).cross(vertex(2) - vertex(0)).normalized();
    least = std::min(least, normal.dot(vertex(0) - kCentre_mm));
  }
  return least;
}

// Distance along a line from `from` to a ball: the smaller t of |from + t along - centre| = radius.
double way_to_ball_mm(const Vector3d &from, const Vector3d &along, double radius_mm) {
  const double b = along.dot(from - kCentre_mm);
  return -b - std::sqrt(b * b - (from - kCentre_mm).squaredNorm() + radius_mm * radius_mm);
}

TEST(SurfaceEntry, IsTheIntersectionWithABall) {
  const double inner_mm = inner_radius_mm();
  ASSERT_GT(inner_mm, kRadius_mm - 0.1);
  std::mt19937 rng(11);
  std::normal_distribution<double> normal;
  const auto direction = [&] { return Vector3d(normal(rng), normal(rng), normal(rng)).normalized(); };
  int grazing = 0;
  for (int i = 0; i < 500; ++i) {
    const Vector3d from = kCentre_mm + (kRadius_mm + 5.0 + 40.0 * std::abs(normal(rng))) * direction();
    const Vector3d to = kCentre_mm + 0.9 * kRadius_mm * direction();
    const Vector3d along = (to - from).normalized();
    const auto entry = surface_entry(ball(), from, to);
    ASSERT_TRUE(entry);
    // The facets lie between the two balls, and so does the entry.
    const double gone_mm = along.dot(*entry - from);
    EXPECT_LT((*entry - from - gone_mm * along).norm(), 1e-9) << "on the way";
    const double first_mm = way_to_ball_mm(from, along, kRadius_mm);
    EXPECT_GE(gone_mm, first_mm);
    EXPECT_LE(gone_mm, way_to_ball_mm(from, along, inner_mm) + 1e-3);
    const double inside_mm = ball().closest(*entry).signed_mm;
    EXPECT_LE(inside_mm, 0.0);
    EXPECT_GE(inside_mm, -1e-3);
    grazing += -along.dot((from + first_mm * along - kCentre_mm) / kRadius_mm) < 0.5 ? 1 : 0;
  }
  EXPECT_GT(grazing, 10) << "the ways are all steep";
}

TEST(SurfaceEntry, IsTheStartOfALineThatStartsInside) {
  EXPECT_EQ(surface_entry(ball(), kCentre_mm, kCentre_mm + Vector3d(200.0, 0.0, 0.0)), kCentre_mm);
  EXPECT_EQ(surface_entry(ball(), kCentre_mm, kCentre_mm), kCentre_mm);
}

TEST(SurfaceEntry, AbsentForALineThatStaysOutside) {
  const Vector3d above = kCentre_mm + Vector3d(0.0, 0.0, kRadius_mm + 0.5);
  EXPECT_EQ(surface_entry(ball(), above - Vector3d(90.0, 0.0, 0.0), above + Vector3d(90.0, 0.0, 0.0)), std::nullopt)
      << "passes by";
  EXPECT_EQ(surface_entry(ball(), above + Vector3d(0.0, 0.0, 40.0), above), std::nullopt) << "ends before";
  EXPECT_EQ(surface_entry(ball(), above, above), std::nullopt) << "has no length";
}

TEST(SurfaceEntry, TheEntryDoesNotDependOnTheTarget) {
  const Vector3d away(0.0, 0.0, kRadius_mm + 30.0);
  const auto entry = surface_entry(ball(), kCentre_mm + away, kCentre_mm - away);
  ASSERT_TRUE(entry);
  EXPECT_LT((*entry - kCentre_mm - Vector3d(0.0, 0.0, kRadius_mm)).norm(), 5e-3);
}

} // namespace
} // namespace bregma::planning
