#include <cmath>
#include <stdexcept>

#include <gtest/gtest.h>

#include "algorithms/planning/critical_structures.hpp"
#include "algorithms/surface/surface_model.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using geometry::Vector3d;
using planning::CriticalStructures;
using planning::NamedMesh;
constexpr unsigned kStructuresSeed = 20260203;

// An irregular body with unique distances and concave regions.
surface::TriangleMesh blob(const Vector3d &centre, double radius, std::mt19937 &rng) {
  auto mesh = test::make_sphere(4, radius, centre);
  const test::SmoothField lumps(rng, 0.6 * radius);
  for (Vector3d &v : mesh.vertices_mm) {
    v += 0.15 * lumps(v) * (v - centre);
  }
  return mesh;
}

std::vector<NamedMesh> structures(std::mt19937 &rng) {
  return {{"Precentral_L", blob({-40, 0, 50}, 18, rng)}, {"Precentral_R", blob({40, 0, 50}, 18, rng)},
          {"Occipital_L", blob({-26, -80, 5}, 20, rng)}, {"Occipital_R", blob({26, -80, 5}, 20, rng)},
          {"Heschl_L", blob({-45, -20, 8}, 9, rng)},     {"Heschl_R", blob({45, -20, 8}, 9, rng)}};
}

TEST(CriticalStructures, AgreeWithTheClosestPointOfEachSurfaceAlongAPath) {
  std::mt19937 rng(kStructuresSeed);
  const auto given = structures(rng);
  const CriticalStructures critical(given);
  std::vector<surface::SurfaceModel> surfaces;
  for (const NamedMesh &named : given) {
    surfaces.emplace_back(named.mesh);
  }
  CriticalStructures::Warm warm;
  for (int i = 0; i <= 2000; ++i) {
    // A path from above through several of them, with occasional jumps.
    const double s = i / 2000.0;
    Vector3d tip(60.0 * std::cos(9.0 * s), 60.0 * std::sin(5.0 * s) - 30.0, 80.0 - 90.0 * s);
    if (i % 97 == 0) {
      tip = test::normal_vector(rng, 60.0);
    }
    double expected = 1e9;
    std::string name;
    for (std::size_t k = 0; k < surfaces.size(); ++k) {
      const double d = std::max(surfaces[k].closest(tip).signed_mm, 0.0);
      if (d < expected) {
        expected = d;
        name = given[k].name;
      }
    }
    const auto nearest = critical.nearest(tip, warm);
    CriticalStructures::Warm fresh;
    const auto cold = critical.nearest(tip, fresh);
    ASSERT_NEAR(nearest.distance_mm, expected, 2e-5) << "step " << i << " seed " << kStructuresSeed;
    ASSERT_NEAR(cold.distance_mm, expected, 2e-5) << "step " << i;
    ASSERT_EQ(critical.name(nearest.index), name) << "step " << i;
    ASSERT_EQ(cold.index, nearest.index) << "step " << i;
    const auto [point, direction] = critical.surface_point(nearest.index, tip);
    ASSERT_NEAR(direction.norm(), 1.0, 1e-9) << "step " << i;
    if (expected > 1e-3) {
      ASSERT_LT((point + expected * direction - tip).norm(), 1e-6) << "step " << i;
    }
  }
}

TEST(CriticalStructures, InsideIsZero) {
  std::mt19937 rng(kStructuresSeed);
  const CriticalStructures critical(structures(rng));
  CriticalStructures::Warm warm;
  const auto nearest = critical.nearest({-45, -20, 8}, warm);
  EXPECT_EQ(critical.name(nearest.index), "Heschl_L");
  EXPECT_EQ(nearest.distance_mm, 0.0);
}

TEST(CriticalStructures, WithoutStructuresTheDistanceIsUnknown) {
  const CriticalStructures critical({});
  CriticalStructures::Warm warm;
  EXPECT_EQ(critical.nearest({0, 0, 0}, warm).index, -1);
  EXPECT_TRUE(std::isnan(critical.nearest({0, 0, 0}, warm).distance_mm));
}

TEST(CriticalStructures, QueriesDoNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  std::mt19937 rng(kStructuresSeed);
  const CriticalStructures critical(structures(rng));
  CriticalStructures::Warm warm;
  (void)critical.nearest({0, 0, 90}, warm); // FCL fills its table of functions at the first query
  const test::AllocationScope scope;
  for (int i = 0; i < 500; ++i) {
    const Vector3d tip(0.1 * i - 25.0, 10.0, 80.0 - 0.2 * i);
    (void)critical.surface_point(critical.nearest(tip, warm).index, tip);
  }
  EXPECT_EQ(scope.count(), 0U);
}

TEST(CriticalStructures, PathClearanceIsTheMinimumDistanceAlongTheLine) {
  std::mt19937 rng(kStructuresSeed);
  const auto given = structures(rng);
  const CriticalStructures critical(given);
  const Vector3d entry(5, 20, 90);
  const Vector3d target(20, -25, 10);
  const auto clearance = critical.path_clearance(entry, target);
  ASSERT_EQ(clearance.size(), given.size());
  for (std::size_t k = 1; k < clearance.size(); ++k) {
    EXPECT_LE(clearance[k - 1].distance_mm, clearance[k].distance_mm);
  }
  for (const NamedMesh &named : given) {
    const surface::SurfaceModel surface(named.mesh);
    double least = 1e9;
    for (int i = 0; i <= 20'000; ++i) {
      least = std::min(least, surface.closest(entry + i / 20'000.0 * (target - entry)).distance_mm);
    }
    const auto found =
        std::find_if(clearance.begin(), clearance.end(), [&](const auto &c) { return c.name == named.name; });
    ASSERT_NE(found, clearance.end());
    EXPECT_NEAR(found->distance_mm, least, 2e-3) << named.name;
    EXPECT_EQ(given[static_cast<std::size_t>(found->index)].name, named.name);
    const auto approach = critical.closest_approach(found->index, entry, target);
    const Vector3d on_line = entry + approach.fraction * (target - entry);
    EXPECT_NEAR((on_line - approach.surface.point_mm).norm(), least, 2e-3) << named.name;
  }
}

TEST(CriticalStructures, ALineThroughOneHasNoClearance) {
  std::mt19937 rng(kStructuresSeed);
  const CriticalStructures critical(structures(rng));
  const auto through = critical.path_clearance({40, 0, 100}, {40, 0, -20});
  EXPECT_EQ(through.front().name, "Precentral_R");
  EXPECT_EQ(through.front().distance_mm, 0.0);
  const auto deepest = critical.closest_approach(through.front().index, {40, 0, 100}, {40, 0, -20});
  EXPECT_GT(deepest.fraction, 0.0);
  EXPECT_LT(deepest.fraction, 1.0);
  EXPECT_NEAR(deepest.surface.direction.norm(), 1.0, 1e-9);
  const auto within = critical.path_clearance({40, 0, 52}, {40, 0, 48});
  EXPECT_EQ(within.front().name, "Precentral_R");
  EXPECT_EQ(within.front().distance_mm, 0.0);
}

TEST(CriticalStructures, ABadMeshIsNamed) {
  NamedMesh bad{"Heschl_L", test::make_sphere(1, 5.0, Vector3d::Zero())};
  bad.mesh.triangles.push_back({0, 1, 4711});
  try {
    const CriticalStructures critical({bad});
    FAIL() << "accepted";
  } catch (const std::invalid_argument &wrong) {
    EXPECT_STREQ(wrong.what(),
                 "critical structure Heschl_L: triangle 80 of the surface names vertex 4711, but there are 42");
  }
}

} // namespace
