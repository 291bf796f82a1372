// Contact between a probe and a block of tissue: on the surface, and along a cut.
#include "algorithms/tissue/contact/probe_contact.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "algorithms/tissue/material/units.hpp"
#include "tests/support/tissue_hertz.hpp"
#include "tests/support/tissue_meshes.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

// 12.5 % on this mesh; bench_tissue --only hertz shows 5 % on finer ones.
TEST(SurfaceContactHertz, ASphereOnAHalfSpaceMatchesHertz) {
  for (const double poisson : {0.3, 0.45}) {
    const test::HertzAnswer answer =
        test::hertz(20.0, 0.5, poisson, {.cell_mm = 0.8, .even_cells = 8, .growing_cells = 7, .growth = 1.6}, 2000);
    EXPECT_LT(answer.unsettled, 0.01) << poisson;
    EXPECT_LT(answer.contact_N.error(), 0.125) << answer.contact_N.value << " N, not " << answer.contact_N.reference;
    EXPECT_NEAR(answer.support_N.value, answer.contact_N.value,
                0.03 * answer.contact_N.value); // transmitted to the bottom
  }
}

// A block of 40 x 40 x 20 mm, fixed at the bottom.
class HeldBlock {
public:
  HeldBlock()
      : mesh(block_mesh({8, 8, 4}, {40.0, 40.0, 20.0})), boundary(boundary_of(mesh)), locator(mesh),
        solver(mesh, test::brain(Law::kNeoHookean, 0.45), {.damping_per_s = 60.0}) {
    for (const int node : test::nodes_at(mesh, 2, 0.0)) {
      solver.fix(node);
    }
  }
  [[nodiscard]] float step_s() const { return static_cast<float>(solver.step_s()); }

  TetMesh mesh;
  TetBoundary boundary;
  TetLocator locator;
  ExplicitSolver solver;
};

// ---- friction ----

// A sphere with a nearly flat pole rests on the block and is then moved sideways.
class Rubbed : public HeldBlock {
public:
  explicit Rubbed(double friction)
      : contact_(mesh, boundary, {.friction = friction, .spacing_mm = 2.0, .reach_mm = 50.0, .capacity = 20'000}) {
    solver.set_contacts({&contact_});
    contact_.set_active(true);
    probe_.radius_m = 0.4F;
    probe_.tip_m = to_metres({20.0, 20.0, 20.0});
    contact_.place(probe_);
    contact_.search(solver);
    move({0.0, 0.0, -5e-3F}, 0.2); // 1 mm
    move(Vector3f::Zero(), 0.3);
  }

  void move(const Vector3f &velocity_m_s, double time_s) {
    probe_.tip_velocity_m_s = velocity_m_s;
    const int steps = static_cast<int>(time_s / solver.step_s());
    const int settling = steps / 2;
    mean_N_.setZero();
    for (int i = 0; i < steps; ++i) {
      probe_.tip_m += step_s() * velocity_m_s;
      contact_.place(probe_);
      solver.advance(1);
      if (i >= settling) {
        mean_N_ += contact_.force_N() / static_cast<float>(steps - settling);
      }
    }
  }
  // Mean force on the tissue over the second half of the last move, because the impulses fluctuate.
  [[nodiscard]] const Vector3f &mean_N() const { return mean_N_; }

private:
  SurfaceContact contact_;
  PlacedProbe probe_;
  Vector3f mean_N_ = Vector3f::Zero();
};

TEST(SurfaceContactFriction, WithoutFrictionThereIsNoTangentialForce) {
  Rubbed block(0.0);
  EXPECT_LT(block.mean_N().z(), -0.05F);
  block.move({10e-3F, 0.0, 0.0}, 0.2);
  EXPECT_LT(std::abs(block.mean_N().x()), 0.02F * std::abs(block.mean_N().z()));
}

TEST(SurfaceContactFriction, SlidingFrictionIsProportionalToThePressure) {
  for (const double friction : {0.1, 0.3}) {
    Rubbed block(friction);
    block.move({40e-3F, 0.0, 0.0}, 0.3); // 12 mm: far more than the shear at which it slips
    const auto ratio = static_cast<double>(block.mean_N().x() / -block.mean_N().z());
    EXPECT_NEAR(ratio, friction, 0.2 * friction) << friction;
  }
}

TEST(SurfaceContactFriction, ASmallTangentialLoadSticks) {
  Rubbed block(0.8);
  block.move({2e-3F, 0.0, 0.0}, 0.1); // 0.2 mm
  const float ratio = block.mean_N().x() / -block.mean_N().z();
  EXPECT_GT(ratio, 0.02F);
  EXPECT_LT(ratio, 0.7F);
}

TEST(SurfaceContactFriction, AnInactiveContactHasNoForce) {
  HeldBlock block;
  SurfaceContact contact(block.mesh, block.boundary, {});
  block.solver.set_contacts({&contact});
  PlacedProbe probe;
  probe.tip_m = to_metres({20.0, 20.0, 10.0});
  contact.place(probe);
  contact.search(block.solver);
  block.solver.advance(20);
  EXPECT_EQ(contact.touching(), 0);
  EXPECT_EQ(contact.force_N().norm(), 0.0F);
  EXPECT_EQ(block.solver.energies().elastic_J, 0.0);
}

// ---- the cut ----

// A thin probe inserted into the block from above.
class CutBlock : public HeldBlock {
public:
  CutBlock(double depth_mm, const CutContact::Forces &forces, double section_radius_mm = 2.5)
      : contact(mesh, locator, 2.5, section_radius_mm) {
    solver.set_contacts({&contact});
    contact.set_forces(forces);
    probe_.radius_m = 1e-3F;
    probe_.tip_m = to_metres({20.3, 19.6, 20.0 - depth_mm});
    contact.place(probe_);
    contact.begin(locator.locate({20.3, 19.6, 20.0 - depth_mm}).tetrahedron);
    solver.advance(1);
  }

  void move(float down_m_s, double time_s) { move({0.0F, 0.0F, -down_m_s}, time_s); }
  void move(const Vector3f &velocity_m_s, double time_s) {
    probe_.tip_velocity_m_s = velocity_m_s;
    const int steps = static_cast<int>(time_s / solver.step_s());
    const int settling = steps / 2;
    most_tip_N = 0.0F;
    mean_tip_N = 0.0F;
    mean_shaft_N.setZero();
    for (int i = 0; i < steps; ++i) {
      probe_.tip_m += step_s() * velocity_m_s;
      contact.place(probe_);
      solver.advance(1);
      most_tip_N = std::max(most_tip_N, contact.tip_force_N());
      if (i >= settling) {
        const float ratio = 1.0F / static_cast<float>(steps - settling);
        mean_tip_N += ratio * contact.tip_force_N();
        mean_shaft_N += ratio * contact.shaft_force_N();
      }
    }
  }

  CutContact contact;
  [[nodiscard]] float mean_friction_N() const { return -mean_shaft_N.z(); } // downwards

  float most_tip_N = 0.0F, mean_tip_N = 0.0F;
  Vector3f mean_shaft_N = Vector3f::Zero();

private:
  PlacedProbe probe_;
};

TEST(CutContact, TheTipPushesWithAtMostTheCuttingForce) {
  CutBlock block(5.0, {.cutting_N = 0.05F, .friction_N_per_m = 0.0F});
  block.move(20e-3F, 0.4);
  EXPECT_LE(block.most_tip_N, 0.0501F);
  EXPECT_GT(block.mean_tip_N, 0.6F * 0.05F);
  EXPECT_LT(std::abs(block.mean_friction_N()), 0.05F * 0.05F);
  block.move(-5e-3F, 0.4);
  EXPECT_LT(block.mean_tip_N, 0.01F * 0.05F); // it never pulls
}

TEST(CutContact, TissueThatIsCutAlreadyDoesNotResistTheTip) {
  CutBlock block(5.0, {.cutting_N = 0.0F, .friction_N_per_m = 0.0F});
  block.move(20e-3F, 0.4);
  EXPECT_EQ(block.most_tip_N, 0.0F);
}

TEST(CutContact, FrictionIsProportionalToTheLengthInside) {
  constexpr float kFriction_N_per_m = 2.0F;
  for (const double depth_mm : {5.0, 10.0}) {
    CutBlock block(depth_mm, {.cutting_N = 0.0F, .friction_N_per_m = kFriction_N_per_m});
    block.move(20e-3F, 0.2); // 4 mm
    // One point is constrained per 2.5 mm, so the length is a multiple of 2.5 mm.
    const float length_m = 1e-3F * static_cast<float>(depth_mm + 3.0);
    EXPECT_NEAR(block.mean_friction_N(), kFriction_N_per_m * length_m, kFriction_N_per_m * 2.5e-3F) << depth_mm;
    block.move(-20e-3F, 0.1); // back by 2 mm: opposite friction
    EXPECT_LT(block.mean_friction_N(), -0.5F * kFriction_N_per_m * length_m) << depth_mm;
  }
}

TEST(CutContact, TissueAlongTheCutStaysOnTheAxis) {
  CutBlock block(10.0, {.cutting_N = 0.05F, .friction_N_per_m = 0.5F});
  block.move(10e-3F, 0.3);
  // The probe does not move sideways, and neither does the tissue around it.
  for (int i = 0; i < block.solver.nodes(); ++i) {
    EXPECT_LT(block.solver.displacement_mm(i).head<2>().norm(), 1.5) << i;
  }
  EXPECT_EQ(block.solver.inverted_elements(), 0);
}

TEST(CutContact, AShaftMovedSidewaysMovesTissueWithoutInvertingTetrahedra) {
  const auto max_compression = [](double section_radius_mm) {
    CutBlock block(10.0, {.cutting_N = 0.05F, .friction_N_per_m = 0.5F}, section_radius_mm);
    block.move({20e-3F, 0.0F, 0.0F}, 0.2); // 4 mm
    double farthest_mm = 0.0;
    for (int i = 0; i < block.solver.nodes(); ++i) {
      farthest_mm = std::max(farthest_mm, block.solver.displacement_mm(i).x());
    }
    EXPECT_NEAR(farthest_mm, 4.0, 1.0) << section_radius_mm;
    double least = 1.0;
    for (int e = 0; e < block.solver.elements(); ++e) {
      least = std::min(least, block.solver.deformation_gradient(e).determinant());
    }
    return 1.0 - least;
  };
  EXPECT_LT(max_compression(3.0), 0.8 * max_compression(0.0)); // 0.0: single points
}

TEST(CutContact, AShaftUnderALargeSidewaysLoadCutsTheTissue) {
  constexpr float kBears_N_per_m = 2.0F;
  CutBlock block(10.0, {.cutting_N = 0.0F, .friction_N_per_m = 0.0F, .sideways_N_per_m = kBears_N_per_m});
  block.move({20e-3F, 0.0F, 0.0F}, 0.4);                                                    // 8 mm
  EXPECT_NEAR(block.mean_shaft_N.x(), kBears_N_per_m * 12.5e-3F, kBears_N_per_m * 2.5e-3F); // over five sections
  double farthest_mm = 0.0;
  for (int i = 0; i < block.solver.nodes(); ++i) {
    farthest_mm = std::max(farthest_mm, block.solver.displacement_mm(i).x());
  }
  EXPECT_LT(farthest_mm, 4.0);
  block.move({-20e-3F, 0.0F, 0.0F}, 0.2); // the cut tissue pushes in the other direction only after it has returned
  EXPECT_LT(block.mean_shaft_N.x(), 0.5F * kBears_N_per_m * 12.5e-3F);
}

TEST(CutContact, WithdrawalReleasesTheSectionsAndLeavesTheTissue) {
  CutBlock block(10.0, {.cutting_N = 0.05F, .friction_N_per_m = 0.5F});
  EXPECT_NEAR(block.contact.length_m(), 10e-3F, 2.6e-3F);
  float before_m = block.contact.length_m();
  for (int i = 0; i < 6; ++i) {
    block.move(-20e-3F, 0.1); // 2 mm
    EXPECT_LE(block.contact.length_m(), before_m);
    before_m = block.contact.length_m();
  }
  EXPECT_EQ(block.contact.length_m(), 0.0F);
  block.move(0.0F, 1.5);
  double largest_mm = 0.0;
  for (int i = 0; i < block.solver.nodes(); ++i) {
    largest_mm = std::max(largest_mm, block.solver.displacement_mm(i).norm());
  }
  EXPECT_LT(largest_mm, 0.05); // no constraint remains
}

} // namespace
} // namespace bregma::tissue
