// Static answers against analytic ones (tests/support/tissue_problems.hpp); bench_tissue prints the same on finer
// meshes.
#include <cmath>

#include <gtest/gtest.h>

#include "tests/support/tissue_problems.hpp"

namespace bregma::tissue {
namespace {

using test::elastic;

Eigen::Matrix3d some_gradient() {
  Eigen::Matrix3d f;
  f << 1.10, 0.20, -0.05, //
      0.03, 0.90, 0.10,   //
      0.00, -0.08, 1.05;
  return f;
}

TEST(TissuePatch, AnAffineBoundaryGivesAnAffineInteriorAndTheExactStress) {
  for (const Law law : {Law::kNeoHookean, Law::kOgden}) {
    for (const double poisson : {0.3, 0.45, 0.49, 0.499}) {
      const test::PatchAnswer answer = test::patch(test::brain(law, poisson), some_gradient());
      EXPECT_LT(answer.displacement_error, 1e-4) << poisson;
      EXPECT_LT(answer.stress_error, 1e-4) << poisson;
      EXPECT_LT((answer.nominal_Pa - answer.reference_Pa).norm(), 1e-4 * answer.reference_Pa.norm()) << poisson;
    }
  }
}

TEST(TissuePatch, HoldsInEveryKernelAndOnTwoThreads) {
  for (const ElementKernel &kernel : element_kernels()) {
    SolverOptions options;
    options.kernel = &kernel;
    options.threads = 2;
    const test::PatchAnswer answer = test::patch(test::brain(Law::kNeoHookean, 0.45), some_gradient(), options);
    EXPECT_LT(answer.displacement_error, 1e-4) << kernel.name;
    EXPECT_LT(answer.stress_error, 1e-4) << kernel.name;
  }
}

// [Rivlin 1948]: s_xy = mu gamma, s_xx - s_yy = mu gamma^2.
TEST(TissuePatch, SimpleShearOfANeoHookeanBlock) {
  constexpr double kGamma = 0.4;
  Eigen::Matrix3d f = Eigen::Matrix3d::Identity();
  f(0, 1) = kGamma;
  const Material material = test::brain(Law::kNeoHookean, 0.45);
  const Eigen::Matrix3d nominal = test::patch(material, f).nominal_Pa;
  const Eigen::Matrix3d cauchy = nominal * f.transpose();
  EXPECT_NEAR(cauchy(0, 1), material.shear_Pa() * kGamma, 1e-3 * material.shear_Pa() * kGamma);
  EXPECT_NEAR(cauchy(0, 0) - cauchy(1, 1), material.shear_Pa() * kGamma * kGamma, 1e-3 * material.shear_Pa() * kGamma);
}

TEST(TissuePatch, ARotationMakesNoForce) {
  for (const Law law : {Law::kNeoHookean, Law::kOgden}) {
    const TetMesh mesh = block_mesh({3, 3, 3}, {15.0, 15.0, 15.0});
    ExplicitSolver solver(mesh, test::brain(law, 0.49));
    Eigen::Matrix3d turn; // 90 degrees about x + y + z: a cyclic permutation, exact in floats except for the products
    turn << 0, 0, 1, 1, 0, 0, 0, 1, 0;
    for (int i = 0; i < solver.nodes(); ++i) {
      const Eigen::Vector3d &rest = mesh.nodes_mm[static_cast<std::size_t>(i)];
      solver.set_displacement_mm(i, turn * rest - rest);
    }
    solver.advance(1);
    double largest_N = 0.0;
    for (int i = 0; i < solver.nodes(); ++i) {
      largest_N = std::max(largest_N, solver.elastic_force_N(i).norm());
    }
    // Relative to the force of a strain of 0.001 on a face of a cell.
    EXPECT_LT(largest_N, 1e-3 * solver.material().young_Pa * 1e-3 * 25e-6);
    EXPECT_NEAR(solver.energies().elastic_J, 0.0, 1e-12);
  }
}

TEST(TissueUniaxial, CompressionAndTensionMatchTheExactBar) {
  for (const Law law : {Law::kNeoHookean, Law::kOgden}) {
    for (const double poisson : {0.45, 0.49}) {
      for (const double stretch : {0.6, 0.8, 1.3, 1.8}) {
        const test::UniaxialAnswer answer = test::uniaxial(test::brain(law, poisson), stretch);
        EXPECT_LT(answer.force_N.error(), 1e-3) << "nu " << poisson << ", stretch " << stretch;
        EXPECT_LT(answer.across_mm.error(), 1e-3) << "nu " << poisson << ", stretch " << stretch;
      }
    }
  }
}

TEST(TissueSphere, UnderPressureConvergesToLameWithSecondOrder) {
  for (const double poisson : {0.3, 0.45, 0.49}) {
    const test::FieldAnswer coarse = test::pressurised_sphere(poisson, 4);
    const test::FieldAnswer fine = test::pressurised_sphere(poisson, 8);
    EXPECT_TRUE(fine.relaxation.converged);
    EXPECT_LT(fine.known.error(), 0.01) << poisson;
    EXPECT_LT(fine.displacement_error, 0.012) << poisson;
    const double order =
        std::log(coarse.displacement_error / fine.displacement_error) / std::log(coarse.edge_mm / fine.edge_mm);
    EXPECT_GT(order, 1.7) << poisson;
  }
}

TEST(TissueSphere, InflatedByHalfMatchesTheExactPressure) { EXPECT_LT(test::blown_sphere(0.499, 6).error(), 0.02); }

TEST(TissueBending, DoesNotLock) {
  for (const double poisson : {0.45, 0.49, 0.499}) {
    const test::FieldAnswer answer = test::plane_strain_beam(Law::kNeoHookean, poisson, 8);
    EXPECT_TRUE(answer.relaxation.converged) << poisson;
    EXPECT_LT(answer.known.error(), 0.05) << poisson;
  }
}

TEST(TissueBending, ConvergesWithSecondOrder) {
  const test::FieldAnswer coarse = test::plane_strain_beam(Law::kLinear, 0.45, 4);
  const test::FieldAnswer fine = test::plane_strain_beam(Law::kLinear, 0.45, 8);
  EXPECT_GT(std::log2(coarse.displacement_error / fine.displacement_error), 1.7);
}

TEST(TissueRelaxation, ABarRelaxesByPronysSeries) {
  Material material = elastic(Law::kNeoHookean, 2100.0, 0.45);
  material.prony = {{0.450, 0.5}, {0.365, 50.0}};
  for (const test::Compared &stress : test::relaxing_bar(material, {0.05, 0.2, 1.0, 5.0, 20.0, 80.0})) {
    EXPECT_LT(stress.error(), 0.01) << stress.value << " Pa, not " << stress.reference;
  }
}

} // namespace
} // namespace bregma::tissue
