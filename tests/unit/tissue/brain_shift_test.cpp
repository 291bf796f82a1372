// Brain shift compared with columns under their own weight, and properties on an egg in its skull.
#include "algorithms/tissue/brain_shift.hpp"

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "algorithms/surface/surface_model.hpp"
#include "tests/support/tissue_meshes.hpp"
#include "tests/support/tissue_problems.hpp"
#include "tests/unit/tissue/egg.hpp"

namespace bregma::tissue {
namespace {

using Eigen::Vector3d;

constexpr double kG_m_s2 = 9.80665;
constexpr double kHigh_mm = 100.0;

TetMesh column() { return block_mesh({2, 2, 10}, {20.0, 20.0, kHigh_mm}); }

Vector3d sum(const std::vector<Vector3d> &vectors) {
  Vector3d out = Vector3d::Zero();
  for (const Vector3d &vector : vectors) {
    out += vector;
  }
  return out;
}

BrainShiftOptions standing() {
  BrainShiftOptions options;
  options.gravity = options.gravity_imaged = -Vector3d::UnitZ();
  options.material = test::elastic(Law::kLinear, 2100.0, 0.45);
  options.stem_mm = 0.0;
  options.falx = false;
  return options;
}

TEST(BrainShiftLoad, IsTheLostBuoyancyForAnyFluidLevel) {
  BrainShiftOptions options = standing();
  for (const double drop_mm : {0.0, 0.5, 3.0, 9.9, 10.0, 37.0, 96.3, 100.0, 140.0}) {
    options.fluid_drop_mm = drop_mm;
    const Vector3d load_N = sum(shift_load_N(column(), options));
    const double lost_m3 = 400.0 * std::min(drop_mm, kHigh_mm) * 1e-9;
    EXPECT_NEAR(load_N.z(), -options.fluid_kg_m3 * kG_m_s2 * lost_m3, 1e-9) << drop_mm;
    EXPECT_LT(load_N.head<2>().norm(), 1e-12);
  }
}

TEST(BrainShiftLoad, TurnsWithTheHead) {
  const TetMesh mesh = column();
  BrainShiftOptions options = standing();
  options.fluid_drop_mm = 33.0;
  const std::vector<Vector3d> load_N = shift_load_N(mesh, options);
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(1.1, Vector3d(0.3, -0.5, 0.8).normalized()).toRotationMatrix();
  TetMesh turned = mesh;
  for (Vector3d &node : turned.nodes_mm) {
    node = turn * node;
  }
  options.gravity = 7.0 * (turn * options.gravity); // any length is allowed
  options.gravity_imaged = turn * options.gravity_imaged;
  const std::vector<Vector3d> turned_N = shift_load_N(turned, options);
  for (std::size_t i = 0; i < load_N.size(); ++i) {
    EXPECT_LT((turned_N[i] - turn * load_N[i]).norm(), 1e-10);
  }
}

TEST(BrainShiftLoad, OfASubmergedHeadInAnotherPostureIsWeightLessBuoyancy) {
  BrainShiftOptions options = standing();
  options.fluid_drop_mm = 0.0;
  options.gravity = Vector3d::UnitX();
  const Vector3d load_N = sum(shift_load_N(column(), options));
  const double weight_N = (options.tissue_kg_m3 - options.fluid_kg_m3) * kG_m_s2 * 40e-6;
  EXPECT_LT((load_N - weight_N * Vector3d(1.0, 0.0, 1.0)).norm(), 1e-9);
}

TEST(BrainShiftLoad, DefaultsToTheCraniotomysLowestEdge) {
  BrainShiftOptions options = standing();
  EXPECT_EQ(sum(shift_load_N(column(), options)).norm(), 0.0); // a closed skull loses no fluid
  options.skull.craniotomy = {{10.0, 10.0, kHigh_mm}, 35.0};   // the lowest nodes within it are 30 mm down
  EXPECT_NEAR(predict_shift(column(), options).fluid_drop_mm, 30.0, 1e-9);
}

// A column between sliding walls shortens by rho g h^2 / (2 M), with the modulus M for zero lateral strain.
TEST(BrainShiftColumn, BetweenWallsSinksByItsWeightOverTwiceTheWaveModulus) {
  const TetMesh mesh = column();
  BrainShiftOptions options = standing();
  options.fluid_drop_mm = kHigh_mm;
  ExplicitSolver solver(mesh, options.material);
  for (const int axis : {0, 1, 2}) {
    for (const double side_mm : {0.0, 20.0}) {
      for (const int node : test::nodes_at(mesh, axis, side_mm)) {
        if (axis < 2 || side_mm == 0.0) {
          solver.fix(node, 1U << static_cast<unsigned>(axis));
        }
      }
    }
  }
  const std::vector<Vector3d> load_N = shift_load_N(mesh, options);
  for (int i = 0; i < solver.nodes(); ++i) {
    solver.set_force_N(i, load_N[static_cast<std::size_t>(i)]);
  }
  ASSERT_TRUE(solver.relax({1e-5, 40000, false}).converged);
  const double height_m = 1e-3 * kHigh_mm;
  const double sinks_mm =
      1e3 * options.fluid_kg_m3 * kG_m_s2 * height_m * height_m / (2.0 * options.material.wave_modulus_Pa());
  for (const int node : test::nodes_at(mesh, 2, kHigh_mm)) {
    EXPECT_NEAR(solver.displacement_mm(node).z(), -sinks_mm, 0.01 * sinks_mm);
  }
}

// The complete prediction: with a craniotomy that leaves all except the bottom free, and nu 0, M equals E.
TEST(BrainShiftColumn, FreeOnItsFootSinksByItsWeightOverTwiceYoungsModulus) {
  BrainShiftOptions options = standing();
  options.material.poisson = 0.0;
  options.material.young_Pa = 2.1e6; // so that little tissue sinks below the level
  options.skull = {.sliding = false, .gap_mm = 0.0, .craniotomy = {{10.0, 10.0, 1000.0}, 999.5}};
  options.relax.tolerance = 1e-5;
  const double lost_N_m3 = options.fluid_kg_m3 * kG_m_s2;
  for (const double drop_mm : {25.0, 60.0, 100.0}) {
    options.fluid_drop_mm = drop_mm;
    const BrainShift shift = predict_shift(column(), options);
    ASSERT_TRUE(shift.relaxation.converged) << drop_mm;
    // The load of the part above the level: constant force below it, decreasing to zero at the top.
    const double drop_m = 1e-3 * drop_mm;
    const double below_m = 1e-3 * (kHigh_mm - drop_mm);
    const double sinks_mm = 1e3 * lost_N_m3 * drop_m * (below_m + 0.5 * drop_m) / options.material.young_Pa;
    const std::vector<int> top = test::nodes_at(column(), 2, kHigh_mm);
    double mean_mm = 0.0; // nodal loads are not uniform over a face
    for (const int node : top) {
      mean_mm += shift.displacement_mm[static_cast<std::size_t>(node)].z() / static_cast<double>(top.size());
    }
    EXPECT_NEAR(mean_mm, -sinks_mm, 0.01 * sinks_mm) << drop_mm;
    EXPECT_NEAR(shift.surface.rest_mm.z(), kHigh_mm, 1e-9);
    EXPECT_NEAR(shift.surface.displacement_mm.z(), mean_mm, 0.05 * sinks_mm);
    EXPECT_EQ(shift.deep.node, -1); // nothing in a column of 20 mm is deeper than 30 mm
  }
}

const TetMesh &egg() {
  static const TetMesh mesh = test::make_egg(2500);
  return mesh;
}

Vector3d highest_mm(const Vector3d &down) {
  return -test::kEggHalf_mm.cwiseProduct(test::kEggHalf_mm.cwiseProduct(down)) /
         test::kEggHalf_mm.cwiseProduct(down).norm();
}

BrainShiftOptions opened_above(const Vector3d &down) {
  BrainShiftOptions options;
  options.gravity = options.gravity_imaged = down;
  options.skull.gap_mm = 1.0;
  options.skull.craniotomy = {highest_mm(down), 25.0};
  return options;
}

TEST(BrainShiftEgg, AnUnchangedLoadMovesNothing) {
  BrainShiftOptions options = opened_above(-Vector3d::UnitY());
  options.fluid_drop_mm = 0.0;
  const BrainShift shift = predict_shift(egg(), options);
  EXPECT_TRUE(shift.relaxation.converged);
  EXPECT_EQ(shift.surface.displacement_mm.norm(), 0.0);
}

TEST(BrainShiftEgg, SinksAlongGravityAndStaysInTheSkull) {
  for (const Vector3d &down : {Vector3d(0, -1, 0), Vector3d(1, 0, 0), Vector3d(0, 1, 0)}) {
    const BrainShiftOptions options = opened_above(down);
    const BrainShift shift = predict_shift(egg(), options);
    ASSERT_TRUE(shift.relaxation.converged);
    EXPECT_EQ(shift.inverted_elements, 0);
    for (const ShiftedPoint &point : {shift.surface, shift.deep}) {
      ASSERT_GE(point.node, 0);
      EXPECT_GT(point.displacement_mm.dot(down), 0.5 * point.displacement_mm.norm()); // it also slides along the skull
    }
    const Vector3d mean_mm = sum(shift.displacement_mm) / static_cast<double>(shift.displacement_mm.size());
    EXPECT_GT(mean_mm.dot(down), 0.8 * mean_mm.norm()); // the falx deflects it
    EXPECT_GT(shift.surface.displacement_mm.norm(), shift.deep.displacement_mm.norm());
    EXPECT_GT(shift.deep.displacement_mm.norm(), 0.1);
    const surface::SurfaceModel skull({egg().nodes_mm, boundary_of(egg()).triangles});
    for (const int node : boundary_of(egg()).nodes) {
      const Vector3d &rest_mm = egg().nodes_mm[static_cast<std::size_t>(node)];
      const Vector3d now_mm = rest_mm + shift.displacement_mm[static_cast<std::size_t>(node)];
      if ((rest_mm - options.skull.craniotomy.centre_mm).norm() > 30.0) {
        EXPECT_LT(skull.closest(now_mm).signed_mm, options.skull.gap_mm + 0.3);
      }
    }
  }
}

TEST(BrainShiftEgg, SinksFartherWithALowerFluidLevel) {
  BrainShiftOptions options = opened_above(-Vector3d::UnitY());
  double surface_mm = 0.0;
  double deep_mm = 0.0;
  for (const double drop_mm : {10.0, 25.0, 50.0, 110.0}) {
    options.fluid_drop_mm = drop_mm;
    const BrainShift shift = predict_shift(egg(), options);
    ASSERT_TRUE(shift.relaxation.converged) << drop_mm;
    EXPECT_GT(shift.surface.displacement_mm.norm(), surface_mm) << drop_mm;
    EXPECT_GT(shift.deep.displacement_mm.norm(), deep_mm) << drop_mm;
    surface_mm = shift.surface.displacement_mm.norm();
    deep_mm = shift.deep.displacement_mm.norm();
  }
}

TEST(BrainShiftEgg, OnItsSideTheFalxCarriesTheUpperHalf) {
  BrainShiftOptions options = opened_above(Vector3d(1, 0, 0));
  options.fluid_drop_mm = 30.0;
  const BrainShift with = predict_shift(egg(), options);
  options.falx = false;
  const BrainShift without = predict_shift(egg(), options);
  ASSERT_TRUE(with.relaxation.converged && without.relaxation.converged);
  EXPECT_LT(with.surface.displacement_mm.norm(), 0.9 * without.surface.displacement_mm.norm());
  EXPECT_LT(with.deep.displacement_mm.norm(), without.deep.displacement_mm.norm());
}

std::string shift_refusal(const std::function<void(BrainShiftOptions &)> &spoil) {
  BrainShiftOptions options = standing();
  spoil(options);
  try {
    (void)predict_shift(column(), options);
  } catch (const std::invalid_argument &error) {
    return error.what();
  }
  return "";
}

TEST(BrainShiftRefusals, AreReportedWithTheReason) {
  using O = BrainShiftOptions;
  EXPECT_EQ(shift_refusal([](O &o) { o.gravity.setZero(); }),
            "brain shift: gravity has the length 0.000000, must be a direction");
  EXPECT_EQ(shift_refusal([](O &o) { o.gravity_imaged.x() = NAN; }),
            "brain shift: gravity_imaged has the length nan, must be a direction");
  EXPECT_EQ(shift_refusal([](O &o) { o.fluid_drop_mm = -1.0; }),
            "brain shift: fluid_drop_mm = -1.000000, must not be negative");
  EXPECT_EQ(shift_refusal([](O &o) { o.fluid_kg_m3 = INFINITY; }),
            "brain shift: fluid_kg_m3 = inf, must not be negative");
  EXPECT_EQ(shift_refusal([](O &o) { o.tissue_kg_m3 = -2.0; }),
            "brain shift: tissue_kg_m3 = -2.000000, must not be negative");
  EXPECT_EQ(shift_refusal([](O &o) { o.stem_mm = -4.0; }), "brain shift: stem_mm = -4.000000, must not be negative");
  EXPECT_EQ(shift_refusal([](O &o) { o.deep_mm = -3.0; }), "brain shift: deep_mm = -3.000000, must not be negative");
  EXPECT_EQ(shift_refusal([](O &o) { o.skull.gap_mm = -1.0; }), "skull: gap_mm = -1.000000, must not be negative");
}

} // namespace
} // namespace bregma::tissue
