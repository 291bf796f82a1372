// The falx in an egg of tissue.
#include "algorithms/tissue/contact/falx.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "algorithms/surface/surface_model.hpp"
#include "tests/unit/tissue/egg.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

TEST(SymmetryPlane, OfARotatedAndMovedEggIsItsMidplane) {
  surface::TriangleMesh egg = test::make_sphere(4, 1.0, Vector3d::Zero());
  const Eigen::Matrix3d turn =
      (Eigen::AngleAxisd(0.15, Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.1, Vector3d::UnitY())).toRotationMatrix();
  const Vector3d moved_mm(7.0, -20.0, 30.0);
  for (Vector3d &vertex : egg.vertices_mm) {
    // Blunt at the back, so that the only plane of symmetry is normal to z.
    vertex = turn * vertex.cwiseProduct(Vector3d(55.0, vertex.y() < 0.0 ? 60.0 : 80.0, 45.0)) + moved_mm;
  }
  const Plane plane = symmetry_plane(egg.vertices_mm, surface::SurfaceModel(egg), Vector3d::UnitX());
  EXPECT_NEAR(plane.normal().norm(), 1.0, 1e-12);
  EXPECT_LT(std::acos(std::min(plane.normal().dot(turn.col(0)), 1.0)), 0.003);
  EXPECT_NEAR(plane.signedDistance(moved_mm), 0.0, 0.05);
}

class EggWithFalx : public testing::Test {
protected:
  EggWithFalx()
      : mesh(test::make_egg(6000)), boundary(boundary_of(mesh)), surface({mesh.nodes_mm, boundary.triangles}),
        falx(mesh, boundary, surface), solver(mesh, Material{}) {
    for (int i = 0; i < solver.nodes(); ++i) {
      if (rest_mm(i).z() < -0.8 * test::kEggHalf_mm.z()) {
        solver.fix(i);
      }
    }
  }
  [[nodiscard]] const Vector3d &rest_mm(int node) const { return mesh.nodes_mm[static_cast<std::size_t>(node)]; }
  [[nodiscard]] double farthest_mm(const Vector3d &along, bool with_falx) {
    solver.reset();
    solver.set_contacts(with_falx ? std::vector<Contact *>{&falx} : std::vector<Contact *>{});
    for (int i = 0; i < solver.nodes(); ++i) {
      solver.set_force_N(i, 0.2 / solver.nodes() * along);
    }
    EXPECT_TRUE(solver.relax({1e-4, 20000, false}).converged);
    double farthest = 0.0;
    for (int i = 0; i < solver.nodes(); ++i) {
      farthest = std::max(farthest, solver.displacement_mm(i).norm());
    }
    return farthest;
  }

  TetMesh mesh;
  TetBoundary boundary;
  surface::SurfaceModel surface;
  Falx falx;
  ExplicitSolver solver;
};

TEST_F(EggWithFalx, IsInTheMidplaneNarrowInFrontAndWideBehind) {
  double front_mm = 0.0;
  double back_mm = 0.0;
  double lowest_mm = 0.0;
  for (const int node : falx.nodes()) {
    const Vector3d &at_mm = rest_mm(node);
    EXPECT_LT(std::abs(at_mm.x()), 2.0);
    double &deepest_mm = at_mm.y() > 0.0 ? front_mm : back_mm;
    deepest_mm = std::max(deepest_mm, surface.closest(at_mm).distance_mm);
    lowest_mm = std::min(lowest_mm, at_mm.z());
  }
  EXPECT_GT(front_mm, 20.0);
  EXPECT_LT(front_mm, 38.0); // midway between 25 and 50, at the vertex
  EXPECT_GT(back_mm, 30.0);  // no point of this egg is deeper than 36
  EXPECT_LT(lowest_mm, -5.0);
  EXPECT_GT(lowest_mm, -20.0);
}

TEST_F(EggWithFalx, ConstrainsTissueAcrossAndLetsItSlideAlong) {
  const double across_mm = farthest_mm(Vector3d::UnitX(), true);
  for (const int node : falx.nodes()) {
    EXPECT_LT(std::abs(falx.plane().normal().dot(solver.displacement_mm(node))), 1e-3);
  }
  EXPECT_LT(across_mm, 0.7 * farthest_mm(Vector3d::UnitX(), false));
  const double along_mm = farthest_mm(Vector3d::UnitY(), true);
  EXPECT_NEAR(along_mm, farthest_mm(Vector3d::UnitY(), false), 0.02 * along_mm);
}

} // namespace
} // namespace bregma::tissue
