#include <cmath>

#include <gtest/gtest.h>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using geometry::Matrix3d;
using geometry::Vector3d;
using uncertainty::chi_square_survival;
using uncertainty::chi_square_upper_quantile;
constexpr unsigned kUncertaintySeed = 20260205;

// Abramowitz & Stegun, table 26.8, and the closed form for two degrees of freedom.
TEST(ChiSquare, QuantilesOfTheTables) {
  EXPECT_NEAR(chi_square_upper_quantile(0.05, 1), 3.84146, 1e-5);
  EXPECT_NEAR(chi_square_upper_quantile(0.05, 3), 7.81473, 1e-5);
  EXPECT_NEAR(chi_square_upper_quantile(0.01, 10), 23.20925, 1e-5);
  EXPECT_NEAR(chi_square_upper_quantile(0.001, 18), 42.31240, 1e-5);
  EXPECT_NEAR(chi_square_upper_quantile(0.95, 30), 18.49266, 1e-5);
  EXPECT_NEAR(chi_square_upper_quantile(0.5, 100), 99.33413, 1e-5);
  EXPECT_NEAR(chi_square_survival(7.0, 2), std::exp(-3.5), 1e-15);
  EXPECT_NEAR(chi_square_survival(1e-4, 3), 1.0, 1e-6);
}

TEST(ChiSquare, EndsAndExtremesAreDefined) {
  EXPECT_EQ(chi_square_survival(0.0, 3), 1.0);
  EXPECT_EQ(chi_square_survival(-1.0, 3), 1.0);
  EXPECT_EQ(chi_square_survival(std::numeric_limits<double>::infinity(), 3), 0.0);
  EXPECT_TRUE(std::isnan(chi_square_survival(std::nan(""), 3)));
  EXPECT_NEAR(chi_square_survival(186.0, 186), 0.4862, 1e-3); // 64 fiducials
  EXPECT_LT(chi_square_survival(1e5, 186), 1e-300);
  for (const int dof : {1, 2, 3, 6, 45, 186}) {
    for (const double tail : {1e-6, 0.01, 0.5, 0.99}) {
      EXPECT_NEAR(chi_square_survival(chi_square_upper_quantile(tail, dof), dof) / tail, 1.0, 1e-7);
    }
  }
}

TEST(Distributions, OtherTablesAndFractionsOfADegree) {
  EXPECT_NEAR(uncertainty::normal_quantile(0.95), 1.64485, 1e-5);
  EXPECT_NEAR(uncertainty::normal_quantile(0.25), -0.67449, 1e-5);
  // 3 x 15 / 13 times the tabulated 95 % point of F with 3 and 13 degrees of freedom, 3.4105.
  EXPECT_NEAR(uncertainty::hotelling_upper_quantile(0.05, 3, 15), 11.8057, 1e-3);
  const double between = chi_square_upper_quantile(0.05, 2.5);
  EXPECT_GT(between, chi_square_upper_quantile(0.05, 2));
  EXPECT_LT(between, chi_square_upper_quantile(0.05, 3));
}

TEST(Distributions, OutsideTheDomainIsNaNAndNothingThrows) {
  for (const double tail : {-0.1, 0.0, 1.0, 1.1, std::nan("")}) {
    EXPECT_TRUE(std::isnan(chi_square_upper_quantile(tail, 3))) << tail;
    EXPECT_TRUE(std::isnan(uncertainty::normal_quantile(tail))) << tail;
    EXPECT_TRUE(std::isnan(uncertainty::hotelling_upper_quantile(tail, 3, 15))) << tail;
  }
  EXPECT_TRUE(std::isnan(chi_square_survival(1.0, 0)));
  EXPECT_TRUE(std::isnan(chi_square_upper_quantile(0.05, -1)));
  EXPECT_TRUE(std::isnan(uncertainty::hotelling_upper_quantile(0.05, 3, 2)));
}

TEST(Distributions, DoNotAllocate) {
  double sum = 0.0;
  const test::AllocationScope scope;
  for (const double dof : {1.0, 2.4, 3.0, 186.0}) {
    for (const double tail : {1e-12, 0.05, 0.999}) {
      sum += chi_square_survival(chi_square_upper_quantile(tail, dof), dof) + uncertainty::normal_quantile(tail);
      sum += uncertainty::hotelling_upper_quantile(tail, dof, dof + 5.0);
    }
  }
  EXPECT_EQ(scope.count(), 0U);
  EXPECT_TRUE(std::isfinite(sum));
}

TEST(Ellipsoid95, AxesAreLongestFirstAndRebuildTheCovariance) {
  std::mt19937 rng(kUncertaintySeed);
  for (int run = 0; run < 200; ++run) {
    const Matrix3d C = test::random_anisotropic(rng, 0.4, 1.1) + test::random_anisotropic(rng, 0.1, 0.6);
    const auto e = uncertainty::ellipsoid_95(C);
    EXPECT_GE(e.semi_axes_mm[0], e.semi_axes_mm[1]);
    EXPECT_GE(e.semi_axes_mm[1], e.semi_axes_mm[2]);
    EXPECT_NEAR(e.axes.determinant(), 1.0, 1e-12);
    const Vector3d variances = e.semi_axes_mm.cwiseAbs2() / uncertainty::chi_square_upper_quantile(0.05, 3);
    EXPECT_TRUE((e.axes.transpose() * variances.asDiagonal() * e.axes).isApprox(C, 1e-10))
        << "seed " << kUncertaintySeed;
    // A point at the end of an axis is on the boundary.
    const Vector3d end = e.semi_axes_mm[0] * e.axes.row(0).transpose();
    EXPECT_NEAR(uncertainty::mahalanobis_squared(C, end), uncertainty::chi_square_upper_quantile(0.05, 3), 1e-9);
  }
}

TEST(Ellipsoid95, ContainsNinetyFivePercent) {
  std::mt19937 rng(kUncertaintySeed);
  const Matrix3d C = test::random_anisotropic(rng, 0.3, 0.9);
  int inside = 0;
  constexpr int kDraws = 20'000;
  for (int i = 0; i < kDraws; ++i) {
    inside += uncertainty::mahalanobis_squared(C, test::draw(rng, C)) <= uncertainty::chi_square_upper_quantile(0.05, 3)
                  ? 1
                  : 0;
  }
  EXPECT_NEAR(100.0 * inside / kDraws, 95.0, 0.6);
}

TEST(Ellipsoid95, NaNIsKeptAndSingularIsInfinite) {
  EXPECT_TRUE(uncertainty::ellipsoid_95(Matrix3d::Constant(std::nan(""))).semi_axes_mm.hasNaN());
  const Matrix3d flat = Vector3d(1.0, 1.0, 0.0).asDiagonal();
  EXPECT_TRUE(std::isinf(uncertainty::mahalanobis_squared(flat, Vector3d::UnitZ())));
  EXPECT_NEAR(uncertainty::mahalanobis_squared(flat, Vector3d::UnitX()), 1.0, 1e-12);
  EXPECT_EQ(uncertainty::ellipsoid_95(flat).semi_axes_mm[2], 0.0);
}

// The covariance of the maximum likelihood estimate must agree with Fitzpatrick's independently derived closed form
// where that is valid.
TEST(Tre, AgreesWithFitzpatrickForIsotropicErrors) {
  std::mt19937 rng(kUncertaintySeed);
  for (const int count : {3, 4, 8, 30}) {
    for (int run = 0; run < 20; ++run) {
      std::vector<Vector3d> fiducials;
      std::vector<registration::PointPair> pairs;
      const double sigma = 0.4;
      const auto T = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
      for (int i = 0; i < count; ++i) {
        const Vector3d p = test::normal_vector(rng, 60.0);
        fiducials.push_back(p);
        pairs.push_back({T.inverse() * p, p, Matrix3d::Zero(), sigma * sigma * Matrix3d::Identity()});
      }
      const Vector3d target = test::normal_vector(rng, 60.0);
      const auto fit = registration::fit_paired(pairs);
      ASSERT_TRUE(fit.converged);
      const double ours = uncertainty::rms_mm(uncertainty::tre_covariance(fit.covariance, target));
      const double theirs = uncertainty::fitzpatrick_tre_rms_mm(fiducials, target, sigma * std::sqrt(3.0));
      EXPECT_NEAR(ours / theirs, 1.0, 1e-9) << count << " fiducials, run " << run << ", seed " << kUncertaintySeed;
      EXPECT_NEAR(fit.fre_expected_mm, uncertainty::expected_fre_rms_mm(count, sigma * std::sqrt(3.0)), 1e-9);
    }
  }
}

TEST(Tre, FitzpatrickNeedsThreePointsOffALine) {
  const std::vector<Vector3d> line = {{0, 0, 0}, {10, 0, 0}, {20, 0, 0}, {40, 0, 0}};
  EXPECT_TRUE(std::isnan(uncertainty::fitzpatrick_tre_rms_mm(line, {0, 10, 0}, 1.0)));
  EXPECT_TRUE(std::isnan(uncertainty::fitzpatrick_tre_rms_mm(std::span(line).first(2), {0, 10, 0}, 1.0)));
  EXPECT_TRUE(std::isnan(uncertainty::expected_fre_rms_mm(2, 1.0)));
}

} // namespace
