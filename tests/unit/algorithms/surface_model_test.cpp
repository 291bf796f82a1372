#include <array>
#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "algorithms/surface/surface_model.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using geometry::Vector3d;
using surface::SurfaceModel;
constexpr unsigned kSurfaceSeed = 20260206;

// Brute-force distance to a triangle: to its plane if the projection is inside, otherwise to the nearest edge.
double triangle_distance(const Vector3d &a, const Vector3d &b, const Vector3d &c, const Vector3d &p) {
  const Vector3d n = (b - a).cross(c - a);
  const bool inside =
      n.dot((b - a).cross(p - a)) >= 0 && n.dot((c - b).cross(p - b)) >= 0 && n.dot((a - c).cross(p - c)) >= 0;
  double least = inside ? std::abs(n.normalized().dot(p - a)) : 1e9;
  for (const auto &[u, v] : {std::pair(a, b), std::pair(b, c), std::pair(c, a)}) {
    const double s = std::clamp((p - u).dot(v - u) / (v - u).squaredNorm(), 0.0, 1.0);
    least = std::min(least, (p - u - s * (v - u)).norm());
  }
  return least;
}

TEST(SurfaceModel, ClosestPointMatchesASearchOverAllTriangles) {
  std::mt19937 rng(kSurfaceSeed);
  const auto mesh = test::make_head(3);
  const SurfaceModel surface(mesh);
  EXPECT_TRUE(surface.is_closed());
  EXPECT_EQ(surface.triangle_count(), mesh.triangles.size());
  int last = -1;
  for (int run = 0; run < 500; ++run) {
    const Vector3d p = test::kHeadCentre + test::normal_vector(rng, run % 3 == 0 ? 20.0 : 90.0);
    double least = 1e9;
    for (const auto &t : mesh.triangles) {
      const auto at = [&](int k) { return mesh.vertices_mm[static_cast<std::size_t>(t[k])]; };
      least = std::min(least, triangle_distance(at(0), at(1), at(2), p));
    }
    const auto cold = surface.closest(p);
    ASSERT_NEAR(cold.distance_mm, least, 1e-9) << "run " << run << " seed " << kSurfaceSeed;
    ASSERT_NEAR((cold.point_mm - p).norm(), least, 1e-9);
    ASSERT_NEAR(cold.normal.norm(), 1.0, 1e-12);
    // Any warm start gives the same result.
    const auto warm = surface.closest(p, last);
    ASSERT_EQ(warm.distance_mm, cold.distance_mm);
    last = warm.triangle;
    const auto &t = mesh.triangles[static_cast<std::size_t>(cold.triangle)];
    const auto at = [&](int k) { return mesh.vertices_mm[static_cast<std::size_t>(t[k])]; };
    ASSERT_NEAR(triangle_distance(at(0), at(1), at(2), p), least, 1e-9);
  }
}

TEST(SurfaceModel, SeparatesInsideFromOutsideAtVerticesEdgesAndFaces) {
  std::mt19937 rng(kSurfaceSeed);
  const auto mesh = test::make_head(3);
  const SurfaceModel surface(mesh);
  // The head is star-shaped about its centre, so points nearer to it than the skin are inside. Along the normal of a
  // vertex or of an edge's midpoint the closest feature is that vertex or edge.
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); i += 3) {
    const Vector3d v = mesh.vertices_mm[i];
    EXPECT_GT(surface.closest(test::kHeadCentre + 1.01 * (v - test::kHeadCentre)).signed_mm, 0.0);
    EXPECT_LT(surface.closest(test::kHeadCentre + 0.99 * (v - test::kHeadCentre)).signed_mm, 0.0);
  }
  for (const auto &t : mesh.triangles) {
    const Vector3d a = mesh.vertices_mm[static_cast<std::size_t>(t[0])];
    const Vector3d b = mesh.vertices_mm[static_cast<std::size_t>(t[1])];
    const Vector3d middle = 0.5 * (a + b) - test::kHeadCentre;
    EXPECT_GT(surface.closest(test::kHeadCentre + 1.002 * middle).signed_mm, 0.0);
    EXPECT_LT(surface.closest(test::kHeadCentre + 0.998 * middle).signed_mm, 0.0);
  }
}

TEST(SurfaceModel, SegmentsHitTrianglesBetweenTheirEnds) {
  std::mt19937 rng(kSurfaceSeed);
  const SurfaceModel sphere(test::make_sphere(4, 50.0, {10.0, 20.0, 30.0}));
  int hits = 0;
  for (int run = 0; run < 4000; ++run) {
    const Vector3d a = Vector3d(10, 20, 30) + test::normal_vector(rng, 60.0);
    const Vector3d b = Vector3d(10, 20, 30) + test::normal_vector(rng, 60.0);
    const Vector3d from = a - Vector3d(10, 20, 30);
    const Vector3d along = b - a;
    const double s = std::clamp(-from.dot(along) / along.squaredNorm(), 0.0, 1.0);
    const double nearest = (from + s * along).norm();
    const double farthest = std::max(from.norm(), (from + along).norm());
    // The mesh lies within 0.3 mm of the sphere, so that shell is excluded.
    if (std::abs(nearest - 50.0) < 0.3 || std::abs(farthest - 50.0) < 0.3) {
      continue;
    }
    const bool expected = nearest < 50.0 && farthest > 50.0;
    hits += expected ? 1 : 0;
    ASSERT_EQ(sphere.segment_hits(a, b), expected) << "run " << run << " seed " << kSurfaceSeed;
    ASSERT_EQ(sphere.segment_hits(b, a), expected);
  }
  EXPECT_GT(hits, 500);
}

TEST(SurfaceModel, SegmentsAlongTheAxesAreNotLost) {
  surface::TriangleMesh square; // flat: its bounding boxes have zero thickness
  square.vertices_mm = {{0, 0, 5}, {10, 0, 5}, {10, 10, 5}, {0, 10, 5}};
  square.triangles = {{0, 1, 2}, {0, 2, 3}};
  const SurfaceModel surface(square);
  EXPECT_FALSE(surface.is_closed());
  EXPECT_TRUE(surface.segment_hits({2, 7, 0}, {2, 7, 9}));
  EXPECT_TRUE(surface.segment_hits({5, 5, 0}, {5, 5, 9})); // through the diagonal
  EXPECT_TRUE(surface.segment_hits({0, 3, 0}, {0, 3, 9})); // through the border
  EXPECT_FALSE(surface.segment_hits({2, 7, 6}, {2, 7, 9}));
  EXPECT_FALSE(surface.segment_hits({12, 7, 0}, {12, 7, 9}));
  EXPECT_FALSE(surface.segment_hits({-5, 5, 4}, {15, 5, 4}));
}

TEST(SurfaceModel, QueriesDoNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  const SurfaceModel surface(test::make_head(3));
  const test::AllocationScope scope;
  double sum = 0.0;
  for (int i = 0; i < 1000; ++i) {
    sum += surface.closest({0.1 * i, 20.0, 40.0}).signed_mm;
    sum += surface.segment_hits({0.1 * i, 20.0, 40.0}, {300.0, 0.0, 0.0}) ? 1.0 : 0.0;
  }
  EXPECT_TRUE(std::isfinite(sum));
  EXPECT_EQ(scope.count(), 0U);
}

void expect_refused(const surface::TriangleMesh &mesh, const char *message) {
  try {
    const SurfaceModel surface(mesh);
    FAIL() << "accepted";
  } catch (const std::invalid_argument &wrong) {
    EXPECT_STREQ(wrong.what(), message);
  }
}

TEST(SurfaceModel, ErrorsOfAMeshAreReported) {
  surface::TriangleMesh mesh;
  expect_refused(mesh, "the surface has no triangles");
  mesh.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 1, 3}};
  expect_refused(mesh, "triangle 1 of the surface names vertex 3, but there are 3");
  mesh.triangles = {{0, 1, -1}};
  expect_refused(mesh, "triangle 0 of the surface names vertex -1, but there are 3");
  mesh.triangles = {{0, 1, 1}};
  expect_refused(mesh, "the triangles of the surface have no area");
  mesh.triangles = {{0, 1, 2}};
  mesh.vertices_mm[1].y() = std::nan("");
  expect_refused(mesh, "vertex 1 of the surface is not finite");
}

// Corners that coincide, as at the poles of a surface of quads, and corners on a line.
TEST(SurfaceModel, ATriangleWithoutAreaIsItsLongestEdge) {
  const Vector3d a(0, 0, 0), b(10, 0, 0), middle(4, 0, 0), p(3, 7, 2);
  for (const std::array<Vector3d, 3> &corners : {std::array{a, a, b}, std::array{a, b, a}, std::array{a, b, b},
                                                 std::array{a, middle, b}, std::array{b, a, middle}}) {
    surface::TriangleMesh mesh;
    mesh.vertices_mm.assign(corners.begin(), corners.end());
    mesh.vertices_mm.emplace_back(0, 0, 50);
    mesh.triangles = {{0, 1, 2}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
    const SurfaceModel surface(mesh);
    EXPECT_LT((surface.closest_on(0, p).point_mm - Vector3d(3, 0, 0)).norm(), 1e-9);
    EXPECT_LT((surface.closest_on(0, Vector3d(-5, 1, 1)).point_mm - a).norm(), 1e-9);
  }
}

TEST(SurfaceModel, APointThatIsNotFiniteIsInfinitelyFar) {
  const SurfaceModel surface(test::make_sphere(2, 50.0, Vector3d::Zero()));
  EXPECT_TRUE(std::isinf(surface.closest({std::nan(""), 0, 0}).distance_mm));
}

} // namespace
