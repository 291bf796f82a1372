// Sections of surfaces and their triangle meshes.
#include "algorithms/tissue_plane/plane_mesher.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <stdexcept>

#include <gtest/gtest.h>

namespace bregma::tissue_plane {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// A torus around z, its tube's centre on a circle of this radius.
surface::TriangleMesh torus(double radius_mm, double tube_mm, int steps) {
  surface::TriangleMesh out;
  for (int i = 0; i < steps; ++i) {
    for (int j = 0; j < steps; ++j) {
      const double around = 2.0 * std::numbers::pi * i / steps;
      const double about = 2.0 * std::numbers::pi * (j + 0.5) / steps;
      const double r = radius_mm + tube_mm * std::cos(about);
      out.vertices_mm.emplace_back(r * std::cos(around), r * std::sin(around), tube_mm * std::sin(about));
      const auto at = [&](int a, int b) { return (a % steps) * steps + b % steps; };
      out.triangles.emplace_back(at(i, j), at(i + 1, j), at(i + 1, j + 1));
      out.triangles.emplace_back(at(i, j), at(i + 1, j + 1), at(i, j + 1));
    }
  }
  return out;
}

// A wavy circle, counter-clockwise.
Loop wavy(double radius_mm, double wave_mm, int waves) {
  constexpr int kPoints = 720;
  Loop out;
  for (int i = 0; i < kPoints; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / kPoints;
    const double r = radius_mm + wave_mm * std::sin(waves * angle);
    out.emplace_back(r * std::cos(angle), r * std::sin(angle));
  }
  return out;
}

double distance_mm(const Loop &loop, const Vector2d &p) {
  double best = INFINITY;
  for (std::size_t i = 0, j = loop.size() - 1; i < loop.size(); j = i++) {
    const Vector2d along = loop[i] - loop[j];
    const double t = std::clamp((p - loop[j]).dot(along) / along.squaredNorm(), 0.0, 1.0);
    best = std::min(best, (p - loop[j] - t * along).norm());
  }
  return best;
}

template <class Action> std::string message(const Action &action) {
  try {
    action();
  } catch (const std::invalid_argument &error) {
    return error.what();
  }
  return {};
}

TEST(PlaneSection, ATorusIsCutIntoARing) {
  const std::vector<Loop> loops = section_of(torus(50.0, 20.0, 120), {});
  ASSERT_EQ(loops.size(), 2U);
  const Outline ring = largest_outline(loops);
  ASSERT_EQ(ring.holes.size(), 1U);
  EXPECT_NEAR(area_mm2(ring.outer), std::numbers::pi * 70.0 * 70.0, 0.003 * 15394.0);
  EXPECT_NEAR(area_mm2(ring.holes[0]), -std::numbers::pi * 30.0 * 30.0, 0.003 * 2827.0);
  EXPECT_TRUE(contains(ring, {50.0, 0.0}));
  EXPECT_FALSE(contains(ring, {0.0, 10.0}));
  EXPECT_FALSE(contains(ring, {0.0, 71.0}));
}

TEST(PlaneSection, APlaneAcrossGivesTwoDiscsInItsOwnAxes) {
  const SectionPlane across{{0.0, 0.0, 5.0}, Vector3d::UnitY(), Vector3d::UnitZ()};
  const std::vector<Loop> loops = section_of(torus(50.0, 20.0, 120), across);
  ASSERT_EQ(loops.size(), 2U);
  for (const Loop &loop : loops) {
    EXPECT_NEAR(area_mm2(loop), std::numbers::pi * 400.0, 0.004 * 1257.0);
    EXPECT_TRUE(contains(loop, {loop.front().x() > 0.0 ? 50.0 : -50.0, -5.0}));
  }
  EXPECT_TRUE(largest_outline(loops).holes.empty());
}

TEST(PlaneSection, AVertexInThePlaneBranchesNothing) {
  // An octahedron cut through four of its vertices.
  surface::TriangleMesh octahedron;
  octahedron.vertices_mm = {{10, 0, 0}, {0, 10, 0}, {-10, 0, 0}, {0, -10, 0}, {0, 0, 10}, {0, 0, -10}};
  for (int i = 0; i < 4; ++i) {
    octahedron.triangles.emplace_back(i, (i + 1) % 4, 4);
    octahedron.triangles.emplace_back((i + 1) % 4, i, 5);
  }
  const std::vector<Loop> loops = section_of(octahedron, {});
  ASSERT_EQ(loops.size(), 1U);
  EXPECT_NEAR(area_mm2(loops[0]), 200.0, 1e-9);
  EXPECT_TRUE(section_of(octahedron, {{0, 0, 11}}).empty());
}

TEST(PlaneSection, ErrorsAreReported) {
  surface::TriangleMesh open = torus(50.0, 20.0, 12);
  open.triangles.resize(open.triangles.size() - 24);
  EXPECT_EQ(message([&] { (void)section_of(open, {}); }), "section_of: the surface is open where the plane cuts it");
  Loop backwards = wavy(10.0, 0.0, 0);
  std::reverse(backwards.begin(), backwards.end());
  EXPECT_EQ(message([&] { (void)largest_outline({backwards}); }),
            "largest_outline: none of 1 loops is counter-clockwise");
}

struct Shape {
  const char *name;
  Outline outline;
};

class PlaneMesher : public testing::TestWithParam<Shape> {};

TEST_P(PlaneMesher, FillsTheOutlineWithGoodTriangles) {
  const Outline &outline = GetParam().outline;
  for (const std::optional<double> cut_y : {std::optional<double>(), std::optional<double>(3.7)}) {
    const PlaneMesh mesh = fill(outline, {.triangles = 5000, .cut_y_mm = cut_y});
    EXPECT_NO_THROW(check(mesh));
    EXPECT_NEAR(static_cast<double>(mesh.triangles.size()), 5000.0, 250.0);
    EXPECT_NEAR(area_mm2(mesh), area_mm2(outline), 0.003 * area_mm2(outline));
    const PlaneQuality quality = quality_of(mesh);
    EXPECT_GT(quality.min_angle_deg, 20.0);
    EXPECT_LT(quality.max_angle_deg, 130.0);
    EXPECT_GT(quality.mean_min_angle_deg, 52.0);

    std::map<int, int> edges_of_node;
    for (const Eigen::Vector2i &edge : boundary_of(mesh)) {
      const Vector2d &p = mesh.nodes_mm[static_cast<std::size_t>(edge[0])];
      double off = distance_mm(outline.outer, p);
      for (const Loop &hole : outline.holes) {
        off = std::min(off, distance_mm(hole, p));
      }
      EXPECT_LT(off, 1e-6);
      ++edges_of_node[edge[0]];
    }
    for (const auto &[node, count] : edges_of_node) {
      EXPECT_EQ(count, 1) << "two fans meet in node " << node;
    }
  }
}

TEST_P(PlaneMesher, EdgesRunAlongTheLineToBeCut) {
  const Outline &outline = GetParam().outline;
  constexpr double kCut_mm = -4.1;
  const PlaneMesh mesh = fill(outline, {.edge_mm = 2.5, .cut_y_mm = kCut_mm});
  const auto on_line = [&](int n) { return std::abs(mesh.nodes_mm[static_cast<std::size_t>(n)].y() - kCut_mm) < 1e-6; };
  double length = 0.0; // total length of the edges on the line, each counted for both of its triangles
  for (const Eigen::Vector3i &t : mesh.triangles) {
    int above = 0;
    int below = 0;
    for (int k = 0; k < 3; ++k) {
      const Vector2d &a = mesh.nodes_mm[static_cast<std::size_t>(t[k])];
      const Vector2d &b = mesh.nodes_mm[static_cast<std::size_t>(t[(k + 1) % 3])];
      above += !on_line(t[k]) && a.y() > kCut_mm ? 1 : 0;
      below += !on_line(t[k]) && a.y() < kCut_mm ? 1 : 0;
      length += on_line(t[k]) && on_line(t[(k + 1) % 3]) ? 0.5 * (a - b).norm() : 0.0;
    }
    EXPECT_FALSE(above > 0 && below > 0) << "a triangle lies across the line";
  }
  double chord = 0.0;
  constexpr double kPitch_mm = 0.01;
  for (double x = -100.0; x < 100.0; x += kPitch_mm) {
    chord += contains(outline, {x, kCut_mm}) ? kPitch_mm : 0.0;
  }
  EXPECT_NEAR(length, chord, 0.1);
}

Loop turned(Loop loop) {
  std::reverse(loop.begin(), loop.end());
  return loop;
}

INSTANTIATE_TEST_SUITE_P(Shapes, PlaneMesher,
                         testing::Values(Shape{"disc", {wavy(60.0, 0.0, 0), {}}},
                                         Shape{"gyri", {wavy(60.0, 4.0, 9), {}}},
                                         Shape{"ring", {wavy(60.0, 2.0, 5), {turned(wavy(25.0, 2.0, 3))}}}),
                         [](const auto &param) { return param.param.name; });

TEST(PlaneMesher, DetailsFinerThanAnEdgeStillGiveAValidMesh) {
  const PlaneMesh mesh = fill({wavy(60.0, 6.0, 60), {}}, {.edge_mm = 4.0});
  EXPECT_NO_THROW(check(mesh));
}

TEST(PlaneMesher, ErrorsAreReported) {
  const Outline disc{wavy(60.0, 0.0, 0), {}};
  EXPECT_EQ(message([&] {
              (void)fill({{{0, 0}, {1, 0}}, {}});
            }),
            "fill: the outline has 2 points, must have at least 3");
  EXPECT_EQ(message([&] {
              (void)fill({turned(wavy(1.0, 0.0, 0)), {}});
            }).substr(0, 35),
            "fill: the outline encloses -3.14155");
  EXPECT_EQ(message([&] { (void)fill(disc, {.edge_mm = -1.0}); }), "fill: edge_mm = -1.000000, must not be negative");
  EXPECT_EQ(message([&] { (void)fill(disc, {.triangles = 3}); }), "fill: triangles = 3, must be at least 10");
  PlaneMesh mesh = rectangle_mesh({1, 1}, {1.0, 1.0});
  std::swap(mesh.triangles[1][0], mesh.triangles[1][1]);
  EXPECT_EQ(message([&] { check(mesh); }), "triangle 1 has an area of -0.500000 mm^2, must be positive");
  mesh = rectangle_mesh({1, 1}, {1.0, 1.0});
  mesh.nodes_mm.emplace_back(5.0, 5.0);
  EXPECT_EQ(message([&] { check(mesh); }), "node 4 belongs to no triangle");
}

TEST(PlaneQuality, IsThatOfAHalvedSquare) {
  const PlaneQuality quality = quality_of(rectangle_mesh({2, 2}, {2.0, 2.0}));
  EXPECT_NEAR(quality.min_angle_deg, 45.0, 1e-9);
  EXPECT_NEAR(quality.max_angle_deg, 90.0, 1e-9);
  EXPECT_NEAR(quality.smallest_height_mm, std::sqrt(0.5), 1e-12);
  // sqrt(0.5) mm at sqrt(7965.5 Pa / 1000 kg/m^3) = 2.822 m/s
  EXPECT_NEAR(stable_step_s(quality, tissue::Material{}), 250.5e-6, 0.5e-6);
}

} // namespace
} // namespace bregma::tissue_plane
