// The plane solver compared with exact solutions.
#include "algorithms/tissue_plane/plane_solver.hpp"

#include <cmath>
#include <functional>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

#include "algorithms/tissue_plane/plane_mesher.hpp"
#include "tests/support/allocation_counter.hpp"

namespace bregma::tissue_plane {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

constexpr unsigned kPlaneSeed = 4;

tissue::Material material_of(tissue::Law law, double poisson = 0.45) {
  tissue::Material out;
  out.name = "test";
  out.law = law;
  out.poisson = poisson;
  out.ogden_alpha = law == tissue::Law::kOgden ? -4.7 : 2.0;
  return out;
}

// A rectangle whose inner nodes are moved at random by up to a third of a cell.
PlaneMesh shaken_rectangle(const Eigen::Vector2i &cells, const Vector2d &size_mm) {
  PlaneMesh mesh = rectangle_mesh(cells, size_mm);
  std::mt19937 rng(kPlaneSeed);
  std::uniform_real_distribution<double> shake(-0.33, 0.33);
  for (Vector2d &p : mesh.nodes_mm) {
    const bool inner = p.x() > 0.0 && p.x() < size_mm.x() && p.y() > 0.0 && p.y() < size_mm.y();
    if (inner) {
      p += Vector2d(shake(rng) * size_mm.x() / cells.x(), shake(rng) * size_mm.y() / cells.y());
    }
  }
  return mesh;
}

std::vector<int> nodes_where(const PlaneMesh &mesh, const std::function<bool(const Vector2d &)> &holds) {
  std::vector<int> out;
  for (std::size_t i = 0; i < mesh.nodes_mm.size(); ++i) {
    if (holds(mesh.nodes_mm[i])) {
      out.push_back(static_cast<int>(i));
    }
  }
  return out;
}

// The law as an energy of principal stretches, as in material.hpp; the exact solutions are derived from it.
double energy(const tissue::Material &m, double l1, double l2, double l3) {
  const double j = l1 * l2 * l3;
  const double a = m.law == tissue::Law::kOgden ? m.ogden_alpha : 2.0;
  const double shear = 2.0 * m.shear_Pa() / (a * a) *
                       (std::pow(j, -a / 3.0) * (std::pow(l1, a) + std::pow(l2, a) + std::pow(l3, a)) - 3.0);
  return shear + 0.5 * m.bulk_Pa() * (j - 1.0) * (j - 1.0);
}

double slope(const std::function<double(double)> &f, double at) {
  constexpr double kStep = 1e-5;
  return (f(at + kStep) - f(at - kStep)) / (2.0 * kStep);
}

double bisect(const std::function<double(double)> &f, double low, double high) {
  for (int k = 0; k < 100; ++k) {
    const double middle = 0.5 * (low + high);
    ((f(middle) > 0.0) == (f(high) > 0.0) ? high : low) = middle;
  }
  return 0.5 * (low + high);
}

struct Case {
  tissue::Law law;
  PlaneState state;
};

class PlanePatch : public testing::TestWithParam<Case> {};

TEST_P(PlanePatch, AnEvenStrainOfTheBoundaryIsEvenWithin) {
  const auto [law, state] = GetParam();
  const PlaneMesh mesh = shaken_rectangle({7, 6}, {70.0, 50.0});
  const Matrix2d f = law == tissue::Law::kLinear ? (Matrix2d() << 1.01, 0.02, -0.01, 0.99).finished()
                                                 : (Matrix2d() << 1.2, 0.3, -0.1, 0.85).finished();
  PlaneSolver solver(mesh, material_of(law), {.state = state});
  for (const Eigen::Vector2i &edge : boundary_of(mesh)) {
    const Vector2d &p = mesh.nodes_mm[static_cast<std::size_t>(edge[0])];
    solver.hold(edge[0], f * p - p);
  }
  ASSERT_TRUE(solver.relax({.tolerance = 1e-9}).valid());
  for (std::size_t n = 0; n < mesh.nodes_mm.size(); ++n) {
    EXPECT_LT((solver.position_mm(static_cast<int>(n)) - f * mesh.nodes_mm[n]).norm(), 1e-6) << n;
  }
  const PlaneStress first = solver.stress(0);
  for (std::size_t e = 1; e < mesh.triangles.size(); ++e) {
    const PlaneStress s = solver.stress(static_cast<int>(e));
    EXPECT_NEAR(s.xx_Pa, first.xx_Pa, 1e-5);
    EXPECT_NEAR(s.yy_Pa, first.yy_Pa, 1e-5);
    EXPECT_NEAR(s.xy_Pa, first.xy_Pa, 1e-5);
    EXPECT_NEAR(s.zz_Pa, state == PlaneState::kStress ? 0.0 : first.zz_Pa, 1e-5);
  }
}

INSTANTIATE_TEST_SUITE_P(LawsAndStates, PlanePatch,
                         testing::Values(Case{tissue::Law::kNeoHookean, PlaneState::kStrain},
                                         Case{tissue::Law::kNeoHookean, PlaneState::kStress},
                                         Case{tissue::Law::kOgden, PlaneState::kStrain},
                                         Case{tissue::Law::kOgden, PlaneState::kStress},
                                         Case{tissue::Law::kLinear, PlaneState::kStrain},
                                         Case{tissue::Law::kLinear, PlaneState::kStress}));

class PlaneUniaxial : public testing::TestWithParam<Case> {};

TEST_P(PlaneUniaxial, ABarWithFreeSidesMatchesItsEnergy) {
  const auto [law, state] = GetParam();
  const tissue::Material material = material_of(law);
  constexpr double kLength_mm = 20.0; // short, so that it does not buckle
  constexpr double kHeight_mm = 40.0;
  const PlaneMesh mesh = shaken_rectangle({4, 8}, {kLength_mm, kHeight_mm});
  for (const double stretch : {0.7, 0.9, 1.3}) {
    // The lateral stretch that minimizes the energy; in plane stress the thickness has the same stretch.
    const bool thick = state == PlaneState::kStrain;
    const auto at_side = [&](double l2) { return energy(material, stretch, l2, thick ? 1.0 : l2); };
    const double side = bisect([&](double l2) { return slope(at_side, l2); }, 0.5, 2.0);
    const double across = thick ? 1.0 : side;
    const double end_Pa = slope([&](double l1) { return energy(material, l1, side, across); }, stretch);

    PlaneSolver solver(mesh, material, {.state = state});
    const auto left = nodes_where(mesh, [](const Vector2d &p) { return p.x() == 0.0; });
    const auto right = nodes_where(mesh, [&](const Vector2d &p) { return p.x() == kLength_mm; });
    for (const int n : left) {
      solver.hold(n, 0, 0.0);
    }
    solver.hold(left.front(), 1, 0.0);
    solver.hold(right.front(), 1, 0.0); // prevents swaying, which has almost no stiffness under compression
    for (const int n : right) {
      solver.hold(n, 0, (stretch - 1.0) * kLength_mm);
    }
    ASSERT_TRUE(solver.relax({.tolerance = 1e-9}).valid()) << stretch;
    double force_N_m = 0.0;
    for (const int n : right) {
      force_N_m += solver.reaction(n).x();
    }
    EXPECT_NEAR(force_N_m, end_Pa * 1e-3 * kHeight_mm, 1e-5 * std::abs(end_Pa) * 1e-3 * kHeight_mm) << stretch;
    const PlaneStress s = solver.stress_at({13.0, 7.0});
    EXPECT_NEAR(s.xx_Pa, end_Pa / (side * across), 1e-5 * std::abs(end_Pa)) << stretch;
    EXPECT_NEAR(s.yy_Pa, 0.0, 1e-4 * std::abs(end_Pa)) << stretch;
    EXPECT_NEAR(solver.position_mm(right.back()).y() - solver.position_mm(right.front()).y(), side * kHeight_mm, 1e-4);
  }
}

INSTANTIATE_TEST_SUITE_P(LawsAndStates, PlaneUniaxial,
                         testing::Values(Case{tissue::Law::kNeoHookean, PlaneState::kStrain},
                                         Case{tissue::Law::kNeoHookean, PlaneState::kStress},
                                         Case{tissue::Law::kOgden, PlaneState::kStrain},
                                         Case{tissue::Law::kOgden, PlaneState::kStress}));

TEST(PlaneSolver, SimpleShearMatchesRivlin) {
  const PlaneMesh mesh = shaken_rectangle({6, 6}, {30.0, 30.0});
  constexpr double kShear = 0.8;
  // Principal stretches l and 1/l with l - 1/l = gamma; the larger's axis is at atan(1/l) to the layers.
  const double l = 0.5 * (kShear + std::sqrt(kShear * kShear + 4.0));
  for (const tissue::Law law : {tissue::Law::kNeoHookean, tissue::Law::kOgden}) {
    const tissue::Material material = material_of(law, 0.49);
    PlaneSolver solver(mesh, material);
    for (const Eigen::Vector2i &edge : boundary_of(mesh)) {
      solver.hold(edge[0], {kShear * mesh.nodes_mm[static_cast<std::size_t>(edge[0])].y(), 0.0});
    }
    ASSERT_TRUE(solver.relax({.tolerance = 1e-9}).valid());
    const double a = law == tissue::Law::kOgden ? material.ogden_alpha : 2.0;
    const double difference = 2.0 * material.shear_Pa() / a * (std::pow(l, a) - std::pow(l, -a)); // sigma_1 - sigma_2
    const double angle = std::atan(1.0 / l);
    const PlaneStress s = solver.stress_at({11.0, 17.0});
    EXPECT_NEAR(s.xy_Pa, 0.5 * difference * std::sin(2.0 * angle), 1e-4);
    EXPECT_NEAR(s.xx_Pa - s.yy_Pa, difference * std::cos(2.0 * angle), 1e-4);
    EXPECT_NEAR(s.xx_Pa + s.yy_Pa + s.zz_Pa, 0.0, 1e-3);
  }
}

// [Timoshenko 1951, section 21]: a cantilever under a parabolic shear at its end. The root is displaced as in the exact
// solution. Returns the relative error of the end's deflection.
double cantilever_error(double poisson, int cells_high) {
  constexpr double kL = 48.0;
  constexpr double kD = 12.0;
  constexpr double kP = 1e-4; // N/m
  tissue::Material material = material_of(tissue::Law::kLinear, poisson);
  const double young = material.young_Pa / (1.0 - poisson * poisson); // plane strain
  const double nu = poisson / (1.0 - poisson);
  const double inertia_mm3 = kD * kD * kD / 12.0;
  const double scale = kP / (6.0 * young * inertia_mm3) * 1e3; // P in N/m: mm of displacement
  const auto exact = [&](const Vector2d &p) -> Vector2d {
    const double x = p.x();
    const double y = p.y() - kD / 2.0;
    return {scale * y * ((6.0 * kL - 3.0 * x) * x + (2.0 + nu) * (y * y - kD * kD / 4.0)),
            -scale * (3.0 * nu * y * y * (kL - x) + (4.0 + 5.0 * nu) * kD * kD * x / 4.0 + (3.0 * kL - x) * x * x)};
  };
  const PlaneMesh mesh = rectangle_mesh({4 * cells_high, cells_high}, {kL, kD});
  PlaneSolver solver(mesh, material);
  for (const int n : nodes_where(mesh, [](const Vector2d &p) { return p.x() == 0.0; })) {
    solver.hold(n, exact(mesh.nodes_mm[static_cast<std::size_t>(n)]));
  }
  const double h = kD / cells_high;
  const auto end = nodes_where(mesh, [](const Vector2d &p) { return p.x() == kL; });
  for (const int n : end) {
    // The parabola -P/(2 I) (D^2/4 - y^2) times the node's hat function, integrated over both edges (Simpson: exact).
    double force = 0.0;
    const double y = mesh.nodes_mm[static_cast<std::size_t>(n)].y() - kD / 2.0;
    const auto traction = [&](double at) { return -kP / (2.0 * inertia_mm3) * (kD * kD / 4.0 - at * at); };
    for (const double sign : {-1.0, 1.0}) {
      if (std::abs(y + sign * h) < kD / 2.0 + 1e-9) {
        force += h / 6.0 * (traction(y) + 4.0 * 0.5 * traction(y + 0.5 * sign * h));
      }
    }
    solver.set_force(n, {0.0, force});
  }
  EXPECT_TRUE(solver.relax({.tolerance = 1e-6, .max_steps = 400'000}).valid());
  double moved = 0.0;
  double wanted = 0.0;
  for (const int n : end) {
    moved += solver.displacement_mm(n).y();
    wanted += exact(mesh.nodes_mm[static_cast<std::size_t>(n)]).y();
  }
  return std::abs(moved / wanted - 1.0);
}

TEST(PlaneSolver, ACantileverBendsWithoutLocking) {
  for (const double poisson : {0.45, 0.49, 0.499}) {
    EXPECT_LT(cantilever_error(poisson, 8), 0.05) << "nu " << poisson;
  }
}

TEST(PlaneSolver, ACantileverConvergesWithTheSquareOfTheEdge) {
  const double coarse = cantilever_error(0.45, 4);
  const double fine = cantilever_error(0.45, 8);
  EXPECT_GT(std::log2(coarse / fine), 1.6) << coarse << " and " << fine;
}

// A quarter of a tube under inner pressure, inner radius 10, outer 20 mm.
struct Tube {
  PlaneMesh mesh;
  std::vector<Eigen::Vector2i> inner;
  int inner_node = 0; // at (10, 0)
};

Tube tube_of(int cells) {
  Tube out;
  out.mesh = rectangle_mesh({cells, 2 * cells}, {1.0, 1.0});
  for (Vector2d &p : out.mesh.nodes_mm) {
    const double r = 10.0 + 10.0 * p.x();
    const double angle = p.y() * M_PI / 2.0;
    // Coordinates on the planes of symmetry are exactly 0, so that their nodes can be found.
    p = {p.y() == 1.0 ? 0.0 : r * std::cos(angle), p.y() == 0.0 ? 0.0 : r * std::sin(angle)};
  }
  for (const Eigen::Vector2i &edge : boundary_of(out.mesh)) {
    const auto near = [&](int n) { return out.mesh.nodes_mm[static_cast<std::size_t>(n)].norm() < 10.0 + 1e-9; };
    if (near(edge[0]) && near(edge[1])) {
      out.inner.push_back(edge);
    }
  }
  out.inner_node = nodes_where(out.mesh, [](const Vector2d &p) { return p.norm() < 10.01 && p.y() == 0.0; }).front();
  return out;
}

void hold_symmetry(PlaneSolver &solver) {
  for (const int n : nodes_where(solver.mesh(), [](const Vector2d &p) { return p.x() == 0.0; })) {
    solver.hold(n, 0, 0.0);
  }
  for (const int n : nodes_where(solver.mesh(), [](const Vector2d &p) { return p.y() == 0.0; })) {
    solver.hold(n, 1, 0.0);
  }
}

TEST(PlaneSolver, AThickTubeMatchesLame) {
  const Tube tube = tube_of(12);
  const tissue::Material material = material_of(tissue::Law::kLinear, 0.49);
  constexpr double kPressure_Pa = 10.0;
  PlaneSolver solver(tube.mesh, material, {.follower = false});
  hold_symmetry(solver);
  solver.set_pressure(tube.inner, kPressure_Pa);
  ASSERT_TRUE(solver.relax({.tolerance = 1e-7, .max_steps = 200'000}).valid());
  // u(r) = (1 + nu) / E  p a^2 / (b^2 - a^2) ((1 - 2 nu) r + b^2 / r)
  const double u =
      (1.0 + 0.49) / material.young_Pa * kPressure_Pa * 100.0 / 300.0 * ((1.0 - 0.98) * 10.0 + 400.0 / 10.0);
  EXPECT_NEAR(solver.displacement_mm(tube.inner_node).x(), u, 0.01 * u);
  // Midway, hoop: p a^2 / (b^2 - a^2) (1 + b^2 / r^2); radial: with a minus.
  const PlaneStress s = solver.stress_at({15.0 * std::cos(0.6), 15.0 * std::sin(0.6)});
  const double hoop = kPressure_Pa / 3.0 * (1.0 + 400.0 / 225.0);
  const double radial = kPressure_Pa / 3.0 * (1.0 - 400.0 / 225.0);
  const double across = 0.49 * (hoop + radial);
  EXPECT_NEAR(s.xx_Pa + s.yy_Pa, hoop + radial, 0.02 * hoop);
  EXPECT_NEAR(s.von_mises_plane(), std::sqrt(hoop * hoop + radial * radial - hoop * radial), 0.01 * hoop);
  EXPECT_NEAR(s.von_mises(),
              std::sqrt(0.5 * (std::pow(hoop - radial, 2) + std::pow(radial - across, 2) + std::pow(across - hoop, 2))),
              0.01 * hoop);
}

TEST(PlaneSolver, AThickTubeAtLargeStrainMatchesRivlin) {
  const Tube tube = tube_of(12);
  const tissue::Material material = material_of(tissue::Law::kNeoHookean, 0.499);
  // Incompressible: r^2 - R^2 is the same for all R; p = mu int (l^2 - l^-2) dr / r with l = r / R.
  constexpr double kInner_mm = 13.0;
  const double swept = kInner_mm * kInner_mm - 100.0;
  constexpr int kSlices = 2000;
  double pressure_Pa = 0.0;
  for (int i = 0; i < kSlices; ++i) {
    const double big_r = 10.0 + 10.0 * (i + 0.5) / kSlices;
    const double r2 = big_r * big_r + swept;
    const double l2 = r2 / (big_r * big_r);
    pressure_Pa += material.shear_Pa() * (l2 - 1.0 / l2) * big_r / r2 * 10.0 / kSlices;
  }
  PlaneSolver solver(tube.mesh, material); // the pressure follows the deformed wall
  hold_symmetry(solver);
  PlaneRelaxationResult last;
  for (const double share : {0.5, 1.0}) {
    solver.set_pressure(tube.inner, share * pressure_Pa);
    last = solver.relax({.tolerance = 1e-6, .max_steps = 400'000});
  }
  ASSERT_TRUE(last.valid());
  EXPECT_NEAR(solver.position_mm(tube.inner_node).x(), kInner_mm, 0.01 * (kInner_mm - 10.0));
}

TEST(PlaneSolver, AnInvertedTriangleRecovers) {
  PlaneMesh mesh = rectangle_mesh({4, 4}, {40.0, 40.0});
  PlaneSolver solver(mesh, material_of(tissue::Law::kNeoHookean));
  for (const Eigen::Vector2i &edge : boundary_of(mesh)) {
    solver.hold(edge[0]);
  }
  const int middle = nodes_where(mesh, [](const Vector2d &p) { return p == Vector2d(20.0, 20.0); }).front();
  solver.displace(middle, {17.0, 3.0}); // beyond its neighbours
  const PlaneRelaxationResult relaxation = solver.relax({.tolerance = 1e-6});
  EXPECT_TRUE(relaxation.valid());
  EXPECT_LT(solver.displacement_mm(middle).norm(), 1e-3);
}

TEST(PlaneSolver, ASplitNodeOpensUnderTension) {
  // Two adjacent cells under tension. The triangles to the right of the middle get separate nodes, and the left cell
  // recoils.
  const PlaneMesh mesh = rectangle_mesh({2, 1}, {20.0, 10.0});
  PlaneSolver solver(mesh, material_of(tissue::Law::kNeoHookean));
  for (const int n : nodes_where(mesh, [](const Vector2d &p) { return p.x() == 0.0; })) {
    solver.hold(n);
  }
  for (const int n : nodes_where(mesh, [](const Vector2d &p) { return p.x() == 20.0; })) {
    solver.hold(n, {4.0, 0.0});
  }
  ASSERT_TRUE(solver.relax().valid());
  for (const int n : nodes_where(mesh, [](const Vector2d &p) { return p.x() == 10.0; })) {
    EXPECT_GT(solver.displacement_mm(n).x(), 1.0);
    const int fresh = solver.split(n, std::vector<int>{2, 3});
    EXPECT_EQ(solver.displacement_mm(fresh), solver.displacement_mm(n));
  }
  ASSERT_TRUE(solver.relax().valid());
  EXPECT_NEAR(solver.stress(0).von_mises(), 0.0, 0.1);
  EXPECT_NEAR(solver.stress(2).von_mises(), 0.0, 0.1);
  EXPECT_NEAR(solver.displacement_mm(1).x(), 0.0, 1e-3);
}

TEST(PlaneSolver, StepsDoNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer counts allocations itself";
  }
  const PlaneMesh mesh = shaken_rectangle({8, 8}, {40.0, 40.0});
  for (const PlaneState state : {PlaneState::kStrain, PlaneState::kStress}) {
    PlaneSolver solver(mesh, material_of(tissue::Law::kOgden), {.state = state});
    for (const Eigen::Vector2i &edge : boundary_of(mesh)) {
      solver.hold(edge[0], {0.1 * mesh.nodes_mm[static_cast<std::size_t>(edge[0])].y(), 0.0});
    }
    const test::AllocationScope scope;
    const PlaneRelaxationResult relaxation = solver.relax();
    EXPECT_EQ(scope.count(), 0U);
    EXPECT_TRUE(relaxation.valid());
  }
}

TEST(PlaneSolver, ErrorsAreReported) {
  const PlaneMesh mesh = rectangle_mesh({1, 1}, {1.0, 1.0});
  try {
    const PlaneSolver solver(mesh, tissue::Material{}, {.shear_fraction = 0.0});
    FAIL();
  } catch (const std::invalid_argument &e) {
    EXPECT_STREQ(e.what(), "shear_fraction = 0.000000, must be above 0 and at most 1");
  }
  try {
    (void)PlaneSolver(mesh, tissue::Material{}).stress_at({2.0, 0.5});
    FAIL();
  } catch (const std::invalid_argument &e) {
    EXPECT_STREQ(e.what(), "stress_at: (2.000000, 0.500000) mm is outside the mesh");
  }
}

} // namespace
} // namespace bregma::tissue_plane
