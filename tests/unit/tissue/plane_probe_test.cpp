// The probe in the plane: forces, deformation of the tissue, and phases.
#include "algorithms/tissue_plane/plane_probe.hpp"

#include <cmath>
#include <numbers>
#include <stdexcept>

#include <gtest/gtest.h>

#include "algorithms/tissue_plane/plane_mesher.hpp"

namespace bregma::tissue_plane {
namespace {

using Eigen::Vector2d;

// A block on sliding supports at its far end, with a middle line prepared for the cut.
struct Block {
  static constexpr double kLength_mm = 20.0;
  static constexpr double kHeight_mm = 30.0;
  PlaneMesh mesh = rectangle_mesh({8, 12}, {kLength_mm, kHeight_mm});
  PlaneSolver solver;

  explicit Block(const tissue::Material &material) : solver(mesh, material) {
    for (int n = 0; n < static_cast<int>(mesh.nodes_mm.size()); ++n) {
      const Vector2d &p = mesh.nodes_mm[static_cast<std::size_t>(n)];
      if (p.x() == kLength_mm) {
        solver.hold(n, 0, 0.0);
      }
      if (p.x() == kLength_mm && p.y() == kHeight_mm / 2.0) {
        solver.hold(n, 1, 0.0);
      }
    }
  }
  [[nodiscard]] std::vector<int> front() const {
    std::vector<int> out;
    for (int n = 0; n < static_cast<int>(mesh.nodes_mm.size()); ++n) {
      if (mesh.nodes_mm[static_cast<std::size_t>(n)].x() == 0.0) {
        out.push_back(n);
      }
    }
    return out;
  }
};

// A flat wall that is much wider than the block.
PlaneProbeSettings wall(double friction) {
  return {.axis_y_mm = Block::kHeight_mm / 2.0,
          .width_mm = 2000.0,
          .nose_mm = 0.01,
          .friction = friction,
          .relax_at_end = {1e-7, 50'000}};
}

TEST(PlaneProbe, AFlatWallWithoutFrictionCompressesABlockEvenly) {
  tissue::Material material;
  material.law = tissue::Law::kLinear;
  Block block(material);
  PlaneProbe probe(block.solver, wall(0.0));
  const ProbeReading reading = probe.move_to(1.0);
  ASSERT_TRUE(reading.rest.valid());
  // Plane strain, free sides: E / (1 - nu^2) times the strain 1 / 20, over 30 mm.
  const double force_N_m = material.young_Pa / (1.0 - 0.45 * 0.45) / 20.0 * 0.030;
  EXPECT_NEAR(reading.tip_N_m, force_N_m, 1e-4 * force_N_m);
  EXPECT_EQ(reading.phase, ProbePhase::kIndentation);
  for (const int n : block.front()) {
    EXPECT_NEAR(block.solver.position_mm(n).x(), 1.0, 1e-4);
    EXPECT_NEAR(block.solver.reaction(n).y(), 0.0, 1e-5 * force_N_m);
  }
}

TEST(PlaneProbe, FrictionHoldsUpToItsShareOfThePressure) {
  for (const double friction : {0.05, 10.0}) {
    Block block(tissue::Material{});
    PlaneProbe probe(block.solver, wall(friction));
    ASSERT_TRUE(probe.move_to(2.0).rest.valid());
    double slid_mm = 0.0;
    for (const int n : block.front()) {
      const Vector2d force = block.solver.reaction(n);
      EXPECT_LE(std::abs(force.y()), 1.001 * friction * force.x() + 1e-6);
      slid_mm = std::max(slid_mm, std::abs(block.solver.displacement_mm(n).y()));
    }
    if (friction > 1.0) {
      EXPECT_LT(slid_mm, 0.01);
    } else {
      EXPECT_GT(slid_mm, 0.3);
      // The corner slides outwards: the force is at most the friction, except after sliding too far and sticking.
      const Vector2d corner_N_m = block.solver.reaction(block.front().front());
      EXPECT_GT(std::abs(corner_N_m.y()), 0.8 * friction * corner_N_m.x());
    }
  }
}

// A disc of tissue, fixed at the skull except within 15 mm of the probe's entry.
struct Disc {
  static constexpr double kRadius_mm = 40.0;
  static constexpr double kAxis_mm = 0.0;
  PlaneMesh mesh;
  PlaneSolver solver;

  Disc() : mesh(make_mesh()), solver(mesh, tissue::Material{}) {
    for (const Eigen::Vector2i &edge : boundary_of(mesh)) {
      if ((mesh.nodes_mm[static_cast<std::size_t>(edge[0])] - Vector2d(-kRadius_mm, kAxis_mm)).norm() > 15.0) {
        solver.hold(edge[0]);
        held.push_back(edge[0]);
      }
    }
  }
  static PlaneMesh make_mesh() {
    Loop circle;
    for (int i = 0; i < 360; ++i) {
      const double angle = 2.0 * std::numbers::pi * i / 360.0;
      circle.emplace_back(kRadius_mm * std::cos(angle), kRadius_mm * std::sin(angle));
    }
    return fill({circle, {}}, {.triangles = 3000, .cut_y_mm = kAxis_mm});
  }
  std::vector<int> held;
};

// Largest penetration of the tissue's surface nodes into the probe, along the shortest way out.
double overlap_mm(const PlaneSolver &solver, double tip_mm, double half_mm, double nose_mm) {
  double out = 0.0;
  for (const Eigen::Vector2i &edge : boundary_of(solver.mesh())) {
    const Vector2d p = solver.position_mm(edge[0]) - Vector2d(tip_mm, Disc::kAxis_mm);
    const double into_nose = std::max(0.0, (p.x() + nose_mm) / nose_mm);
    if (p.x() < 0.0 && into_nose < 1.0) {
      const double side = half_mm * std::sqrt(1.0 - into_nose * into_nose);
      out = std::max(out, std::min(side - std::abs(p.y()), -p.x()));
    }
  }
  return out;
}

TEST(PlaneProbe, IndentsRupturesAndPenetrates) {
  Disc disc;
  constexpr double kRupture_N_m = 8.0;
  PlaneProbe probe(disc.solver, {.axis_y_mm = Disc::kAxis_mm,
                                 .rupture_N_m = kRupture_N_m,
                                 .cutting_fraction = 0.4,
                                 .relax_at_end = {1e-4, 50'000}});
  EXPECT_NEAR(probe.entry_mm(), -Disc::kRadius_mm, 1e-3);
  const auto skull_N_m = [&] {
    double sum = 0.0;
    for (const int n : disc.held) {
      sum -= disc.solver.reaction(n).x();
    }
    return sum;
  };
  const Vector2d ahead(-Disc::kRadius_mm + 25.0, Disc::kAxis_mm);
  const auto stress_ahead = [&] { return disc.solver.stress_at(ahead).von_mises_plane(); };

  double last_N_m = 0.0;
  double last_Pa = 0.0;
  for (const double depth : {1.0, 2.0, 3.0, 4.0}) {
    const ProbeReading reading = probe.move_to(-Disc::kRadius_mm + depth);
    ASSERT_TRUE(reading.rest.valid());
    EXPECT_EQ(reading.phase, ProbePhase::kIndentation);
    EXPECT_GT(reading.tip_N_m, last_N_m);
    EXPECT_GT(stress_ahead(), last_Pa);
    EXPECT_NEAR(reading.tip_N_m + reading.friction_N_m, skull_N_m(), 0.01 * reading.tip_N_m);
    EXPECT_LT(overlap_mm(disc.solver, reading.tip_mm, 3.0, 3.0), 0.05);
    last_N_m = reading.tip_N_m;
    last_Pa = stress_ahead();
  }

  const ProbeReading before = probe.move_to(0.0); // it does not arrive in one call
  ASSERT_EQ(before.phase, ProbePhase::kRupture);
  EXPECT_FALSE(probe.ruptured());
  EXPECT_LT(before.tip_mm, -Disc::kRadius_mm + 15.0);
  EXPECT_GE(before.tip_N_m, kRupture_N_m);
  EXPECT_LT(before.tip_N_m, 1.15 * kRupture_N_m); // one step of half a millimetre beyond
  const double before_Pa = stress_ahead();

  const ProbeReading at = probe.rupture();
  ASSERT_TRUE(at.rest.valid());
  EXPECT_TRUE(probe.ruptured());
  EXPECT_GT(at.cut_mm, 0.0);
  EXPECT_NEAR(at.tip_N_m, 0.4 * before.tip_N_m, 1e-9);
  EXPECT_NEAR(at.plus_N_m + at.minus_N_m, 0.0, 1e-9);
  EXPECT_NEAR(skull_N_m(), at.tip_N_m, 0.02 * at.tip_N_m);
  EXPECT_LT(stress_ahead(), 0.8 * before_Pa);

  ProbeReading reading = probe.open();
  double last_cut_mm = at.cut_mm;
  for (const double further : {0.0, 4.0, 8.0}) {
    reading = probe.move_to(before.tip_mm + further);
    ASSERT_TRUE(reading.rest.valid()) << further;
    EXPECT_EQ(reading.phase, ProbePhase::kPenetration);
    EXPECT_GE(reading.cut_mm, last_cut_mm);
    EXPECT_GT(reading.plus_N_m, 0.5);
    EXPECT_NEAR(reading.plus_N_m, reading.minus_N_m, 0.05 * reading.plus_N_m); // the section is symmetric
    EXPECT_GT(reading.friction_N_m, 0.0);
    EXPECT_LE(reading.friction_N_m, 1.01 * 0.1 * (reading.plus_N_m + reading.minus_N_m));
    EXPECT_NEAR(reading.tip_N_m + reading.friction_N_m, skull_N_m(), 0.05 * reading.tip_N_m);
    EXPECT_LT(overlap_mm(disc.solver, reading.tip_mm, 3.0, 3.0), 0.05);
    last_cut_mm = reading.cut_mm;
  }
  EXPECT_GT(last_cut_mm, at.cut_mm + 4.0);
}

TEST(PlaneProbe, RupturesByStressAsWell) {
  Disc disc;
  PlaneProbe probe(disc.solver, {.axis_y_mm = Disc::kAxis_mm, .rupture_Pa = 800.0});
  const ProbeReading reading = probe.move_to(0.0);
  ASSERT_EQ(reading.phase, ProbePhase::kRupture);
  EXPECT_GE(disc.solver.stress_at({probe.entry_mm() + 1e-9, Disc::kAxis_mm}).von_mises(), 800.0 * 0.999);
  // A further motion ruptures and opens the tissue automatically.
  EXPECT_EQ(probe.move_to(reading.tip_mm + 0.5).phase, ProbePhase::kPenetration);
}

TEST(PlaneProbe, ErrorsAreReported) {
  Disc disc;
  const auto message = [&](const PlaneProbeSettings &settings) -> std::string {
    try {
      const PlaneProbe probe(disc.solver, settings);
    } catch (const std::invalid_argument &error) {
      return error.what();
    }
    return {};
  };
  EXPECT_EQ(message({.axis_y_mm = 1.23}), "plane probe: the mesh has no edges along y = 1.230000 mm");
  EXPECT_EQ(message({.width_mm = 0.0}), "plane probe: width_mm = 0.000000, must be positive");
  EXPECT_EQ(message({.nose_mm = -1.0}), "plane probe: nose_mm = -1.000000, must be positive");
  EXPECT_EQ(message({.friction = -0.1}), "plane probe: friction = -0.100000, must be at least 0");
  EXPECT_EQ(message({.cutting_fraction = 1.5}), "plane probe: cutting_fraction = 1.500000, must be from 0 to 1");
  EXPECT_EQ(message({.step_mm = 0.0}), "plane probe: step_mm = 0.000000, must be positive");
}

} // namespace
} // namespace bregma::tissue_plane
