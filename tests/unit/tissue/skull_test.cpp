// An egg of tissue in its skull.
#include "algorithms/tissue/contact/skull.hpp"

#include <stdexcept>

#include <gtest/gtest.h>

#include "algorithms/surface/surface_model.hpp"
#include "tests/unit/tissue/egg.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

const double kEggTop_mm = test::kEggHalf_mm.z();
// Nodes that slide between triangles of the skull leave about 0.002 of the forces unbalanced.
constexpr RelaxationOptions kStillEgg{5e-3, 20000, false};

class Shaken {
public:
  explicit Shaken(const SkullOptions &options)
      : mesh(test::make_egg(1500)), boundary(boundary_of(mesh)), surface({mesh.nodes_mm, boundary.triangles}),
        skull(mesh, boundary, options), solver(mesh, Material{}) {
    skull.apply_supports(solver);
    solver.set_contacts({&skull});
  }
  void pull_N(const Vector3d &force_N) {
    for (int i = 0; i < solver.nodes(); ++i) {
      solver.set_force_N(i, force_N / solver.nodes());
    }
  }
  // Largest distance of the surface outside the surface at rest, for nodes with wanted(rest).
  template <class Wanted> [[nodiscard]] double farthest_out_mm(Wanted &&wanted) const {
    double out = -1e9;
    for (const int node : boundary.nodes) {
      const Vector3d &rest_mm = mesh.nodes_mm[static_cast<std::size_t>(node)];
      if (wanted(rest_mm)) {
        out = std::max(out, surface.closest(rest_mm + solver.displacement_mm(node)).signed_mm);
      }
    }
    return out;
  }

  TetMesh mesh;
  TetBoundary boundary;
  surface::SurfaceModel surface;
  Skull skull;
  ExplicitSolver solver;
};

constexpr auto kAllOfTheEgg = [](const Vector3d &) { return true; };

TEST(Skull, NoNodePassesThroughIt) {
  for (const double gap_mm : {0.0, 2.0}) {
    Shaken egg({.sliding = true, .gap_mm = gap_mm, .craniotomy = {}});
    egg.pull_N({2.0, -1.0, 0.5});
    double out_mm = 0.0;
    for (int i = 0; i < 300; ++i) { // also during vibration
      egg.solver.advance(5);
      out_mm = std::max(out_mm, egg.farthest_out_mm(kAllOfTheEgg));
    }
    EXPECT_LT(out_mm, gap_mm + 0.5) << gap_mm; // the planes are offset from the skull's triangles
    EXPECT_GT(out_mm, gap_mm - 0.3) << gap_mm; // it was reached
    EXPECT_TRUE(egg.solver.finite());
  }
}

TEST(Skull, SupportsTheBrainPressedAgainstIt) {
  Shaken egg({.sliding = true, .gap_mm = 1.0, .craniotomy = {}});
  egg.pull_N({0.0, 0.0, -0.5});
  ASSERT_TRUE(egg.solver.relax(kStillEgg).converged);
  EXPECT_LT((egg.skull.force_N() - Vector3d(0.0, 0.0, 0.5)).norm(), 0.02);
}

TEST(Skull, TheBrainSeparatesFromTheFarSideAndSlidesAlongTheNearSide) {
  Shaken egg({.sliding = true, .gap_mm = 2.0, .craniotomy = {}});
  egg.pull_N({0.0, 0.0, -0.5});
  ASSERT_TRUE(egg.solver.relax(kStillEgg).converged);
  EXPECT_LT(egg.farthest_out_mm([](const Vector3d &rest) { return rest.z() > kEggTop_mm - 5.0; }), -1.5);
  EXPECT_GT(egg.farthest_out_mm([](const Vector3d &rest) { return rest.z() < 5.0 - kEggTop_mm; }), 1.7);
  double slid_mm = 0.0;
  for (const int node : egg.boundary.nodes) {
    const Vector3d out = egg.surface.closest(egg.mesh.nodes_mm[static_cast<std::size_t>(node)]).normal;
    const Vector3d moved = egg.solver.displacement_mm(node);
    slid_mm = std::max(slid_mm, (moved - moved.dot(out) * out).norm());
  }
  EXPECT_GT(slid_mm, 1.0);
}

TEST(Skull, WithoutSlidingTheSurfaceIsFixedExceptInTheCraniotomy) {
  const SkullOptions options{.sliding = false, .gap_mm = 0.0, .craniotomy = {{0.0, 0.0, kEggTop_mm}, 25.0}};
  Shaken egg(options);
  egg.pull_N({0.0, 0.0, 0.5});
  egg.solver.advance(500);
  double open_mm = 0.0;
  for (const int node : egg.boundary.nodes) {
    const double moved_mm = egg.solver.displacement_mm(node).norm();
    if (egg.skull.open_at(egg.mesh.nodes_mm[static_cast<std::size_t>(node)])) {
      open_mm = std::max(open_mm, moved_mm);
    } else {
      EXPECT_EQ(moved_mm, 0.0);
    }
  }
  EXPECT_GT(open_mm, 0.2);
}

TEST(Skull, TheBrainBulgesThroughTheCraniotomyOnly) {
  Shaken egg({.sliding = true, .gap_mm = 0.0, .craniotomy = {{0.0, 0.0, kEggTop_mm}, 25.0}});
  egg.pull_N({0.0, 0.0, 1.0});
  ASSERT_TRUE(egg.solver.relax(kStillEgg).converged);
  EXPECT_GT(egg.farthest_out_mm([&](const Vector3d &rest) { return egg.skull.open_at(rest); }), 1.0);
  EXPECT_LT(egg.farthest_out_mm([](const Vector3d &rest) { return rest.z() < 0.0; }), 0.5);
}

TEST(SkullRefusals, AreReportedWithTheReason) {
  const auto refusal = [](const SkullOptions &options) -> std::string {
    try {
      const Shaken egg(options);
    } catch (const std::invalid_argument &error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal({.sliding = true, .gap_mm = -0.5, .craniotomy = {}}),
            "skull: gap_mm = -0.500000, must not be negative");
  EXPECT_EQ(refusal({.sliding = true, .gap_mm = 0.0, .craniotomy = {Vector3d::Zero(), -3.0}}),
            "craniotomy: radius_mm = -3.000000, must not be negative");
}

} // namespace
} // namespace bregma::tissue
