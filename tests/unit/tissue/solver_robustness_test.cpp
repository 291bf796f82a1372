// Robustness of the solver: extreme inputs, refused inputs, and no allocation in a step.
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "tests/support/allocation_counter.hpp"
#include "tests/support/tissue_meshes.hpp"
#include "tests/support/tissue_problems.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

constexpr RelaxationOptions kTight{1e-5, 40000, false};

// A block that is fixed at the bottom.
class StandingBlock {
public:
  StandingBlock(const Material &material, int threads = 1) : mesh(block_mesh({4, 4, 4}, {20.0, 20.0, 20.0})) {
    SolverOptions options;
    options.threads = threads;
    solver = std::make_unique<ExplicitSolver>(mesh, material, options);
    for (const int node : test::nodes_at(mesh, 2, 0.0)) {
      solver->fix(node);
    }
  }
  [[nodiscard]] double largest_displacement_mm() const {
    double out = 0.0;
    for (int i = 0; i < solver->nodes(); ++i) {
      out = std::max(out, solver->displacement_mm(i).norm());
    }
    return out;
  }
  TetMesh mesh;
  std::unique_ptr<ExplicitSolver> solver;
};

constexpr int kMiddle = 62;  // (10, 10, 10) mm
constexpr int kCorner = 124; // (20, 20, 20) mm

TEST(TissueRobustness, ANodePushedThroughTheOppositeFacesRecovers) {
  for (const Law law : {Law::kNeoHookean, Law::kOgden, Law::kLinear}) {
    for (const double poisson : {0.45, 0.49}) {
      for (const int node : {kMiddle, kCorner}) {
        for (const double far_mm : {-8.0, 15.0}) {
          StandingBlock block(test::brain(law, poisson));
          block.solver->set_displacement_mm(node, far_mm * Vector3d(0.9, 0.7, 1.0));
          if (law != Law::kLinear && node == kMiddle) {
            block.solver->advance(1);
            EXPECT_GT(block.solver->inverted_elements(), 0);
          }
          const RelaxationResult relaxation = block.solver->relax(kTight);
          EXPECT_TRUE(relaxation.converged);
          EXPECT_EQ(block.solver->inverted_elements(), 0);
          EXPECT_LT(block.largest_displacement_mm(), 1e-3) << "node " << node << ", " << far_mm << " mm";
        }
      }
    }
  }
}

TEST(TissueRobustness, AnInvertedTetrahedronRecoversInMotion) {
  StandingBlock block(test::brain(Law::kNeoHookean, 0.45));
  block.solver->set_displacement_mm(kMiddle, {12.0, -3.0, 9.0});
  block.solver->advance(3000);
  EXPECT_TRUE(block.solver->finite());
  EXPECT_EQ(block.solver->inverted_elements(), 0);
  (void)block.solver->relax(kTight);
  EXPECT_LT(block.largest_displacement_mm(), 1e-3);
}

TEST(TissueRobustness, AnImpossibleJumpIsFlaggedAndRecovers) {
  const auto push = [](StandingBlock &block, double down_mm) {
    for (const int node : {kMiddle + 50, kMiddle + 51, kMiddle + 55, kMiddle + 56}) { // four nodes of the top
      block.solver->fix(node);
      block.solver->set_displacement_mm(node, {0.0, 0.0, -down_mm});
    }
  };
  StandingBlock calm(test::brain(Law::kNeoHookean, 0.45));
  push(calm, 2.0);
  ASSERT_TRUE(calm.solver->relax(kTight).converged);

  StandingBlock block(test::brain(Law::kNeoHookean, 0.45));
  push(block, 60.0); // three times the block's height, for the duration of one wrong tracker sample
  int limited = 0;
  for (int i = 0; i < 10; ++i) {
    block.solver->advance(1);
    limited += block.solver->clamped_nodes();
    ASSERT_TRUE(block.solver->finite());
  }
  EXPECT_GT(limited, 0);
  push(block, 2.0);
  EXPECT_TRUE(block.solver->relax(kTight).converged);
  EXPECT_EQ(block.solver->clamped_nodes(), 0);
  for (int i = 0; i < calm.solver->nodes(); ++i) {
    EXPECT_LT((calm.solver->displacement_mm(i) - block.solver->displacement_mm(i)).norm(), 2e-3) << i;
  }
}

TEST(TissueRobustness, ExcessiveForcesStayFinite) {
  StandingBlock block(test::brain(Law::kOgden, 0.49));
  block.solver->set_force_N(kCorner, {1e6, -1e6, 1e6});
  block.solver->advance(300);
  EXPECT_TRUE(block.solver->finite());
  EXPECT_GT(block.solver->clamped_nodes(), 0);
  EXPECT_FALSE(block.solver->relax({1e-5, 300, false}).converged);
  EXPECT_TRUE(block.solver->finite());
  block.solver->reset();
  block.solver->clear_forces();
  EXPECT_TRUE(block.solver->relax(kTight).converged);
  EXPECT_EQ(block.largest_displacement_mm(), 0.0);
}

TEST(TissueRobustness, AFreeBlockRelaxesWithoutDrift) {
  ExplicitSolver solver(block_mesh({2, 2, 2}, {10.0, 10.0, 10.0}), test::brain(Law::kNeoHookean, 0.45));
  EXPECT_TRUE(solver.relax().converged); // no loads
  solver.set_force_N(0, {1e-3, 0.0, 0.0});
  EXPECT_FALSE(solver.relax({1e-5, 1000, false}).converged); // no supports
  EXPECT_TRUE(solver.finite());
}

TEST(TissueRobustness, RestHasNoEnergyAndResetRestoresIt) {
  StandingBlock block(test::brain(Law::kNeoHookean, 0.45));
  EXPECT_EQ(block.solver->energies().elastic_J, 0.0);
  block.solver->set_displacement_mm(kCorner, {3.0, 0.0, 0.0});
  block.solver->advance(20);
  EXPECT_GT(block.solver->energies().elastic_J, 0.0);
  block.solver->reset();
  EXPECT_EQ(block.solver->energies().elastic_J, 0.0);
  EXPECT_EQ(block.solver->energies().kinetic_J, 0.0);
  EXPECT_EQ(block.solver->cauchy_Pa(0).norm(), 0.0);
  EXPECT_EQ(block.solver->elastic_force_N(kCorner).norm(), 0.0);
}

// After relax() the stress is that of the requested state: instantaneous or fully relaxed.
TEST(TissueRobustness, StressAfterRelaxMatchesItsModulus) {
  Material material = test::brain(Law::kNeoHookean, 0.45);
  material.prony = {{0.45, 0.5}, {0.365, 50.0}};
  StandingBlock block(material);
  block.solver->fix(kCorner);
  block.solver->set_displacement_mm(kCorner, {2.0, 1.0, -1.0});
  const auto holds = [&] { // the stress of the corner's tetrahedra balances the reaction at the corner
    Vector3d force = Vector3d::Zero();
    for (int e = 0; e < block.solver->elements(); ++e) {
      const Eigen::Vector4i &t = block.mesh.tetrahedra[static_cast<std::size_t>(e)];
      for (int i = 0; i < 4; ++i) {
        if (t[i] != kCorner) {
          continue;
        }
        const auto now = [&](int k) {
          return Vector3d((block.mesh.nodes_mm[static_cast<std::size_t>(t[k])] + block.solver->displacement_mm(t[k])) /
                          1000.0);
        };
        // Force on the opposite face, one third per node.
        const int a = (i + 1) % 4;
        const int b = (i + 2) % 4;
        const int c = (i + 3) % 4;
        Vector3d area = 0.5 * (now(b) - now(a)).cross(now(c) - now(a));
        if (area.dot(now(i) - now(a)) > 0.0) {
          area = -area; // outward: away from the node
        }
        force += block.solver->cauchy_Pa(e) * area / 3.0;
      }
    }
    return force;
  };
  for (const bool relaxed : {false, true}) {
    ASSERT_TRUE(block.solver->relax({1e-5, 40000, relaxed}).converged);
    const Vector3d force = block.solver->elastic_force_N(kCorner);
    EXPECT_LT((holds() - force).norm(), 2e-3 * force.norm()) << relaxed;
  }
}

TEST(TissueRobustness, NoStepAllocates) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "a sanitizer counts for itself";
  }
  for (const int threads : {1, 2}) {
    StandingBlock block(named_material("miller-chinzei"), threads);
    block.solver->set_displacement_mm(kCorner, {1.0, 0.0, -1.0});
    const test::AllocationScope scope;
    block.solver->advance(200);
    (void)block.solver->relax();
    block.solver->reset();
    EXPECT_EQ(scope.count(), 0U) << threads;
  }
}

std::string refusal(const std::function<void(TetMesh &, Material &, SolverOptions &)> &spoil) {
  TetMesh mesh = block_mesh({1, 1, 1}, {5.0, 5.0, 5.0});
  Material material = named_material("thesis");
  SolverOptions options;
  spoil(mesh, material, options);
  try {
    const ExplicitSolver solver(mesh, material, options);
  } catch (const std::invalid_argument &error) {
    return error.what();
  }
  return "";
}

TEST(TissueRefusals, AreReportedWithTheReason) {
  using M = TetMesh;
  using P = Material;
  using O = SolverOptions;
  EXPECT_EQ(refusal([](M &, P &, O &) {}), "");
  EXPECT_EQ(refusal([](M &m, P &, O &) { m.tetrahedra.clear(); }), "mesh without tetrahedra");
  EXPECT_EQ(refusal([](M &m, P &, O &) { std::swap(m.tetrahedra[2][0], m.tetrahedra[2][1]); }).substr(0, 45),
            "tetrahedron 2 has a volume of -20.833333 mm^3");
  EXPECT_EQ(refusal([](M &, P &p, O &) { p.poisson = 0.5; }),
            "material 'thesis': poisson = 0.500000, must be at least 0 and below 0.5");
  EXPECT_EQ(refusal([](M &, P &p, O &) {
              p.prony.assign(5, {0.1, 1.0});
            }),
            "material 'thesis': 5 Prony terms, at most 4");
  const std::string options = "solver options: threads at least 1, step_fraction in (0, 1], minimum_step_s and "
                              "damping_per_s not negative, element_pressure_fraction in [0, 1]";
  EXPECT_EQ(refusal([](M &, P &, O &o) { o.threads = 0; }), options);
  EXPECT_EQ(refusal([](M &, P &, O &o) { o.step_fraction = 1.01; }), options);
  EXPECT_EQ(refusal([](M &, P &, O &o) { o.step_fraction = 0.0; }), options);
  EXPECT_EQ(refusal([](M &, P &, O &o) { o.minimum_step_s = -1.0; }), options);
  EXPECT_EQ(refusal([](M &, P &, O &o) { o.damping_per_s = -1.0; }), options);
}

} // namespace
} // namespace bregma::tissue
