// Displacement fields of cubic B-splines: what they reproduce, their derivatives, and folds.
#include <random>

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "algorithms/intensity/bspline_field.hpp"

namespace bregma::intensity {
namespace {

using Eigen::Vector3d;

constexpr unsigned kFieldSeed = 20260415;

image::Grid<3> oblique_grid() {
  image::Grid<3> out;
  out.size = {30, 26, 20};
  out.T_image_index.topLeftCorner<3, 3>() << 1.9, 0.3, 0.0, -0.3, 2.0, 0.1, 0.0, 0.0, 2.5;
  out.T_image_index.topRightCorner<3, 1>() = Vector3d(-20.0, -30.0, 5.0);
  return out;
}

BSplineField random_field(double spacing_mm, float size) {
  BSplineField out(oblique_grid(), spacing_mm);
  std::mt19937 rng(kFieldSeed);
  std::normal_distribution<float> normal(0.0F, size);
  for (std::size_t i = 0; i < out.coefficients().size(); ++i) {
    out.coefficients()[i] = i % 4 == 3 ? 0.0F : normal(rng);
  }
  return out;
}

std::vector<Vector3d> some_points() {
  std::vector<Vector3d> out;
  std::mt19937 rng(kFieldSeed);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int n = 0; n < 40; ++n) {
    out.push_back(oblique_grid().point_mm(Vector3d(29.0 * uniform(rng), 25.0 * uniform(rng), 19.0 * uniform(rng))));
  }
  return out;
}

TEST(BSplineField, CoversItsGridAndStartsAtZero) {
  const BSplineField field(oblique_grid(), 20.0, 2);
  EXPECT_EQ(field.cells(), (std::array<int, 3>{4, 4, 4}));
  EXPECT_LE(field.spacing_mm().maxCoeff(), 20.0);
  for (const Vector3d &p : some_points()) {
    EXPECT_EQ(field.displacement_mm(p), Vector3d::Zero());
  }
}

TEST(BSplineField, ReproducesALinearDisplacementWithoutBending) {
  BSplineField field(oblique_grid(), 18.0);
  Eigen::Matrix3d A;
  A << 0.02, -0.01, 0.0, 0.03, 0.01, 0.02, -0.02, 0.0, -0.03;
  const std::array<int, 3> n = field.nodes();
  std::size_t at = 0;
  for (int k = 0; k < n[2]; ++k) {
    for (int j = 0; j < n[1]; ++j) {
      for (int i = 0; i < n[0]; ++i, ++at) {
        const Vector3d index((i - 1) * 29.0 / field.cells()[0], (j - 1) * 25.0 / field.cells()[1],
                             (k - 1) * 19.0 / field.cells()[2]);
        Eigen::Map<Eigen::Vector3f>(field.coefficients().data() + 4 * at) =
            (A * field.grid().point_mm(index)).cast<float>();
      }
    }
  }
  for (const Vector3d &p : some_points()) {
    EXPECT_LT((field.displacement_mm(p) - A * p).norm(), 1e-4);
  }
  std::vector<double> gradient(field.coefficients().size());
  EXPECT_NEAR(field.bending(1.0, gradient), 0.0, 1e-9);
  parallel::Team team(2);
  const double determinant = (Eigen::Matrix3d::Identity() + A).determinant();
  EXPECT_NEAR(field.jacobian(team).smallest, determinant, 1e-4);
  EXPECT_NEAR(field.jacobian(team).largest, std::max(determinant, 1.0), 1e-4);
}

TEST(BSplineField, RefinedIsTheSameField) {
  const BSplineField field = random_field(22.0, 3.0F);
  const BSplineField fine = field.refined();
  EXPECT_EQ(fine.cells()[0], 2 * field.cells()[0]);
  for (const Vector3d &p : some_points()) {
    EXPECT_LT((fine.displacement_mm(p) - field.displacement_mm(p)).norm(), 1e-4);
  }
}

TEST(BSplineField, BendingHasTheGradientOfItsDifferences) {
  BSplineField field = random_field(22.0, 3.0F);
  std::vector<double> gradient(field.coefficients().size());
  const double value = field.bending(2.0, gradient);
  EXPECT_GT(value, 0.0);
  std::vector<double> ignored(gradient.size());
  for (const std::size_t i : {std::size_t{0}, std::size_t{4 * 30 + 1}, std::size_t{4 * 77 + 2}}) {
    const float before = field.coefficients()[i];
    field.coefficients()[i] = before + 0.5F; // the energy is quadratic: exact for any step
    const double up = field.bending(1.0, ignored);
    field.coefficients()[i] = before - 0.5F;
    const double down = field.bending(1.0, ignored);
    field.coefficients()[i] = before;
    EXPECT_NEAR(gradient[i], 2.0 * (up - down), 1e-4 * std::abs(gradient[i]) + 1e-9);
  }
}

TEST(BSplineField, JacobianShowsAFold) {
  parallel::Team team(2);
  EXPECT_GT(random_field(22.0, 1.0F).jacobian(team).smallest, 0.0);
  EXPECT_LT(random_field(22.0, 30.0F).jacobian(team).smallest, 0.0);
}

} // namespace
} // namespace bregma::intensity
