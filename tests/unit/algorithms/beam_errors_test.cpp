// The pose of a scan along one direction, with errors that its points have in common.
#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/geometry/angles.hpp"
#include "algorithms/registration/surface/beam_errors.hpp"
#include "algorithms/registration/twist.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
using geometry::frame::Source;
using geometry::frame::Target;

constexpr unsigned kBeamSeed = 20261129;
const Vector3d kDeep_mm(18.0, -12.0, 8.0);
const Vector3d kUp = Vector3d::UnitY(); // anterior, in the head's frame: the sensor looks at the face

struct Scan {
  std::vector<Vector3d> source_mm;
  Vector3d up_source;
  PairedPose T_true, start;
};

class BeamErrors : public ::testing::Test {
protected:
  // noise along the beam, as a range sensor has it
  Scan scan(std::size_t count, double noise_mm, double offset_mm, double excess_mm) {
    Scan out;
    out.T_true = test::random_pose<Target, Source>(rng_);
    const auto back = out.T_true.inverse();
    out.up_source = back.rotation() * kUp;
    std::normal_distribution<double> noise(0.0, noise_mm);
    const auto seen = [](const Vector3d &p) { return p.y() > 0.0; };
    for (const test::SurfaceSpot &spot : test::spots(mesh_, count, rng_, seen)) {
      const double too_far_mm = offset_mm + excess_mm * (1.0 - spot.normal.dot(kUp)) + noise(rng_);
      out.source_mm.push_back(back * (spot.point_mm - too_far_mm * kUp));
    }
    geometry::Vector6d away;
    away << test::normal_vector(rng_, 0.01), test::normal_vector(rng_, 1.0);
    out.start = moved_about(test::kHeadCentre, away, out.T_true);
    return out;
  }
  [[nodiscard]] static Vector3d error_mm(const Scan &scan, const PairedPose &T) {
    return T * (scan.T_true.inverse() * kDeep_mm) - kDeep_mm;
  }

  std::mt19937 rng_{kBeamSeed};
  surface::TriangleMesh mesh_ = test::make_head(4);
  surface::SurfaceModel surface_{mesh_};
  surface::SurfaceField field_{surface_};
};

BeamErrorOptions independent() {
  BeamErrorOptions options;
  options.sigma_mm = 0.7;
  options.model_sigma_mm = 0.0;
  options.offset_sigma_mm = 0.5;
  return options;
}

TEST_F(BeamErrors, TheExcessOnTiltedSkinIsFoundWithThePose) {
  const Scan s = scan(400, 0.02, 0.0, 6.0);
  const BeamErrorFit fit = fit_beam_errors(field_, s.source_mm, s.up_source, s.start, independent());
  ASSERT_TRUE(fit.converged);
  EXPECT_NEAR(fit.excess_mm, 6.0, 3.0 * fit.excess_sigma_mm);
  EXPECT_LT(fit.excess_sigma_mm, 1.0);
  EXPECT_LT(error_mm(s, fit.T_target_source).norm(), 0.1);
  BeamErrorOptions without = independent();
  without.excess_sigma_mm = 0.0;
  const BeamErrorFit as_read = fit_beam_errors(field_, s.source_mm, s.up_source, s.start, without);
  ASSERT_TRUE(as_read.converged);
  EXPECT_NEAR(as_read.excess_mm, 0.0, 1e-6);
  EXPECT_GT(error_mm(s, as_read.T_target_source).norm(), 0.4);
}

TEST_F(BeamErrors, AnOffsetMovesThePoseAndOnlyTheCovarianceTells) {
  const Scan s = scan(400, 0.02, 1.0, 0.0);
  const BeamErrorFit fit = fit_beam_errors(field_, s.source_mm, s.up_source, s.start, independent());
  ASSERT_TRUE(fit.converged);
  EXPECT_NEAR(error_mm(s, fit.T_target_source).dot(kUp), 1.0, 0.05);
  const geometry::Matrix3d predicted = uncertainty::tre_covariance(fit.covariance, kDeep_mm);
  EXPECT_GT(std::sqrt(kUp.dot(predicted * kUp)), 0.5);
}

TEST_F(BeamErrors, TheErrorAtADeepPointLiesInThePredictedRegion) {
  const BeamErrorOptions options = independent();
  std::normal_distribution<double> unit;
  constexpr int kRuns = 300;
  int inside = 0;
  for (int i = 0; i < kRuns; ++i) {
    const double offset_mm = options.offset_sigma_mm * unit(rng_);
    const Scan s = scan(i % 2 == 0 ? 60 : 300, options.sigma_mm, offset_mm, options.excess_sigma_mm * unit(rng_));
    const BeamErrorFit fit = fit_beam_errors(field_, s.source_mm, s.up_source, s.start, options);
    ASSERT_TRUE(fit.converged) << i;
    const geometry::Matrix3d predicted = uncertainty::tre_covariance(fit.covariance, kDeep_mm);
    inside += uncertainty::mahalanobis_squared(predicted, error_mm(s, fit.T_target_source)) <=
                      uncertainty::chi_square_upper_quantile(0.05, 3)
                  ? 1
                  : 0;
  }
  // The noise is along the beam and not along the normal: on tilted skin it counts for less than stated.
  EXPECT_GE(inside, 0.93 * kRuns);
}

TEST_F(BeamErrors, TooFewPointsAndOptionsOutOfRangeAreRefused) {
  const Scan s = scan(8, 0.1, 0.0, 0.0);
  const BeamErrorFit fit = fit_beam_errors(field_, s.source_mm, s.up_source, s.start);
  EXPECT_FALSE(fit.converged);
  EXPECT_FALSE(fit.covariance.allFinite());
  BeamErrorOptions wrong;
  wrong.sigma_mm = std::nan("");
  EXPECT_THROW(static_cast<void>(fit_beam_errors(field_, s.source_mm, s.up_source, s.start, wrong)),
               std::invalid_argument);
}

} // namespace
