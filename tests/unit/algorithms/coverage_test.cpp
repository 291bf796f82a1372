// Coverage of the predicted uncertainty. Over many simulated registrations the true error at a deep target must lie
// inside the predicted 95 % ellipsoid in 95 % of the cases.
#include <cmath>
#include <cstdio>
#include <tuple>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "algorithms/registration/registration.hpp"
#include "algorithms/registration/surface/tilt_excess.hpp"
#include "algorithms/registration/twist.hpp"
#include "algorithms/uncertainty/distributions.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using registration::FiducialObservation;
using registration::ImageFromReference;
using registration::Matrix3d;
using registration::PointPair;
using registration::SurfaceSample;
using registration::Vector3d;
constexpr unsigned kSeed = 20260201;

// Around the head above the ears, with the face, 80 to 100 mm from the target.
std::vector<Vector3d> fiducials_on_head() {
  std::vector<Vector3d> out;
  for (const Vector3d &direction :
       {Vector3d(0.2, 1, 0.3), Vector3d(-0.6, 0.8, 0.1), Vector3d(0.9, 0.4, 0.1), Vector3d(-1, 0, 0.2),
        Vector3d(1, -0.4, 0.3), Vector3d(-0.5, -0.8, 0.4), Vector3d(0.1, -0.3, 1), Vector3d(-0.2, 0.5, 0.9)}) {
    out.push_back(test::on_head(direction));
  }
  return out;
}

const Vector3d kTarget(12.0, -20.0, 5.0);

struct Coverage {
  int inside = 0;
  int runs = 0;
  double squared_true = 0.0;
  double squared_predicted = 0.0;

  void add(const Matrix3d &predicted, const Vector3d &error) {
    ++runs;
    inside +=
        uncertainty::mahalanobis_squared(predicted, error) <= uncertainty::chi_square_upper_quantile(0.05, 3) ? 1 : 0;
    squared_true += error.squaredNorm();
    squared_predicted += predicted.trace();
  }
  [[nodiscard]] double percent() const { return 100.0 * inside / runs; }
  void print(const char *what) const {
    std::printf("%s: %.1f %% of %d in the predicted 95 %% (seed %u); RMS TRE true %.3f mm, predicted %.3f mm\n", what,
                percent(), runs, kSeed, std::sqrt(squared_true / runs), std::sqrt(squared_predicted / runs));
  }
};

template <class Errors> Coverage simulate_paired(Errors &&errors_of_a_touch) {
  std::mt19937 rng(kSeed);
  const std::vector<Vector3d> image = fiducials_on_head();
  Coverage out;
  for (int run = 0; run < 2000; ++run) {
    const auto T_true = test::random_pose<geometry::frame::Target, geometry::frame::Source>(rng);
    std::vector<PointPair> pairs;
    for (const Vector3d &p : image) {
      PointPair pair;
      std::tie(pair.source_covariance, pair.target_covariance) = errors_of_a_touch(rng);
      pair.source_mm = T_true.inverse() * p + test::draw(rng, pair.source_covariance);
      pair.target_mm = p + test::draw(rng, pair.target_covariance);
      pairs.push_back(pair);
    }
    const auto fit = registration::fit_paired(pairs);
    EXPECT_TRUE(fit.converged) << "run " << run;
    const Vector3d target_in_reference = T_true.inverse() * kTarget;
    out.add(uncertainty::tre_covariance(fit.covariance, kTarget), fit.T_target_source * target_in_reference - kTarget);
  }
  return out;
}

TEST(Coverage, FiducialsWithIsotropicErrors) {
  const auto coverage = simulate_paired([](std::mt19937 &) {
    return std::pair<Matrix3d, Matrix3d>(0.4 * 0.4 * Matrix3d::Identity(), 0.5 * 0.5 * Matrix3d::Identity());
  });
  coverage.print("isotropic");
  EXPECT_GE(coverage.percent(), 93.0);
  EXPECT_LE(coverage.percent(), 97.0);
}

TEST(Coverage, FiducialsWithIndividualAnisotropicErrors) {
  const auto coverage = simulate_paired([](std::mt19937 &rng) {
    const Matrix3d touch = test::random_anisotropic(rng, 0.15, 0.6);
    const Matrix3d image = test::random_anisotropic(rng, 0.3, 0.8);
    return std::pair<Matrix3d, Matrix3d>(touch, image);
  });
  coverage.print("anisotropic");
  EXPECT_GE(coverage.percent(), 93.0);
  EXPECT_LE(coverage.percent(), 97.0);
}

constexpr double kSkinSigma = 0.7;
constexpr double kSkinLength = 12.0;

template <class SkinError> Coverage simulate_joint(double correlation_length_mm, int runs, SkinError &&skin_error) {
  std::mt19937 rng(kSeed);
  const auto mesh = test::make_head(4);
  const surface::SurfaceModel surface(mesh);
  registration::RegistrationOptions options;
  options.surface_sigma_mm = kSkinSigma;
  options.correlation_length_mm = correlation_length_mm;
  options.max_target_tre_mm = 10.0;
  registration::RegistrationEstimator estimator(&surface, options);
  const std::vector<Vector3d> image = fiducials_on_head();
  const Matrix3d touch = 0.3 * 0.3 * Matrix3d::Identity();
  const Matrix3d placed = 0.5 * 0.5 * Matrix3d::Identity();
  const Matrix3d tip = 0.15 * 0.15 * Matrix3d::Identity();
  Coverage out;
  for (int run = 0; run < runs; ++run) {
    const auto T_true = test::random_pose<geometry::frame::Image, geometry::frame::Reference>(rng);
    const auto T_back = T_true.inverse();
    std::vector<FiducialObservation> fiducials;
    for (const Vector3d &p : image) {
      fiducials.push_back({T_back * p + test::draw(rng, touch), touch, p + test::draw(rng, placed), placed});
    }
    // The part of the scalp and forehead that a pointer can reach.
    const auto traced =
        test::spots(mesh, 200, rng, [](const Vector3d &p) { return p.z() > 20.0 || (p.y() > 40.0 && p.z() > -30.0); });
    const auto error_at = skin_error(rng);
    std::vector<SurfaceSample> samples;
    for (const auto &spot : traced) {
      samples.push_back({T_back * (spot.point_mm + error_at(spot.point_mm) * spot.normal) + test::draw(rng, tip), tip});
    }
    const auto &result = estimator.estimate(fiducials, samples, {});
    EXPECT_TRUE(result.has_estimate) << "run " << run;
    const Vector3d error = result.T_image_reference * (T_back * kTarget) - kTarget;
    out.add(uncertainty::tre_covariance(result.covariance, kTarget), error);
  }
  return out;
}

TEST(Coverage, JointEstimateWithIndependentSkinErrors) {
  const auto coverage = simulate_joint(1e-3, 1000, [](std::mt19937 &rng) {
    return [&rng](const Vector3d &) { return std::normal_distribution<double>(0.0, kSkinSigma)(rng); };
  });
  coverage.print("joint, independent skin errors");
  EXPECT_GE(coverage.percent(), 92.0);
  EXPECT_LE(coverage.percent(), 98.0);
}

TEST(Coverage, JointEstimateWithSkinErrorsCorrelatedOver12mm) {
  const auto coverage = simulate_joint(kSkinLength, 1000, [](std::mt19937 &rng) {
    return [field = test::SmoothField(rng, kSkinLength)](const Vector3d &p) { return kSkinSigma * field(p); };
  });
  coverage.print("joint, correlated skin errors");
  EXPECT_GE(coverage.percent(), 92.0);
  EXPECT_LE(coverage.percent(), 98.0);
}

// Without the correlation the predicted errors of the same data are far too small.
TEST(Coverage, IgnoringCorrelationUnderestimatesTheError) {
  const auto coverage = simulate_joint(1e-3, 150, [](std::mt19937 &rng) {
    return [field = test::SmoothField(rng, kSkinLength)](const Vector3d &p) { return kSkinSigma * field(p); };
  });
  coverage.print("joint, correlated skin errors taken as independent");
  EXPECT_LT(coverage.percent(), 85.0);
}

// A range sensor over the face, which reads too far on tilted skin by what is drawn anew for each scan.
TEST(Coverage, FaceScansThatReadTooFarOnTiltedSkin) {
  std::mt19937 rng(kSeed);
  const auto mesh = test::make_head(4);
  const surface::SurfaceModel surface(mesh);
  registration::RegistrationOptions options;
  options.surface_sigma_mm = kSkinSigma;
  options.max_target_tre_mm = 10.0;
  registration::RegistrationEstimator estimator(&surface, options);
  auto as_read = options;
  as_read.excess_sigma_mm = 0.0;
  registration::RegistrationEstimator without(&surface, as_read);
  const Vector3d up = Vector3d::UnitY();
  const Vector3d across = Vector3d(0.6, 0.0, 0.8);
  constexpr double kNoise_mm = 0.8;
  std::normal_distribution<double> unit;
  Coverage out;
  Coverage out_without;
  for (int run = 0; run < 200; ++run) {
    const auto T_true = test::random_pose<geometry::frame::Image, geometry::frame::Reference>(rng);
    const auto T_back = T_true.inverse();
    const Vector3d excess = options.excess_sigma_mm * Vector3d(unit(rng), 0.5 * unit(rng), 0.5 * unit(rng));
    const auto scanned =
        test::spots(mesh, 250, rng, [](const Vector3d &p) { return p.y() > 25.0 && std::abs(p.z()) < 60.0; });
    const test::SmoothField skin(rng, kSkinLength);
    std::vector<SurfaceSample> samples;
    for (const auto &spot : scanned) {
      const double too_far_mm = registration::excess_terms(spot.normal, up, across).dot(excess);
      const Vector3d p =
          spot.point_mm + kSkinSigma * skin(spot.point_mm) * spot.normal - (too_far_mm + kNoise_mm * unit(rng)) * up;
      const Vector3d u = T_back.rotation() * up;
      samples.push_back({T_back * p, kNoise_mm * kNoise_mm * u * u.transpose(), u, T_back.rotation() * across});
    }
    geometry::Vector6d away;
    away << test::normal_vector(rng, 0.01), test::normal_vector(rng, 1.0);
    const auto start = registration::moved_about(test::kHeadCentre, away, T_true);
    const auto error_of = [&](const registration::RegistrationResult &result) -> Vector3d {
      return result.T_image_reference * (T_back * kTarget) - kTarget;
    };
    const auto &result = estimator.estimate_located({}, samples, {}, start);
    ASSERT_TRUE(result.has_estimate) << "run " << run;
    out.add(uncertainty::tre_covariance(result.covariance, kTarget), error_of(result));
    const auto &plain = without.estimate_located({}, samples, {}, start);
    if (plain.has_estimate) {
      out_without.add(uncertainty::tre_covariance(plain.covariance, kTarget), error_of(plain));
    }
  }
  out.print("face scans");
  out_without.print("face scans, tilted skin as it is read");
  EXPECT_GE(out.percent(), 92.0);
  EXPECT_LE(out.percent(), 98.0);
  EXPECT_LT(out_without.percent(), 90.0);
}

} // namespace
