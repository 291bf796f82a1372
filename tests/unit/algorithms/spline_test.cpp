// Thin-plate splines, their grid, and registration of points and curves.
#include <cmath>
#include <random>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "algorithms/registration/splines/curves.hpp"
#include "algorithms/registration/splines/spline_grid.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/algorithms/tables.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
using geometry::Points;
using geometry::Points2;
using geometry::Points3;
constexpr unsigned kSplineSeed = 20260311;

template <int D> Points<D> box_cloud(std::mt19937 &rng, Eigen::Index count, double half_mm = 100.0) {
  std::uniform_real_distribution<double> side(-half_mm, half_mm);
  return Points<D>::NullaryExpr(D, count, [&] { return side(rng); });
}

// A smooth deformation of some millimetres.
template <int D> Points<D> bent(const Points<D> &p) {
  Points<D> out = p;
  for (Eigen::Index i = 0; i < p.cols(); ++i) {
    for (int d = 0; d < D; ++d) {
      out(d, i) += 4.0 * std::sin(p((d + 1) % D, i) / 35.0 + d) * std::cos(p(d, i) / 60.0);
    }
  }
  return out;
}

SplineOptions with(SplineKernel kernel) {
  SplineOptions out;
  out.kernel = kernel;
  return out;
}
constexpr std::array kKernels = {SplineKernel::kR2LogR, SplineKernel::kR};

template <int D> void check_affine_and_interpolation() {
  std::mt19937 rng(kSplineSeed);
  for (const SplineKernel kernel : kKernels) {
    const Points<D> centres = box_cloud<D>(rng, 60).colwise() + Eigen::Matrix<double, D, 1>::Constant(500.0);
    const Points<D> elsewhere = box_cloud<D>(rng, 50, 200.0).colwise() + Eigen::Matrix<double, D, 1>::Constant(500.0);
    const Eigen::Matrix<double, D, D> A = Eigen::Matrix<double, D, D>::Random();
    const auto affine = ThinPlateSpline<D>::fit(centres, (A * centres).colwise() + A.col(0), with(kernel));
    ASSERT_TRUE(affine) << affine.error();
    EXPECT_LT((affine->map(elsewhere) - ((A * elsewhere).colwise() + A.col(0))).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT((affine->jacobian(elsewhere.col(0)) - A).norm(), 1e-10);

    const auto spline = ThinPlateSpline<D>::fit(centres, bent<D>(centres), with(kernel));
    ASSERT_TRUE(spline) << spline.error();
    EXPECT_LT((spline->map(centres) - bent<D>(centres)).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LT(((*spline)(elsewhere.col(7)) - spline->map(elsewhere).col(7)).norm(), 1e-9);
    // The Jacobian compared with finite differences.
    const Eigen::Matrix<double, D, 1> p = elsewhere.col(3);
    for (int d = 0; d < D; ++d) {
      const Eigen::Matrix<double, D, 1> h = 1e-4 * Eigen::Matrix<double, D, 1>::Unit(d);
      EXPECT_LT((((*spline)(p + h) - (*spline)(p - h)) / 2e-4 - spline->jacobian(p).col(d)).norm(), 1e-6);
    }
  }
}

TEST(ThinPlateSpline, ReproducesAffineMapsAndInterpolates) {
  check_affine_and_interpolation<2>();
  check_affine_and_interpolation<3>();
}

TEST(ThinPlateSpline, TheInverseIsConsistent) {
  std::mt19937 rng(kSplineSeed);
  for (const SplineKernel kernel : kKernels) {
    const Points3 centres = box_cloud<3>(rng, 80);
    const auto spline = ThinPlateSpline<3>::fit(centres, bent<3>(centres), with(kernel));
    ASSERT_TRUE(spline);
    const Points3 probes = box_cloud<3>(rng, 40, 80.0);
    for (Eigen::Index i = 0; i < probes.cols(); ++i) {
      const auto back = spline->inverse((*spline)(probes.col(i)));
      ASSERT_TRUE(back) << "probe " << i << " seed " << kSplineSeed;
      EXPECT_LT((*back - probes.col(i)).norm(), 1e-5);
    }
  }
  // A folded map has no inverse.
  const Points2 centres = (Points2(2, 6) << 0, 100, 0, 100, 40, 60, 0, 0, 100, 100, 50, 50).finished();
  Points2 folded = centres;
  folded.col(4).swap(folded.col(5));
  const auto spline = ThinPlateSpline<2>::fit(centres, folded);
  ASSERT_TRUE(spline);
  EXPECT_FALSE(spline->inverse(Eigen::Vector2d(50.0, 50.0)).has_value());
}

TEST(ThinPlateSpline, IsEquivariantOnBothSides) {
  std::mt19937 rng(kSplineSeed);
  const Points3 centres = box_cloud<3>(rng, 70);
  const Points3 probes = box_cloud<3>(rng, 20);
  const Eigen::Matrix3d R = test::random_rotation(rng).toRotationMatrix();
  const Eigen::Matrix3d S = test::random_rotation(rng).toRotationMatrix();
  const Eigen::Vector3d a(200.0, -30.0, 1000.0);
  for (const SplineKernel kernel : kKernels) {
    SplineOptions options = with(kernel);
    options.regularisation = 3.0;
    const auto spline = ThinPlateSpline<3>::fit(centres, bent<3>(centres), options);
    const auto moved =
        ThinPlateSpline<3>::fit((R * centres).colwise() + a, (S * bent<3>(centres)).colwise() - a, options);
    ASSERT_TRUE(spline && moved);
    const Points3 expected = (S * spline->map(probes)).colwise() - a;
    EXPECT_LT((moved->map((R * probes).colwise() + a) - expected).cwiseAbs().maxCoeff(), 1e-8);
    // The seeds' kernel |.|^2 log |.|^2 and another unit of length (metres) give the same spline.
    options.regularisation *= kernel == SplineKernel::kR2LogR ? 1e-6 : 1e-3;
    const auto metres = ThinPlateSpline<3>::fit(1e-3 * centres, 1e-3 * bent<3>(centres), options);
    ASSERT_TRUE(metres);
    EXPECT_LT((1e3 * metres->map(1e-3 * probes) - spline->map(probes)).cwiseAbs().maxCoeff(), 1e-8);
  }
}

TEST(ThinPlateSpline, LeaveOneOutMatchesAFitWithoutTheCentre) {
  std::mt19937 rng(kSplineSeed);
  const Points3 centres = box_cloud<3>(rng, 30);
  for (const SplineKernel kernel : kKernels) {
    for (const double lambda : {0.0, 5.0}) {
      SplineOptions options = with(kernel);
      options.regularisation = lambda;
      options.leave_one_out = true;
      const auto all = ThinPlateSpline<3>::fit(centres, bent<3>(centres), options);
      ASSERT_TRUE(all);
      const auto rest = ThinPlateSpline<3>::fit(centres.rightCols(29), bent<3>(centres).rightCols(29), options);
      ASSERT_TRUE(rest);
      const double really = ((*rest)(centres.col(0)) - bent<3>(centres).col(0)).norm();
      EXPECT_NEAR(all->leave_one_out_mm()[0], really, 1e-8 * really);
    }
  }
}

TEST(ThinPlateSpline, RegularisationTradesFitForSmoothness) {
  std::mt19937 rng(kSplineSeed);
  const Points2 centres = box_cloud<2>(rng, 100);
  Points2 noisy = bent<2>(centres);
  for (Eigen::Index i = 0; i < noisy.cols(); ++i) {
    noisy.col(i) += test::normal_vector(rng, 1.0).head<2>();
  }
  const Points2 probes = box_cloud<2>(rng, 400, 90.0);
  SplineOptions smooth;
  smooth.regularisation = 300.0;
  const double exact_error = (ThinPlateSpline<2>::fit(centres, noisy)->map(probes) - bent<2>(probes)).norm();
  const double smooth_error = (ThinPlateSpline<2>::fit(centres, noisy, smooth)->map(probes) - bent<2>(probes)).norm();
  EXPECT_LT(smooth_error, 0.8 * exact_error);
  // In the limit it is the affine fit.
  smooth.regularisation = 1e15;
  const auto flat = ThinPlateSpline<2>::fit(centres, noisy, smooth);
  EXPECT_LT((flat->jacobian(probes.col(0)) - flat->jacobian(probes.col(1))).norm(), 1e-8);
}

// In the plane r^2 ln r converges in the mean square with the square of the centres' distance for smooth maps [Duchon
// 1978] (faster inside, slower at the boundary), r in space likewise: four (eight) times as many centres, about a
// quarter.
TEST(ThinPlateSpline, HoldOutErrorFallsWithTheNumberOfCentres) {
  std::mt19937 rng(kSplineSeed);
  const auto error = [&]<int D>(SplineKernel kernel, Eigen::Index side) {
    Eigen::Index count = 1;
    for (int d = 0; d < D; ++d) {
      count *= side;
    }
    Points<D> centres(D, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      Eigen::Index rest = i;
      for (int d = 0; d < D; ++d, rest /= side) {
        centres(d, i) = -100.0 + 200.0 * static_cast<double>(rest % side) / static_cast<double>(side - 1);
      }
    }
    const Points<D> probes = box_cloud<D>(rng, 500);
    const auto spline = ThinPlateSpline<D>::fit(centres, bent<D>(centres), with(kernel));
    return std::sqrt((spline->map(probes) - bent<D>(probes)).squaredNorm() / 500.0);
  };
  const double plane = error.operator()<2>(SplineKernel::kR2LogR, 9) / error.operator()<2>(SplineKernel::kR2LogR, 17);
  const double space = error.operator()<3>(SplineKernel::kR, 5) / error.operator()<3>(SplineKernel::kR, 9);
  EXPECT_GT(plane, 2.8) << "seed " << kSplineSeed; // 2^1.5, the proven rate including the boundary
  EXPECT_GT(space, 2.8);
}

// Published for this recording: a plain TPS leaves 0.383 mm (r^2 ln r) and 0.494 mm (r) where a marker is left out.
TEST(ThinPlateSpline, RealDistortionGivesTheKnownLeaveOneOutError) {
  BREGMA_SHARED_DATA(folder, "distortion/repeat");
  const Points3 distorted = test::read_points<3>(folder / "Matched_Markers.csv", 1, 1);
  const Points3 truth = test::read_points<3>(folder / "Matched_Markers.csv", 1, 5);
  ASSERT_EQ(distorted.cols(), 336);
  EXPECT_NEAR((distorted - truth).colwise().norm().mean(), 6.04, 0.005);
  SplineOptions options;
  options.leave_one_out = true;
  EXPECT_NEAR(ThinPlateSpline<3>::fit(distorted, truth, options)->leave_one_out_mm().mean(), 0.383, 0.0005);
  options.kernel = SplineKernel::kR;
  EXPECT_NEAR(ThinPlateSpline<3>::fit(distorted, truth, options)->leave_one_out_mm().mean(), 0.494, 0.0005);
}

TEST(ThinPlateSpline, ReportsWhyItCannotBeFitted) {
  std::mt19937 rng(kSplineSeed);
  const Points3 good = box_cloud<3>(rng, 10);
  const auto why = [](const Points3 &centres, const Points3 &values) {
    const auto fit = ThinPlateSpline<3>::fit(centres, values);
    return fit ? std::string("fitted") : fit.error();
  };
  EXPECT_EQ(why(good.leftCols(3), good.leftCols(3)), "3 centres; a spline needs 4 to 20000");
  EXPECT_EQ(why(good, good.leftCols(4)), "10 centres but 4 values");
  Points3 twice = good;
  twice.col(7) = twice.col(2);
  EXPECT_EQ(why(twice, good), "centres 2 and 7 are the same point");
  Points3 plane = good;
  plane.row(1).setConstant(4.0);
  EXPECT_EQ(why(plane, good), "the centres lie in a plane");
  EXPECT_EQ(why(Points3::Zero(3, 5), good.leftCols(5)), "centres 0 and 1 are the same point");
  Points3 broken = good;
  broken(0, 0) = std::nan("");
  EXPECT_EQ(why(good, broken), "a centre, a value or the regularisation is not a number in its range");
  EXPECT_EQ(why(good.leftCols(4), good.leftCols(4)), "fitted");
}

TEST(SplineGrid, ItsErrorIsStatedAndFalls) {
  std::mt19937 rng(kSplineSeed);
  const Points3 centres = box_cloud<3>(rng, 60);
  const auto spline = ThinPlateSpline<3>::fit(centres, bent<3>(centres));
  ASSERT_TRUE(spline);
  const Eigen::Vector3d corner = Eigen::Vector3d::Constant(100.0);
  const SplineGrid<3> coarse(*spline, -corner, corner, 10.0, 2);
  const SplineGrid<3> fine(*spline, -corner, corner, 5.0);
  EXPECT_LT(fine.largest_error_mm(), 0.5 * coarse.largest_error_mm());
  EXPECT_LT(fine.largest_error_mm(), 0.02);
  const Points3 probes = box_cloud<3>(rng, 1000);
  for (Eigen::Index i = 0; i < probes.cols(); ++i) {
    EXPECT_LT((fine(probes.col(i)) - (*spline)(probes.col(i))).norm(), 2.0 * fine.largest_error_mm());
  }
  EXPECT_LT((fine(2.0 * corner) - (*spline)(2.0 * corner)).norm(), 1e-12); // outside: the spline itself
  EXPECT_THROW(SplineGrid<3>(*spline, corner, -corner, 5.0), std::invalid_argument);
  EXPECT_THROW(SplineGrid<3>(*spline, -corner, corner, 0.0), std::invalid_argument);
  EXPECT_THROW(SplineGrid<3>(*spline, -corner, corner, 0.1), std::invalid_argument);
}

TEST(Curves, AreDividedAtEqualArcLength) {
  // An L of 30 and 10 mm with a repeated vertex.
  const Points2 path = (Points2(2, 4) << 0, 30, 30, 30, 0, 0, 0, 10).finished();
  const auto five = subdivide<2>(path, 5);
  ASSERT_TRUE(five);
  const Points2 expected = (Points2(2, 5) << 0, 10, 20, 30, 30, 0, 0, 0, 0, 10).finished();
  EXPECT_LT((*five - expected).norm(), 1e-12);
  // Segments far shorter than the interval, which the comparison printed in the thesis would never pass.
  Points2 circle(2, 1000);
  for (int i = 0; i < 1000; ++i) {
    circle.col(i) << 50.0 * std::cos(2.0 * M_PI * i / 1000.0), 50.0 * std::sin(2.0 * M_PI * i / 1000.0);
  }
  const auto quarter = subdivide<2>(circle, 4, true);
  ASSERT_TRUE(quarter);
  EXPECT_LT((quarter->col(1) - Eigen::Vector2d(0.0, 50.0)).norm(), 1e-9);
  EXPECT_LT((quarter->col(3) - Eigen::Vector2d(0.0, -50.0)).norm(), 1e-9);
  EXPECT_NEAR(arc_length_mm(circle), 2.0 * M_PI * 50.0, 0.4);
  EXPECT_EQ(subdivide<2>(path.leftCols(1), 5).error(), "a curve needs two vertices and two points");
  EXPECT_EQ(subdivide<2>(path.middleCols(1, 2), 5).error(), "the curve has no length");
}

TEST(Curves, WithLandmarksGiveABetterSplineThanEitherAlone) {
  // A circle that becomes an ellipse, with landmarks inside.
  CurvePair<2> rim;
  rim.closed = true;
  rim.reference_mm.resize(2, 90);
  for (int i = 0; i < 90; ++i) {
    rim.reference_mm.col(i) << 80.0 * std::cos(2.0 * M_PI * i / 90.0), 80.0 * std::sin(2.0 * M_PI * i / 90.0);
  }
  rim.floating_mm = bent<2>(rim.reference_mm);
  PointSets<2> landmarks;
  landmarks.reference_mm = (Points2(2, 6) << 80, -20, 30, 0, 10, -40, 0, 10, 20, -30, 45, -15).finished();
  landmarks.floating_mm = bent<2>(landmarks.reference_mm);
  const auto joined = join<2>(landmarks, std::span(&rim, 1));
  ASSERT_TRUE(joined);
  EXPECT_EQ(joined->reference_mm.cols(), 25); // the curve begins at the first landmark
  std::mt19937 rng(kSplineSeed);
  const Points2 probes = box_cloud<2>(rng, 300, 50.0);
  const auto error = [&](const Points2 &from, const Points2 &to) {
    return (ThinPlateSpline<2>::fit(from, to)->map(probes) - bent<2>(probes)).norm();
  };
  const double hybrid = error(joined->reference_mm, joined->floating_mm);
  EXPECT_LT(hybrid, 0.9 * error(landmarks.reference_mm, landmarks.floating_mm));
  EXPECT_LT(hybrid, 0.9 * error(*subdivide<2>(rim.reference_mm, 20, true), *subdivide<2>(rim.floating_mm, 20, true)));
  landmarks.floating_mm.conservativeResize(2, 5);
  EXPECT_EQ(join<2>(landmarks, std::span(&rim, 1)).error(), "6 landmarks on the reference but 5 on the floating image");
}

} // namespace
