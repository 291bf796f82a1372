#include <cmath>

#include <gtest/gtest.h>

#include "algorithms/registration/points/paired_points.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
using geometry::rotation_exp;
using geometry::Vector6d;
constexpr unsigned kPairedSeed = 20260202;

PairedPose random_pose(std::mt19937 &rng) {
  return test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
}

std::vector<Vector3d> cloud(std::mt19937 &rng, int count, double size = 60.0) {
  std::vector<Vector3d> out;
  for (int i = 0; i < count; ++i) {
    out.push_back(test::normal_vector(rng, size));
  }
  return out;
}

std::vector<Vector3d> mapped(const PairedPose &T, const std::vector<Vector3d> &points) {
  std::vector<Vector3d> out;
  for (const Vector3d &p : points) {
    out.push_back(T * p);
  }
  return out;
}

// Random anisotropic errors with stated covariances.
std::vector<PointPair> noisy_pairs(std::mt19937 &rng, const PairedPose &T, int count) {
  std::vector<PointPair> out;
  for (const Vector3d &p : cloud(rng, count)) {
    PointPair pair;
    pair.source_covariance = test::random_anisotropic(rng, 0.2, 0.7);
    pair.target_covariance = test::random_anisotropic(rng, 0.3, 0.6);
    pair.source_mm = p + test::draw(rng, pair.source_covariance);
    pair.target_mm = T * p + test::draw(rng, pair.target_covariance);
    out.push_back(pair);
  }
  return out;
}

double difference(const PairedPose &a, const PairedPose &b) { return (a.matrix() - b.matrix()).norm(); }

TEST(FitRigid, FindsTheMotionOfCleanPoints) {
  std::mt19937 rng(kPairedSeed);
  for (int count : {3, 4, 8, 64, 500}) {
    for (int run = 0; run < 20; ++run) {
      const PairedPose T = random_pose(rng);
      const auto source = cloud(rng, count);
      const auto fit = fit_rigid(source, mapped(T, source));
      ASSERT_TRUE(fit.has_value());
      EXPECT_LT(difference(*fit, T), 1e-10) << count << " points, seed " << kPairedSeed;
    }
  }
}

TEST(FitRigid, NeverReflects) {
  std::mt19937 rng(kPairedSeed);
  for (int run = 0; run < 200; ++run) {
    // For flat and mirrored sets the best orthogonal matrix is a reflection.
    auto source = cloud(rng, 5);
    auto target = mapped(random_pose(rng), source);
    for (std::size_t i = 0; i < source.size(); ++i) {
      if (run % 2 == 0) {
        source[i].z() = 0.0;
        target[i] += test::normal_vector(rng, 0.5);
      } else {
        target[i].x() = -target[i].x();
      }
    }
    const auto fit = fit_rigid(source, target);
    ASSERT_TRUE(fit.has_value());
    EXPECT_NEAR(fit->rotation_matrix().determinant(), 1.0, 1e-12);
    // No small rotation reduces the error.
    const auto error = [&](const PairedPose &T) {
      double sum = 0.0;
      for (std::size_t i = 0; i < source.size(); ++i) {
        sum += (T * source[i] - target[i]).squaredNorm();
      }
      return sum;
    };
    const Vector3d w = test::normal_vector(rng, 1e-3);
    const Vector3d v = test::normal_vector(rng, 1e-2);
    EXPECT_LE(error(*fit), error(PairedPose(rotation_exp(w) * fit->rotation(), fit->translation() + v)) + 1e-9);
  }
}

TEST(FitRigid, WeightsSelectPoints) {
  std::mt19937 rng(kPairedSeed);
  const PairedPose T = random_pose(rng);
  const auto source = cloud(rng, 6);
  auto target = mapped(T, source);
  target[2] += Vector3d(5.0, -3.0, 8.0);
  const std::vector<double> weights = {1.0, 2.0, 0.0, 0.5, 1.0, 3.0};
  const auto fit = fit_rigid(source, target, weights);
  ASSERT_TRUE(fit.has_value());
  EXPECT_LT(difference(*fit, T), 1e-10);
  EXPECT_GT(difference(*fit_rigid(source, target), T), 1e-3);
}

TEST(FitRigid, RefusesPointsThatDoNotDetermineAPose) {
  const std::vector<Vector3d> line = {{0, 0, 0}, {10, 0, 0}, {25, 0, 0}, {40, 0, 0}};
  EXPECT_FALSE(fit_rigid(line, line).has_value());
  const std::vector<Vector3d> two = {{0, 0, 0}, {10, 0, 0}};
  EXPECT_FALSE(fit_rigid(two, two).has_value());
  std::vector<Vector3d> three = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}};
  EXPECT_TRUE(fit_rigid(three, three).has_value());
  EXPECT_FALSE(fit_rigid(three, two).has_value());
  EXPECT_FALSE(fit_rigid(three, three, std::vector<double>{1.0}).has_value());
  three[1].y() = std::nan("");
  EXPECT_FALSE(fit_rigid(three, three).has_value());
  EXPECT_NEAR(spread_mm(line)[1], 0.0, 1e-9);
  EXPECT_NEAR(spread_mm(std::vector<Vector3d>{{3, 0, 0}, {-3, 0, 0}, {0, 1, 0}, {0, -1, 0}})[1], std::sqrt(0.5), 1e-12);
}

TEST(FitPaired, IsEquivariantOnBothSides) {
  std::mt19937 rng(kPairedSeed);
  for (int run = 0; run < 50; ++run) {
    const auto pairs = noisy_pairs(rng, random_pose(rng), 8);
    const auto fit = fit_paired(pairs);
    ASSERT_TRUE(fit.converged);
    // The same fiducials in other coordinates on both sides: the estimate is equivariant.
    const PairedPose on_source = random_pose(rng);
    const PairedPose on_target = random_pose(rng);
    const Matrix3d Rs = on_source.rotation_matrix();
    const Matrix3d Rt = on_target.rotation_matrix();
    std::vector<PointPair> moved;
    for (const PointPair &pair : pairs) {
      moved.push_back({on_source * pair.source_mm, on_target * pair.target_mm,
                       Rs * pair.source_covariance * Rs.transpose(), Rt * pair.target_covariance * Rt.transpose()});
    }
    const auto moved_fit = fit_paired(moved);
    ASSERT_TRUE(moved_fit.converged);
    const auto expected = on_target.as<geometry::frame::Target, geometry::frame::Target>() * fit.T_target_source *
                          on_source.as<geometry::frame::Source, geometry::frame::Source>().inverse();
    EXPECT_LT(difference(moved_fit.T_target_source, expected), 1e-7) << "run " << run << " seed " << kPairedSeed;
    EXPECT_NEAR(moved_fit.chi_square, fit.chi_square, 1e-6);
    EXPECT_NEAR(moved_fit.fre_mm, fit.fre_mm, 1e-9);
    const auto ad = geometry::adjoint(on_target);
    EXPECT_TRUE(moved_fit.covariance.isApprox(ad * fit.covariance * ad.transpose(), 1e-6));
    // Exchanged sides.
    std::vector<PointPair> swapped;
    for (const PointPair &pair : pairs) {
      swapped.push_back({pair.target_mm, pair.source_mm, pair.target_covariance, pair.source_covariance});
    }
    const auto back = fit_paired(swapped);
    const PairedPose inverse = fit.T_target_source.inverse().as<geometry::frame::Target, geometry::frame::Source>();
    // The weights use the current rotation on both sides, so the two agree to second order in the noise.
    EXPECT_LT((back.T_target_source.translation() - inverse.translation()).norm(), 0.02);
  }
}

TEST(FitPaired, BeatsLeastSquaresWhereErrorsAreAnisotropic) {
  std::mt19937 rng(kPairedSeed);
  double ours = 0.0;
  double plain = 0.0;
  for (int run = 0; run < 300; ++run) {
    const PairedPose T = random_pose(rng);
    std::vector<PointPair> pairs;
    std::vector<Vector3d> source;
    std::vector<Vector3d> target;
    for (const Vector3d &p : cloud(rng, 8)) {
      const Matrix3d noise = test::random_anisotropic(rng, 0.1, 1.0);
      pairs.push_back({p, T * p + test::draw(rng, noise), Matrix3d::Zero(), noise});
      source.push_back(p);
      target.push_back(pairs.back().target_mm);
    }
    ours += (fit_paired(pairs).T_target_source * Vector3d::Zero() - T * Vector3d::Zero()).squaredNorm();
    plain += (*fit_rigid(source, target) * Vector3d::Zero() - T * Vector3d::Zero()).squaredNorm();
  }
  EXPECT_LT(ours, 0.5 * plain);
}

TEST(FitPaired, PValuesAreUniform) {
  std::mt19937 rng(kPairedSeed);
  constexpr int kRuns = 3000;
  for (const int count : {3, 5, 8}) {
    int total_below = 0;
    int single_below = 0;
    for (int run = 0; run < kRuns; ++run) {
      const auto fit = fit_paired(noisy_pairs(rng, random_pose(rng), count));
      total_below += fit.p_value < 0.1 ? 1 : 0;
      single_below += fit.fiducials[0].p_value < 0.1 ? 1 : 0;
    }
    EXPECT_NEAR(100.0 * total_below / kRuns, 10.0, 1.8) << count << " fiducials, seed " << kPairedSeed;
    EXPECT_NEAR(100.0 * single_below / kRuns, 10.0, 1.8) << count << " fiducials";
  }
}

TEST(FitPaired, LeaveOneOutMatchesAFitWithoutThePoint) {
  std::mt19937 rng(kPairedSeed);
  for (int run = 0; run < 50; ++run) {
    auto pairs = noisy_pairs(rng, random_pose(rng), 6);
    pairs[4].target_mm += Vector3d(1.5, -1.0, 2.0);
    const auto fit = fit_paired(pairs);
    const PointPair left_out = pairs[4];
    pairs.erase(pairs.begin() + 4);
    const auto rest = fit_paired(pairs);
    const double really = (rest.T_target_source * left_out.source_mm - left_out.target_mm).norm();
    EXPECT_NEAR(fit.fiducials[4].leave_one_out_mm, really, 0.05 * really) << "run " << run << " seed " << kPairedSeed;
    EXPECT_GT(fit.fiducials[4].leave_one_out_mm, fit.fiducials[4].norm_mm);
  }
}

TEST(FitPaired, LeaveOneOutIsUnknownWithThree) {
  std::mt19937 rng(kPairedSeed);
  const auto fit = fit_paired(noisy_pairs(rng, random_pose(rng), 3));
  ASSERT_TRUE(fit.converged);
  EXPECT_TRUE(std::isnan(fit.fiducials[0].leave_one_out_mm));
  EXPECT_GE(fit.fiducials[0].p_value, 0.0);
}

TEST(FitPaired, ReportsWhenItDoesNotConverge) {
  std::mt19937 rng(kPairedSeed);
  auto pairs = noisy_pairs(rng, random_pose(rng), 8);
  EXPECT_FALSE(fit_paired(std::span(pairs).first(2)).converged);
  auto exact = pairs;
  exact[3].source_covariance.setZero();
  exact[3].target_covariance.setZero();
  EXPECT_FALSE(fit_paired(exact).converged);
  auto broken = pairs;
  broken[3].source_mm.x() = std::nan("");
  EXPECT_FALSE(fit_paired(broken).converged);
  const std::vector<PointPair> many(65, pairs[0]);
  EXPECT_FALSE(fit_paired(many).converged);
}

TEST(FitPaired, DoesNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  std::mt19937 rng(kPairedSeed);
  const auto pairs = noisy_pairs(rng, random_pose(rng), 64);
  const test::AllocationScope scope;
  EXPECT_TRUE(fit_paired(pairs).converged);
  EXPECT_EQ(scope.count(), 0U);
}

TEST(FitPaired, TheCounterCounts) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  const test::AllocationScope scope;
  std::vector<int> one(10);
  auto *two = static_cast<char *>(std::malloc(20));
  two = static_cast<char *>(std::realloc(two, 4000));
  EXPECT_GE(scope.count(), 3U);
  EXPECT_EQ(one[9], 0);
  std::free(two);
}

const std::vector<Vector3d> kMarkers = {{0, 0, 0}, {50, 0, 0}, {0, 35, 0}, {-20, -30, 8}};

// Compared with a tracker's least-squares fits to noisy markers, over many samples.
TEST(MarkerFitCovariance, AgreesWithSampling) {
  std::mt19937 rng(kPairedSeed);
  using TrackerFromTool = geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool>;
  const TrackerFromTool T(test::random_rotation(rng), Vector3d(120.0, -80.0, -1900.0));
  for (const std::uint32_t used : {0b1111U, 0b1011U}) {
    std::vector<Vector3d> source;
    for (std::size_t i = 0; i < kMarkers.size(); ++i) {
      if (((used >> i) & 1U) != 0) {
        source.push_back(kMarkers[i]);
      }
    }
    const auto predicted = marker_fit_covariance(kMarkers, used, T, 0.1, 0.25);
    const Vector3d tip(-150.0, 5.0, 10.0); // rotation errors are large at the tip
    const Matrix3d at_tip = uncertainty::tre_covariance(predicted, T * tip);
    Matrix3d sampled = Matrix3d::Zero();
    constexpr int kRuns = 20'000;
    for (int run = 0; run < kRuns; ++run) {
      std::vector<Vector3d> target;
      for (const Vector3d &m : source) {
        target.push_back(T * m + test::normal_vector(rng, 1.0).cwiseProduct(Vector3d(0.1, 0.1, 0.25)));
      }
      const Vector3d error = *fit_rigid(source, target) * tip - T * tip;
      sampled += error * error.transpose() / kRuns;
    }
    EXPECT_LT((sampled - at_tip).norm(), 0.04 * at_tip.norm()) << "markers " << used << " seed " << kPairedSeed;
  }
}

TEST(MarkerFitCovariance, FewerOrCollinearMarkersAreUnknown) {
  const geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool> T;
  EXPECT_TRUE(marker_fit_covariance(kMarkers, 0b0011U, T, 0.1, 0.25).hasNaN());
  EXPECT_TRUE(marker_fit_covariance(kMarkers, 0U, T, 0.1, 0.25).hasNaN());
  EXPECT_FALSE(marker_fit_covariance(kMarkers, 0b0111U, T, 0.1, 0.25).hasNaN());
  const std::vector<Vector3d> line = {{0, 0, 0}, {20, 0, 0}, {50, 0, 0}};
  EXPECT_TRUE(marker_fit_covariance(line, 0b111U, T, 0.1, 0.25).hasNaN());
  // Bits beyond the geometry are ignored.
  EXPECT_TRUE(marker_fit_covariance(kMarkers, 0xFFFFFFF3U, T, 0.1, 0.25)
                  .isApprox(marker_fit_covariance(kMarkers, 0b0011U, T, 0.1, 0.25)) ||
              marker_fit_covariance(kMarkers, 0xFFFFFFF3U, T, 0.1, 0.25).hasNaN());
}

TEST(MarkerFitCovariance, DoesNotAllocate) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  const geometry::Rigid3<geometry::frame::Tracker, geometry::frame::Tool> T;
  const test::AllocationScope scope;
  EXPECT_FALSE(marker_fit_covariance(kMarkers, 0b1111U, T, 0.1, 0.25).hasNaN());
  EXPECT_EQ(scope.count(), 0U);
}

} // namespace
