// Conservation properties of central differences, and their stable step.
#include <cmath>
#include <random>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "tests/support/tissue_meshes.hpp"
#include "tests/support/tissue_problems.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

constexpr unsigned kMotionSeed = 20261125;

std::vector<Vector3d> all_displacements(const ExplicitSolver &solver) {
  std::vector<Vector3d> out;
  for (int i = 0; i < solver.nodes(); ++i) {
    out.push_back(solver.displacement_mm(i));
  }
  return out;
}

void shake(ExplicitSolver &solver, double size_mm) {
  std::mt19937 rng(kMotionSeed);
  std::uniform_real_distribution<double> unit(-size_mm, size_mm);
  for (int i = 0; i < solver.nodes(); ++i) {
    solver.set_displacement_mm(i, solver.displacement_mm(i) + Vector3d(unit(rng), unit(rng), unit(rng)));
  }
}

// Stretches the block to 1.05 of its length. The vibration afterwards contains all wavelengths.
void pull(ExplicitSolver &solver) {
  for (int i = 0; i < solver.nodes(); ++i) {
    const Vector3d &rest = solver.mesh().nodes_mm[static_cast<std::size_t>(i)];
    solver.set_displacement_mm(i, {-0.02 * rest.x(), -0.02 * rest.y(), 0.05 * rest.z()});
  }
}

// 2 / omega_max from all eigenvalues of the stiffness matrix, which is computed column by column from the forces at
// displaced nodes. Fixed nodes are excluded.
double critical_step_s(const Material &material, const TetMesh &mesh, const ExplicitSolver &like,
                       const std::vector<int> &held = {}) {
  ExplicitSolver solver(mesh, material);
  const std::vector<Vector3d> base = all_displacements(like);
  const int size = 3 * solver.nodes();
  const double by_mm = 0.002;
  const auto forces_at = [&](int column, double way_mm) {
    for (int i = 0; i < solver.nodes(); ++i) {
      Vector3d to = base[static_cast<std::size_t>(i)];
      if (i == column / 3) {
        to[column % 3] += way_mm;
      }
      solver.set_displacement_mm(i, to);
    }
    solver.stop_motion();
    solver.advance(1);
    Eigen::VectorXd out(size);
    for (int i = 0; i < solver.nodes(); ++i) {
      out.segment<3>(Eigen::Index{3} * i) = solver.elastic_force_N(i);
    }
    return out;
  };
  Eigen::MatrixXd stiffness(size, size);
  Eigen::VectorXd root_mass(size);
  for (int column = 0; column < size; ++column) {
    stiffness.col(column) = (forces_at(column, -by_mm) - forces_at(column, by_mm)) / (2.0 * by_mm / 1000.0);
    root_mass[column] = std::sqrt(like.mass_kg(column / 3));
  }
  Eigen::VectorXd scale = root_mass.cwiseInverse();
  for (const int node : held) {
    scale.segment<3>(Eigen::Index{3} * node).setZero();
  }
  const Eigen::MatrixXd scaled = scale.asDiagonal() * (0.5 * (stiffness + stiffness.transpose())) * scale.asDiagonal();
  return 2.0 / std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(scaled).eigenvalues().maxCoeff());
}

TEST(TissueMotion, FreeVibrationKeepsItsEnergy) {
  for (const Law law : {Law::kNeoHookean, Law::kOgden}) {
    Material material = test::elastic(law, 2100.0, 0.45);
    material.ogden_alpha = -4.7;
    ExplicitSolver solver(test::jittered_block({3, 3, 6}, {15.0, 15.0, 30.0}, 0.15, kMotionSeed), material);
    pull(solver);
    const auto mean_energy = [&] { // the two energies are half a step apart: their sum oscillates, its mean does not
      double sum = 0.0;
      constexpr int kSteps = 300;
      for (int i = 0; i < kSteps; ++i) {
        solver.advance(1);
        sum += solver.energies().elastic_J + solver.energies().kinetic_J;
      }
      return sum / kSteps;
    };
    const double before = mean_energy();
    solver.advance(5000);
    EXPECT_NEAR(mean_energy() / before, 1.0, 0.02);
  }
}

TEST(TissueMotion, DampingRemovesEnergyAtItsRate) {
  SolverOptions options;
  options.damping_per_s = 4.0;
  ExplicitSolver solver(block_mesh({3, 3, 3}, {15.0, 15.0, 15.0}), test::elastic(Law::kLinear, 2100.0, 0.3), options);
  constexpr double kSpeed_mm_s = 10.0; // speed of the whole block; damping is the only force
  for (int i = 0; i < solver.nodes(); ++i) {
    solver.set_force_N(i, {solver.mass_kg(i) * kSpeed_mm_s / 1000.0 / solver.step_s(), 0.0, 0.0});
  }
  solver.advance(1);
  solver.clear_forces();
  const double begin_mm_s = solver.velocity_mm_s(5).x();
  const double step_s = solver.step_s();
  solver.advance(40);
  EXPECT_NEAR(solver.velocity_mm_s(5).x() / begin_mm_s, std::exp(-4.0 * 40.0 * step_s), 0.002);
}

TEST(TissueMotion, AFreeBlockKeepsItsMomenta) {
  ExplicitSolver solver(test::jittered_block({4, 4, 4}, {20.0, 20.0, 20.0}, 0.15, kMotionSeed),
                        test::elastic(Law::kNeoHookean, 2100.0, 0.45));
  shake(solver, 0.01);
  solver.advance(2000);
  Vector3d linear = Vector3d::Zero();
  Vector3d angular = Vector3d::Zero();
  double moving = 0.0;
  double turning = 0.0;
  for (int i = 0; i < solver.nodes(); ++i) {
    const Vector3d at = solver.mesh().nodes_mm[static_cast<std::size_t>(i)] + solver.displacement_mm(i);
    const Vector3d momentum = solver.mass_kg(i) * solver.velocity_mm_s(i);
    linear += momentum;
    angular += at.cross(momentum);
    moving += momentum.norm();
    turning += at.norm() * momentum.norm();
  }
  EXPECT_LT(linear.norm(), 1e-4 * moving);
  EXPECT_LT(angular.norm(), 1e-3 * turning);
}

TEST(TissueMotion, AFreeBlockFallsUniformly) {
  ExplicitSolver solver(block_mesh({2, 2, 2}, {10.0, 10.0, 10.0}), test::elastic(Law::kNeoHookean, 2100.0, 0.45));
  for (int i = 0; i < solver.nodes(); ++i) {
    solver.set_force_N(i, {0.0, 0.0, -9.81 * solver.mass_kg(i)});
  }
  constexpr int kSteps = 30;
  const double step_s = solver.step_s();
  solver.advance(kSteps);
  // Central differences: n (n + 1) / 2 g dt^2.
  const double fallen_mm = 500.0 * 9.81 * step_s * step_s * kSteps * (kSteps + 1);
  for (int i = 0; i < solver.nodes(); ++i) {
    EXPECT_NEAR(solver.displacement_mm(i).z(), -fallen_mm, 1e-4 * fallen_mm);
  }
}

TEST(TissueMotion, TwoThreadsAgreeWithOne) {
  std::vector<Vector3d> answers[2];
  for (int threads = 1; threads <= 2; ++threads) {
    SolverOptions options;
    options.threads = threads;
    ExplicitSolver solver(block_mesh({5, 4, 6}, {25.0, 20.0, 30.0}), named_material("miller-chinzei"), options);
    pull(solver);
    solver.advance(100);
    answers[threads - 1] = all_displacements(solver);
  }
  double largest_mm = 0.0;
  for (std::size_t i = 0; i < answers[0].size(); ++i) {
    largest_mm = std::max(largest_mm, (answers[0][i] - answers[1][i]).norm());
  }
  EXPECT_LT(largest_mm, 0.01) << "of 1.5 mm: sums in another order, a hundred steps later";
}

TEST(TissueStep, IsTheCriticalOneByAllEigenvalues) {
  for (const double poisson : {0.3, 0.45, 0.49}) {
    const Material material = test::elastic(Law::kNeoHookean, 2100.0, poisson);
    const TetMesh mesh = test::jittered_block({3, 3, 3}, {15.0, 15.0, 15.0}, 0.15, kMotionSeed);
    SolverOptions options;
    options.step_fraction = 1.0;
    const ExplicitSolver solver(mesh, material, options);
    // Power iteration approaches the frequency from below and the step from above.
    const double critical_s = critical_step_s(material, mesh, solver);
    EXPECT_LT(solver.step_s(), 1.03 * critical_s) << poisson;
    EXPECT_GT(solver.step_s(), 0.99 * critical_s) << poisson;
  }
}

TEST(TissueStep, StaysBoundedJustBelowTheCriticalOne) {
  SolverOptions options;
  options.step_fraction = 0.95;
  ExplicitSolver solver(test::jittered_block({4, 4, 4}, {20.0, 20.0, 20.0}, 0.15, kMotionSeed),
                        test::elastic(Law::kNeoHookean, 2100.0, 0.45), options);
  shake(solver, 0.005); // small: the critical step is that of the tissue at rest
  solver.advance(1);
  const double begin_J = solver.energies().elastic_J;
  double largest_J = 0.0;
  for (int i = 0; i < 100; ++i) {
    solver.advance(50);
    largest_J = std::max(largest_J, solver.energies().elastic_J);
  }
  // A mode's amplitude is 1 / (1 - (omega dt / 2)^2) times that of continuous time: at most tenfold.
  EXPECT_LT(largest_J, 10.0 * begin_J);
}

TEST(TissueStep, FollowsTissueThatStiffens) {
  const Material material = test::elastic(Law::kNeoHookean, 2100.0, 0.45);
  const TetMesh mesh = test::jittered_block({3, 3, 4}, {15.0, 15.0, 20.0}, 0.1, kMotionSeed);
  SolverOptions options;
  options.damping_per_s = 50.0;
  ExplicitSolver solver(mesh, material, options);
  const double at_rest_s = solver.step_s();
  // A plate compresses half of the block at 50 mm/s.
  std::vector<int> held = test::nodes_at(mesh, 2, 0.0);
  std::vector<int> plate = test::nodes_at(mesh, 2, 20.0);
  std::erase_if(plate, [&](int node) { return mesh.nodes_mm[static_cast<std::size_t>(node)].x() > 7.0; });
  held.insert(held.end(), plate.begin(), plate.end());
  for (const int node : held) {
    solver.fix(node);
  }
  double down_mm = 0.0;
  while (down_mm < 9.0) {
    down_mm += 50.0 * solver.step_s();
    for (const int node : plate) {
      solver.set_displacement_mm(node, {0.0, 0.0, -down_mm});
    }
    solver.advance(1);
    ASSERT_EQ(solver.clamped_nodes(), 0) << "at " << down_mm << " mm";
  }
  EXPECT_LT(solver.step_s(), critical_step_s(material, mesh, solver, held)); // even while it moves
  solver.advance(1000);                                                      // checked every 50 steps
  EXPECT_TRUE(solver.finite());
  const double critical_s = critical_step_s(material, mesh, solver, held);
  EXPECT_LT(critical_s, 0.98 * at_rest_s / 0.85);
  EXPECT_NEAR(solver.step_s(), 0.85 * critical_s, 0.03 * critical_s);
}

TEST(TissueStep, MassScalingKeepsTheRequestedStep) {
  const Material material = test::elastic(Law::kNeoHookean, 2100.0, 0.45);
  TetMesh mesh = block_mesh({4, 4, 4}, {20.0, 20.0, 20.0});
  for (Vector3d &node : mesh.nodes_mm) { // thin cells on one side
    node.x() = node.x() * node.x() / 20.0;
  }
  const ExplicitSolver plain(mesh, material);
  EXPECT_EQ(plain.added_mass_fraction(), 0.0);
  SolverOptions options;
  options.minimum_step_s = 2.0 * plain.step_s();
  const ExplicitSolver scaled(mesh, material, options);
  EXPECT_GE(scaled.step_s(), options.minimum_step_s);
  EXPECT_LE(options.minimum_step_s, critical_step_s(material, mesh, scaled));
  double before = 0.0;
  double after = 0.0;
  for (int i = 0; i < plain.nodes(); ++i) {
    EXPECT_GE(scaled.mass_kg(i), plain.mass_kg(i));
    before += plain.mass_kg(i);
    after += scaled.mass_kg(i);
  }
  EXPECT_NEAR(before, 8e-3, 1e-8);
  EXPECT_GT(scaled.added_mass_fraction(), 0.0);
  EXPECT_NEAR(scaled.added_mass_fraction(), after / before - 1.0, 1e-5);
}

} // namespace
} // namespace bregma::tissue
