// Solid harmonics, their series with its stated error, and the distortion field: simulated phantoms and the real one.
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/mri/distortion_field.hpp"
#include "tests/unit/algorithms/tables.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/mri/field_phantom.hpp"

namespace {

using namespace bregma;
using namespace bregma::mri;
using Eigen::Vector3d;
using geometry::Points3;

std::vector<double> harmonics_at(int degree, const Vector3d &p) {
  std::vector<double> out(static_cast<std::size_t>(harmonic_count(degree)));
  solid_harmonics(degree, p, out);
  return out;
}

Points3 on_sphere(int count, double radius, unsigned seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> gauss;
  Points3 out = Points3::NullaryExpr(3, count, [&] { return gauss(rng); });
  out.colwise().normalize();
  return radius * out;
}

TEST(SolidHarmonics, SatisfyLaplacesEquation) {
  constexpr double kStep = 1e-3;
  const Vector3d p(0.4, -0.3, 0.7);
  const auto centre = harmonics_at(9, p);
  std::vector<double> laplacian(centre.size());
  for (int axis = 0; axis < 3; ++axis) {
    const auto up = harmonics_at(9, p + kStep * Vector3d::Unit(axis)),
               down = harmonics_at(9, p - kStep * Vector3d::Unit(axis));
    for (std::size_t i = 0; i < centre.size(); ++i) {
      laplacian[i] += (up[i] - 2.0 * centre[i] + down[i]) / (kStep * kStep);
    }
  }
  for (std::size_t i = 0; i < laplacian.size(); ++i) {
    EXPECT_NEAR(laplacian[i], 0.0, 2e-3) << "harmonic " << i;
  }
}

TEST(SolidHarmonics, AreOrthogonalWithTheNormOfSchmidtOnTheSphere) {
  constexpr int kDegree = 5, kCount = 40000;
  const Points3 sphere = on_sphere(kCount, 1.0, 7);
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(harmonic_count(kDegree), harmonic_count(kDegree));
  for (Eigen::Index i = 0; i < kCount; ++i) {
    const auto row = harmonics_at(kDegree, sphere.col(i));
    const Eigen::Map<const Eigen::VectorXd> a(row.data(), mean.rows());
    mean += a * a.transpose() / kCount;
  }
  for (int i = 0; i < harmonic_count(kDegree); ++i) {
    for (int j = 0; j < harmonic_count(kDegree); ++j) {
      EXPECT_NEAR(mean(i, j), i == j ? 1.0 / (2.0 * degree_of_harmonic(i) + 1.0) : 0.0, 0.02) << i << " " << j;
    }
  }
  // The linear ones are the coordinates, in the order z, x, y.
  const auto row = harmonics_at(1, {2.0, 3.0, 5.0});
  EXPECT_EQ(row, (std::vector<double>{1.0, 5.0, 2.0, 3.0}));
}

TEST(HarmonicSeries, StatesItsErrorInsideAndOutside) {
  double inside = 0.0, outside = 0.0;
  int within = 0, total = 0;
  constexpr int kFields = 12;
  for (unsigned seed = 0; seed < kFields; ++seed) {
    const test::SourceField field(seed);
    const Points3 points = test::lattice(8, 24.0);
    const Points3 imaged = test::with_noise(field.image_of(points), 0.1, seed + 100);
    for (int axis = 0; axis < 3; ++axis) {
      const auto series = HarmonicSeries::fit(points, (imaged - points).row(axis).transpose());
      ASSERT_TRUE(series) << series.error();
      EXPECT_NEAR(series->noise_sigma(), 0.1, 0.03);
      for (const double radius : {60.0, 165.0}) {
        const Points3 probes = on_sphere(60, radius, seed + 200);
        for (Eigen::Index i = 0; i < probes.cols(); ++i) {
          const auto estimate = series->estimate(probes.col(i));
          const double error = field.displacement(Vector3d(probes.col(i)))[axis] - estimate.value;
          (radius < 100.0 ? inside : outside) += std::pow(error / estimate.sigma, 2) / (kFields * 180.0);
          if (radius > 100.0) {
            within += std::abs(error) < 1.96 * estimate.sigma ? 1 : 0;
            ++total;
          }
        }
      }
    }
  }
  EXPECT_GT(inside, 0.4);
  EXPECT_LT(inside, 1.8);
  EXPECT_LT(outside, 2.5);
  EXPECT_GT(within, 9 * total / 10);
}

TEST(HarmonicSeries, RefusesWhatDeterminesNoField) {
  const auto message = [](const Points3 &p, const Eigen::VectorXd &v, int degree = 7) {
    HarmonicOptions options;
    options.max_degree = degree;
    const auto series = HarmonicSeries::fit(p, v, options);
    return series ? std::string("accepted") : series.error();
  };
  const Points3 points = test::lattice(4, 20.0);
  const Eigen::VectorXd values = Eigen::VectorXd::Ones(points.cols());
  EXPECT_EQ(message(points, values), "accepted");
  EXPECT_EQ(message(points, values.head(5)), "64 points but 5 values");
  EXPECT_EQ(message(points.leftCols(11), values.head(11)), "11 points; a series of harmonics needs 12");
  EXPECT_EQ(message(points.leftCols(16), values.head(16)), "the points lie in a plane");
  EXPECT_EQ(message(points, values, 17), "degree 17 or radius 0.000000 mm is out of range");
  Points3 broken = points;
  broken(1, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(message(broken, values), "a point or a value is not finite");
}

struct Phantom {
  test::SourceField field;
  Points3 truth, imaged;
};
Phantom phantom(unsigned seed, double bump_mm) {
  Phantom out{test::SourceField(seed), test::lattice(10, 17.0), {}};
  out.field.bump_mm = bump_mm;
  out.imaged = test::with_noise(out.field.image_of(out.truth), 0.08, seed + 1);
  return out;
}

TEST(DistortionField, IsCloseToTheTrueMapAndItsInverseUndoesIt) {
  for (const double bump_mm : {0.0, 1.5}) {
    const Phantom p = phantom(3, bump_mm);
    const auto field = DistortionField::fit(p.truth, p.imaged);
    ASSERT_TRUE(field) << field.error();
    EXPECT_EQ(field->has_spline(), bump_mm > 0.0);
    EXPECT_NEAR(field->spacing_mm(), 17.0, 1e-9);
    std::mt19937 rng(5);
    std::uniform_real_distribution<double> side(-75.0, 75.0);
    Points3 error(3, 500);
    int within = 0;
    for (Eigen::Index i = 0; i < error.cols(); ++i) {
      const Vector3d x(side(rng), side(rng), side(rng));
      error.col(i) = field->to_imaged(x) - p.field.image_of(x);
      const auto assessment = field->assess(x);
      EXPECT_EQ(assessment.coverage, Coverage::kInterpolates);
      within += error.col(i).norm() < assessment.error_95_mm ? 1 : 0;
      const auto back = field->to_true(field->to_imaged(x));
      ASSERT_TRUE(back);
      EXPECT_LT((*back - x).norm(), 1e-5);
    }
    const ErrorSummary summary = summarise(error);
    EXPECT_LT(summary.overall.mean_mm, bump_mm > 0.0 ? 0.1 : 0.05);
    EXPECT_LT(summary.overall.max_mm, 0.5);
    EXPECT_GT(within, 450) << "bump " << bump_mm;
  }
}

TEST(DistortionField, IsContinuousWhereTheSplineEnds) {
  const Phantom p = phantom(4, 2.0);
  const auto field = DistortionField::fit(p.truth, p.imaged);
  ASSERT_TRUE(field && field->has_spline());
  for (double x = 60.0; x < 120.0; x += 0.01) {
    const Vector3d a(x, 20.0, 0.0), b(x + 0.01, 20.0, 0.0);
    EXPECT_LT(((field->to_imaged(b) - b) - (field->to_imaged(a) - a)).norm(), 0.003) << x;
  }
}

TEST(DistortionField, SaysWhereItExtrapolatesAndWhereItDoesNotKnow) {
  const Phantom p = phantom(5, 0.0);
  const auto field = DistortionField::fit(p.truth, p.imaged);
  ASSERT_TRUE(field) << field.error();
  EXPECT_EQ(field->assess({0, 0, 0}).coverage, Coverage::kInterpolates);
  const auto near = field->assess({90, 0, 0});
  EXPECT_EQ(near.coverage, Coverage::kExtrapolates);
  EXPECT_NEAR(near.distance_mm, 90.0 - 76.5, 1.5);
  const auto far = field->assess({400, 0, 0});
  EXPECT_EQ(far.coverage, Coverage::kUnknown);
  EXPECT_GT(far.error_95_mm, 2.0);
  EXPECT_FALSE(field->to_true({5000, 0, 0}));
  EXPECT_STREQ(name(Coverage::kUnknown), "unknown");
}

// Displacements that solve no equation of Laplace: the spline has what the harmonics lack inside, and nothing has it
// outside.
TEST(DistortionField, WhatIsNotHarmonicInsideEnlargesTheStatedErrorOutside) {
  struct Bump {
    Vector3d centre_mm, height_mm;
    double width_mm = 0.0;
  };
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> place(-130.0, 130.0);
  std::normal_distribution<double> gauss;
  std::vector<Bump> bumps;
  for (int i = 0; i < 24; ++i) {
    bumps.push_back(
        {{place(rng), place(rng), place(rng)}, {gauss(rng), gauss(rng), gauss(rng)}, i < 12 ? 120.0 : 60.0});
  }
  const auto image_of = [&](const Vector3d &p) {
    Vector3d out = p;
    for (const Bump &b : bumps) {
      out += std::exp(-0.5 * (p - b.centre_mm).squaredNorm() / (b.width_mm * b.width_mm)) * b.height_mm;
    }
    return out;
  };
  const Points3 truth = test::lattice(11, 16.0);
  Points3 imaged = truth;
  for (Eigen::Index i = 0; i < truth.cols(); ++i) {
    imaged.col(i) = image_of(truth.col(i));
  }
  const auto field = DistortionField::fit(truth, test::with_noise(imaged, 0.05, 3));
  ASSERT_TRUE(field) << field.error();
  ASSERT_TRUE(field->has_spline());
  int covered = 0, places = 0;
  for (double x = -60.0; x <= 60.0; x += 20.0) {
    for (double z = 84.0; z <= 100.0; z += 4.0) {
      const Vector3d at(x, 10.0, z);
      covered += (field->to_imaged(at) - image_of(at)).norm() <= field->assess(at).error_95_mm ? 1 : 0;
      ++places;
    }
  }
  EXPECT_GE(covered, places * 9 / 10) << "of " << places;
}

TEST(DistortionField, SummariesAreThoseOfTableThree) {
  Points3 errors(3, 2);
  errors << 3.0, -1.0, -4.0, 2.0, 0.0, 2.0;
  const ErrorSummary s = summarise(errors);
  EXPECT_DOUBLE_EQ(s.axis[0].mean_mm, 2.0);
  EXPECT_DOUBLE_EQ(s.axis[0].deviation_mm, 1.0);
  EXPECT_DOUBLE_EQ(s.axis[1].max_mm, 4.0);
  EXPECT_DOUBLE_EQ(s.overall.mean_mm, 4.0);
  EXPECT_DOUBLE_EQ(s.overall.max_mm, 5.0);
  const auto refused = DistortionField::fit(test::lattice(3, 10.0), test::lattice(2, 10.0));
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error(), "27 true points but 8 imaged ones");
}

// Twelve folds; all that a fit chooses, it chooses within the fold. bench_mri leaves out one marker at a time.
TEST(DistortionField, ResidualOnTheRealPhantomsMarkersIsBelowThatOfASpline) {
  BREGMA_SHARED_DATA(file, "distortion/repeat/Matched_Markers.csv");
  const Points3 imaged = test::read_points<3>(file, 1, 1), truth = test::read_points<3>(file, 1, 5);
  ASSERT_EQ(truth.cols(), 336);
  EXPECT_NEAR(summarise(imaged - truth).overall.mean_mm, 6.04, 0.01);
  Points3 errors(3, truth.cols());
  constexpr Eigen::Index kFolds = 12;
  for (Eigen::Index fold = 0; fold < kFolds; ++fold) {
    std::vector<Eigen::Index> kept, held;
    for (Eigen::Index i = 0; i < truth.cols(); ++i) {
      (i % kFolds == fold ? held : kept).push_back(i);
    }
    const auto field = DistortionField::fit(truth(Eigen::all, kept), imaged(Eigen::all, kept));
    ASSERT_TRUE(field) << field.error();
    errors(Eigen::all, held) = residuals(*field, truth(Eigen::all, held), imaged(Eigen::all, held));
  }
  EXPECT_LT(summarise(errors).overall.mean_mm, 0.34);
  EXPECT_LT(summarise(errors).overall.max_mm, 2.0);
}

} // namespace
