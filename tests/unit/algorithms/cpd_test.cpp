// Coherent point drift: E-step sums, published fixtures, invariance.
#include <cmath>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "algorithms/registration/clouds/cloud_pose.hpp"
#include "algorithms/registration/clouds/gauss_kernel.hpp"
#include "algorithms/registration/clouds/gauss_sums.hpp"
#include "algorithms/registration/surface/pose_search.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/algorithms/tables.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
using geometry::Points;
using geometry::Points3;
constexpr unsigned kCpdSeed = 20260310;

Points3 head_cloud(std::mt19937 &rng, int count) {
  Points3 out(3, count);
  for (int i = 0; i < count; ++i) {
    out.col(i) = test::on_head(test::normal_vector(rng, 1.0).normalized());
  }
  return out;
}

Eigen::Matrix3d turn_of(std::mt19937 &rng, double angle_rad) {
  return Eigen::AngleAxisd(angle_rad, test::normal_vector(rng, 1.0).normalized()).toRotationMatrix();
}

double angle(const Eigen::Matrix3d &a, const Eigen::Matrix3d &b) {
  return Eigen::AngleAxisd(Eigen::Matrix3d(a.transpose() * b)).angle();
}

// Straight from eq. (6), in doubles.
template <int D> GaussSums<D> plain_sums(const Points<D> &x, const Points<D> &y, double sigma, double c) {
  GaussSums<D> out;
  out.source_weight.setZero(y.cols());
  out.target_weight.setZero(x.cols());
  out.pull.setZero(D, y.cols());
  for (Eigen::Index n = 0; n < x.cols(); ++n) {
    Eigen::VectorXd k = (-(y.colwise() - x.col(n)).colwise().squaredNorm().array() / (2 * sigma * sigma)).exp();
    const double divisor = k.sum() + c;
    k /= divisor;
    out.source_weight += k;
    out.target_weight[n] = k.sum();
    for (Eigen::Index m = 0; m < y.cols(); ++m) {
      out.pull.col(m) += k[m] * (x.col(n) - y.col(m));
      out.squares += k[m] * (x.col(n) - y.col(m)).squaredNorm();
    }
    out.log_divisors += std::log(divisor);
  }
  return out;
}

TEST(GaussSums, MatchTheFormulaAtEverySigma) {
  std::mt19937 rng(kCpdSeed);
  const Points3 x = head_cloud(rng, 301) / 100.0;
  const Points3 y = (turn_of(rng, 0.1) * head_cloud(rng, 250)) / 100.0;
  for (const auto method : {GaussSummer<3>::Method::kAllPairs, GaussSummer<3>::Method::kGrid}) {
    for (const int threads : {1, 2}) {
      GaussSummer<3> summer(x, threads, method);
      for (const double sigma : {1.0, 0.3, 0.1, 0.03, 0.01}) {
        const double c = outlier_constant<3>(x, sigma, 0.2, y.cols());
        GaussSums<3> fast;
        summer.sum(y, sigma, c, fast);
        const GaussSums<3> plain = plain_sums<3>(x, y, sigma, c);
        const double scale = plain.source_weight.maxCoeff();
        EXPECT_LT((fast.source_weight - plain.source_weight).cwiseAbs().maxCoeff(), gauss_sum_error(sigma) * scale)
            << "sigma " << sigma << " threads " << threads << " seed " << kCpdSeed;
        EXPECT_LT((fast.target_weight - plain.target_weight).cwiseAbs().maxCoeff(), gauss_sum_error(sigma));
        EXPECT_LT((fast.pull - plain.pull).cwiseAbs().maxCoeff(), gauss_sum_error(sigma) * scale * 5.0 * sigma);
        EXPECT_NEAR(fast.squares, plain.squares, 3.0 * gauss_sum_error(sigma) * plain.squares);
        EXPECT_NEAR(fast.log_divisors, plain.log_divisors, gauss_sum_error(sigma) * static_cast<double>(x.cols()));
      }
    }
  }
}

TEST(GaussSums, TheGridIsChosenWhereSigmaIsSmall) {
  std::mt19937 rng(kCpdSeed);
  const Points3 x = head_cloud(rng, 1000) / 100.0;
  GaussSummer<3> summer(x, 1);
  GaussSums<3> sums;
  summer.sum(x, 0.5, 0.1, sums);
  EXPECT_FALSE(summer.used_grid());
  summer.sum(x, 0.01, 0.1, sums);
  EXPECT_TRUE(summer.used_grid());
}

TEST(GaussKernel, EveryVersionOfThisProcessorGivesTheSameResult) {
  constexpr std::size_t kSize = 48;
  std::mt19937 rng(kCpdSeed);
  std::normal_distribution<float> normal(0.0F, 0.5F);
  std::vector<float> source(3 * kSize);
  for (float &v : source) {
    v = normal(rng);
  }
  std::vector<float> expected;
  for (const GaussKernel &kernel : gauss_kernels()) {
    std::vector<float> sums(4 * kSize, 0.0F);
    std::vector<float> scratch(kGaussRows * kSize);
    std::array<GaussRow, kGaussRows> rows{};
    for (std::size_t r = 0; r < kGaussRows; ++r) {
      rows[r].x = 0.1F * static_cast<float>(r);
    }
    rows[2].used = 0.0F;
    const GaussBlock block{kSize,         source.data(),       source.data() + kSize,   source.data() + 2 * kSize,
                           sums.data(),   sums.data() + kSize, sums.data() + 2 * kSize, sums.data() + 3 * kSize,
                           scratch.data()};
    kernel.add_rows(block, rows.data(), 2.0F, 0.1F);
    double kernel_sum = 0.0;
    for (std::size_t i = 0; i < kSize; ++i) {
      const double dx = static_cast<double>(source[i]) - 0.1;
      const double dy = source[kSize + i];
      const double dz = source[2 * kSize + i];
      kernel_sum += std::exp(-2.0 * (dx * dx + dy * dy + dz * dz));
    }
    EXPECT_NEAR(rows[1].kernel, kernel_sum, 2e-6 * kernel_sum) << kernel.name;
    if (expected.empty()) {
      expected = sums;
    }
    for (std::size_t i = 0; i < sums.size(); ++i) {
      EXPECT_NEAR(sums[i], expected[i], 1e-6) << kernel.name << " at " << i;
    }
  }
}

// Results of gadomski/cpd, and of the authors' program that it follows, for one E-step with sigma 1 and w 0.1.
TEST(CpdFixtures, FishAndFaceAreMatched) {
  BREGMA_SHARED_DATA(folder, "clouds/cpd");
  const Points<2> fish = test::read_points<2>(folder / "fish.csv");
  const Points<2> fish_distorted = test::read_points<2>(folder / "fish_distorted.csv");
  ASSERT_EQ(fish.cols(), 91);
  const double c2 = paper_outlier_constant<2>(1.0, 0.1, 91, 91);
  GaussSums<2> sums;
  GaussSummer<2>(fish, 1).sum(fish_distorted, 1.0, c2, sums);
  EXPECT_NEAR(sums.source_weight[0], 0.6850, 1e-4);
  EXPECT_NEAR(sums.source_weight[90], 1.0689, 1e-4);
  EXPECT_NEAR(sums.target_weight[0], 0.9882, 1e-4);
  EXPECT_NEAR(sums.target_weight[90], 0.9869, 1e-4);
  EXPECT_NEAR(sums.pull(0, 0) + sums.source_weight[0] * fish_distorted(0, 0), -0.2625, 1e-4);
  EXPECT_NEAR(sums.pull(1, 90) + sums.source_weight[90] * fish_distorted(1, 90), -0.3164, 1e-4);

  const Points<1> expected = test::read_points<1>(folder / "fish_correspondence.csv");
  const auto found = correspondences<2>(fish_distorted, fish, 1.0, c2);
  ASSERT_EQ(found.of_source.size(), 91U);
  for (Eigen::Index m = 0; m < 91; ++m) {
    EXPECT_EQ(found.of_source[static_cast<std::size_t>(m)].index, static_cast<int>(expected(0, m))) << "point " << m;
  }

  const Points3 face = test::read_points<3>(folder / "face.csv");
  const Points3 face_distorted = test::read_points<3>(folder / "face_distorted.csv");
  GaussSums<3> of_face;
  GaussSummer<3>(face, 1).sum(face_distorted, 1.0, paper_outlier_constant<3>(1.0, 0.1, 392, 392), of_face);
  EXPECT_NEAR(of_face.source_weight[0], 0.6171, 1e-4);
  EXPECT_NEAR(of_face.source_weight[391], 0.4869, 1e-4);
  EXPECT_NEAR(of_face.target_weight[0], 0.9850, 1e-4);
  EXPECT_NEAR(of_face.target_weight[391], 0.9823, 1e-4);
  EXPECT_NEAR(of_face.pull(0, 0) + of_face.source_weight[0] * face_distorted(0, 0), -0.2361, 1e-4);
}

TEST(CpdFixtures, AffineFindsTheTransformOfFishAndFace) {
  BREGMA_SHARED_DATA(folder, "clouds/cpd");
  CpdOptions options;
  options.model = CpdModel::kAffine;
  options.max_iterations = 1000;
  const Points<2> fish = test::read_points<2>(folder / "fish.csv");
  CpdTransform<2> T2;
  T2.linear << 1.2688, 1.1294, 0.9169, 1.4311;
  T2.translation << 1.0, 2.0;
  const auto of_fish = register_cpd<2>(fish, T2 * fish, options);
  EXPECT_TRUE(of_fish.transform.linear.isApprox(T2.linear, 1e-4)) << of_fish.transform.linear;
  EXPECT_TRUE(of_fish.transform.translation.isApprox(T2.translation, 1e-4));
  const Points3 face = test::read_points<3>(folder / "face.csv");
  CpdTransform<3> T3;
  T3.linear << 0.8240, 0.3796, 0.7927, -0.6682, 0.4136, 0.8303, 0.0845, -0.8015, 0.5005;
  T3.translation << 1.0, 2.0, 3.0;
  const auto of_face = register_cpd<3>(face, T3 * face, options);
  EXPECT_TRUE(of_face.transform.linear.isApprox(T3.linear, 1e-4)) << of_face.transform.linear;
  EXPECT_TRUE(of_face.transform.translation.isApprox(T3.translation, 1e-4));
}

TEST(Cpd, RigidWithNoiseAndOutliers) {
  std::mt19937 rng(kCpdSeed);
  for (int run = 0; run < 5; ++run) {
    const Points3 source = head_cloud(rng, 600);
    const Eigen::Matrix3d R = turn_of(rng, 30.0 * M_PI / 180.0);
    const Eigen::Vector3d t(20.0, -10.0, 35.0);
    Points3 target = (R * source).colwise() + t;
    std::uniform_real_distribution<double> box(-120.0, 120.0);
    for (Eigen::Index i = 0; i < target.cols(); ++i) {
      target.col(i) = i % 5 == 0 ? Eigen::Vector3d(t + Eigen::Vector3d(box(rng), box(rng), box(rng)))
                                 : Eigen::Vector3d(target.col(i) + test::normal_vector(rng, 0.5));
    }
    CpdOptions options;
    options.outlier_weight = 0.2;
    const auto found = register_cpd<3>(source, target, options);
    ASSERT_EQ(found.outcome, CpdOutcome::kConverged) << "run " << run << " seed " << kCpdSeed;
    EXPECT_LT(angle(found.rotation, R), 0.003);
    EXPECT_NEAR(found.sigma_mm, 0.5, 0.1);
    EXPECT_NEAR(found.outlier_share, 0.2, 0.05);
    EXPECT_NEAR(found.scale, 1.0, 1e-12);
    // Sources whose counterpart was not replaced must find it.
    const auto pairs = correspondences<3>(found.transform * source, target, found.sigma_mm,
                                          outlier_constant<3>(target, found.sigma_mm, 0.2, source.cols()));
    int right = 0;
    for (std::size_t i = 0; i < pairs.of_source.size(); ++i) {
      right += i % 5 != 0 && pairs.of_source[i].index == static_cast<int>(i) ? 1 : 0;
    }
    EXPECT_GT(right, 470); // of 480
  }
}

TEST(Cpd, EstimatesAFreeScale) {
  std::mt19937 rng(kCpdSeed);
  const Points3 source = head_cloud(rng, 300);
  const Eigen::Matrix3d R = turn_of(rng, 0.4);
  const Points3 target = (1.37 * R * source).colwise() + Eigen::Vector3d(500.0, 0.0, -200.0);
  CpdOptions options;
  options.model = CpdModel::kSimilarity;
  const auto found = register_cpd<3>(source, target, options);
  EXPECT_NEAR(found.scale, 1.37, 1e-5);
  EXPECT_LT(angle(found.rotation, R), 1e-5);
  EXPECT_LT((found.transform * source - target).colwise().norm().maxCoeff(), 1e-2);
}

TEST(Cpd, IsEquivariantOnBothSidesAndInvertible) {
  std::mt19937 rng(kCpdSeed);
  const Points3 source = head_cloud(rng, 250);
  Points3 target = (turn_of(rng, 0.3) * source).colwise() + Eigen::Vector3d(5.0, 6.0, 7.0);
  for (Eigen::Index i = 0; i < target.cols(); ++i) {
    target.col(i) += test::normal_vector(rng, 0.3);
  }
  CpdOptions options;
  options.outlier_weight = 0.05;
  const auto found = register_cpd<3>(source, target, options);
  ASSERT_TRUE(found.has_estimate());
  // A translation of either side, and a rotation of both with the start. (The bounding box of the outliers changes with
  // the rotation, which causes small differences.)
  const Eigen::Matrix3d Q = turn_of(rng, 2.0);
  const Eigen::Vector3d a(1000.0, -300.0, 20.0);
  const Eigen::Vector3d b(-50.0, 70.0, 900.0);
  const auto moved = register_cpd<3>((Q * source).colwise() + a, (Q * target).colwise() + b, options);
  ASSERT_TRUE(moved.has_estimate());
  const Points3 expected = (Q * (found.transform * source)).colwise() + b;
  EXPECT_LT((moved.transform * Points3((Q * source).colwise() + a) - expected).colwise().norm().maxCoeff(), 0.05)
      << "seed " << kCpdSeed;
  // Composition: a motion of the sources before the fit reduces the result by that motion.
  const Eigen::Matrix3d S = turn_of(rng, 0.1);
  const auto rest = register_cpd<3>(S * source, target, options);
  EXPECT_LT((rest.transform.linear * S - found.transform.linear).norm(), 1e-4);
  // Exchanged sides give the inverse, up to the noise.
  const auto back = register_cpd<3>(target, source, options);
  EXPECT_LT(angle(back.rotation.transpose(), found.rotation), 0.005);
}

TEST(Cpd, ReportsWhyItCannotRegister) {
  std::mt19937 rng(kCpdSeed);
  const Points3 good = head_cloud(rng, 50);
  EXPECT_EQ(register_cpd<3>(good.leftCols(3), good, {}).outcome, CpdOutcome::kTooFewPoints);
  Points3 broken = good;
  broken(1, 7) = std::nan("");
  EXPECT_EQ(register_cpd<3>(good, broken, {}).outcome, CpdOutcome::kNotFinite);
  CpdOptions all_outliers;
  all_outliers.outlier_weight = 1.0;
  EXPECT_EQ(register_cpd<3>(good, good, all_outliers).outcome, CpdOutcome::kNotFinite);
  Points3 line = Points3::Zero(3, 20);
  line.row(0).setLinSpaced(0.0, 100.0);
  EXPECT_EQ(register_cpd<3>(line, line, {}).outcome, CpdOutcome::kDegenerate);
  Points3 plane = good;
  plane.row(2).setZero();
  CpdOptions affine;
  affine.model = CpdModel::kAffine;
  EXPECT_EQ(register_cpd<3>(plane, plane, affine).outcome, CpdOutcome::kDegenerate);
  EXPECT_EQ(register_cpd<3>(Points3::Zero(3, 10), good, {}).outcome, CpdOutcome::kDegenerate);
  EXPECT_STREQ(name(CpdOutcome::kTooFewPoints), "too few points");
}

// A body without symmetry. An ellipsoid would be nearly symmetric.
Eigen::Vector3d on_stone(std::mt19937 &rng) {
  const Eigen::Vector3d d = test::normal_vector(rng, 1.0).normalized();
  return test::on_head(d) * (1.0 + 0.25 * std::sin(3.0 * d.x() + 1.0) * std::cos(2.0 * d.z()) + 0.2 * d.y() * d.z());
}

TEST(CloudPose, FindsAPartOfABodyFromAnyPose) {
  std::mt19937 rng(kCpdSeed);
  Points3 whole(3, 3000);
  for (Eigen::Index i = 0; i < whole.cols(); ++i) {
    whole.col(i) = on_stone(rng);
  }
  for (int run = 0; run < 3; ++run) {
    const Eigen::Matrix3d R = test::random_rotation(rng).toRotationMatrix();
    Points3 target(3, 1000);
    Eigen::Index count = 0;
    while (count < 1000) { // the part in front of a plane behind the middle
      const Eigen::Vector3d p = on_stone(rng);
      if (p.y() > -40.0) {
        target.col(count++) = R * p + Eigen::Vector3d(300.0, 0.0, -100.0) + test::normal_vector(rng, 0.5);
      }
    }
    CloudPoseOptions options;
    options.outlier_weight = 0.02;
    const auto found = find_cloud_pose(whole, target, options);
    ASSERT_TRUE(found.best.has_estimate());
    EXPECT_LT(angle(found.best.rotation, R), 0.06) << "run " << run << " seed " << kCpdSeed;
    EXPECT_GT(found.middle_log_likelihood, found.runner_up.log_likelihood);
  }
}

TEST(CloudPose, RotationsAreSpreadEvenly) {
  const auto rotations = spread_rotations(120);
  ASSERT_EQ(rotations.size(), 120U);
  std::mt19937 rng(kCpdSeed);
  double worst = 0.0;
  for (int run = 0; run < 500; ++run) {
    const Eigen::Matrix3d R = test::random_rotation(rng).toRotationMatrix();
    double nearest = 10.0;
    for (const Eigen::Quaterniond &other : rotations) {
      nearest = std::min(nearest, angle(R, other.toRotationMatrix()));
    }
    worst = std::max(worst, nearest);
  }
  EXPECT_LT(worst, 60.0 * M_PI / 180.0);
}

} // namespace
