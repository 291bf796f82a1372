// The joint estimate: results, refusals and their texts.
#include <algorithm>
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "algorithms/registration/registration.hpp"
#include "algorithms/registration/surface/tilt_excess.hpp"
#include "algorithms/uncertainty/tre.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/algorithms/head.hpp"

namespace {

using namespace bregma;
using namespace bregma::registration;
constexpr unsigned kRegistrationSeed = 20260208;
const Vector3d kTarget(12.0, -20.0, 5.0);

struct Patient {
  explicit Patient(unsigned seed, int subdivisions = 4)
      : rng(seed), mesh(test::make_head(subdivisions)), surface(mesh),
        T_true(test::random_pose<geometry::frame::Image, geometry::frame::Reference>(rng)) {}

  void touch(const Vector3d &direction, double sigma_mm = 0.3) {
    const Matrix3d of_touch = 0.3 * 0.3 * Matrix3d::Identity();
    const Matrix3d of_image = 0.5 * 0.5 * Matrix3d::Identity();
    const Vector3d p = test::on_head(direction);
    const double scale = sigma_mm / 0.3;
    fiducials.push_back({T_true.inverse() * p + scale * test::draw(rng, of_touch), of_touch,
                         p + scale * test::draw(rng, of_image), of_image});
  }
  void touch_eight(double sigma_mm = 0.3) {
    for (const Vector3d &direction :
         {Vector3d(0.2, 1, 0.3), Vector3d(-0.6, 0.8, 0.1), Vector3d(0.9, 0.4, 0.1), Vector3d(-1, 0, 0.2),
          Vector3d(1, -0.4, 0.3), Vector3d(-0.5, -0.8, 0.4), Vector3d(0.1, -0.3, 1), Vector3d(-0.2, 0.5, 0.9)}) {
      touch(direction, sigma_mm);
    }
  }
  template <class Condition> void trace(std::size_t count, Condition &&wanted, double sigma_mm = 0.5) {
    const test::SmoothField skin(rng, 12.0);
    for (const auto &spot : test::spots(mesh, count, rng, wanted)) {
      samples.push_back({T_true.inverse() * (spot.point_mm + sigma_mm * skin(spot.point_mm) * spot.normal),
                         0.1 * 0.1 * Matrix3d::Identity()});
    }
  }
  void trace_scalp(std::size_t count) {
    trace(count, [](const Vector3d &p) { return p.z() > 20.0; });
  }
  // Samples of a range sensor that looks at the face and reads too far by this and its slopes, on tilted skin.
  template <class Condition> void scan(std::size_t count, const Vector3d &excess_mm, Condition &&wanted) {
    const auto back = T_true.inverse();
    const Vector3d up = Vector3d::UnitY();
    const Vector3d across = Vector3d::UnitX();
    for (const auto &spot : test::spots(mesh, count, rng, wanted)) {
      const double too_far_mm = excess_terms(spot.normal, up, across).dot(excess_mm);
      samples.push_back({back * (spot.point_mm - too_far_mm * up), 0.1 * 0.1 * Matrix3d::Identity(),
                         back.rotation() * up, back.rotation() * across});
    }
  }
  [[nodiscard]] ImageFromReference near_truth() const {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.01, Vector3d(1, -1, 1).normalized()));
    return {turn * T_true.rotation(), turn * T_true.translation() + Vector3d(1, -0.5, 1)};
  }
  [[nodiscard]] double true_tre(const ImageFromReference &T) const {
    return (T * (T_true.inverse() * kTarget) - kTarget).norm();
  }

  std::mt19937 rng;
  surface::TriangleMesh mesh;
  surface::SurfaceModel surface;
  ImageFromReference T_true;
  std::vector<FiducialObservation> fiducials;
  std::vector<SurfaceSample> samples;
};

const std::vector<Vector3d> kTargets = {kTarget};

std::string words(const RegistrationResult &result, const RegistrationOptions &options = {}) {
  std::array<char, 256> text;
  describe(result, options, "Nasion", "Thalamus_L", text);
  return text.data();
}

TEST(Registration, SkinAloneRegistersFromALocatedPoseAndContradictsAWrongFiducial) {
  Patient patient(kRegistrationSeed);
  patient.trace(600, [](const Vector3d &p) { return p.z() > -40.0; }); // all around, with the nose
  RegistrationEstimator estimator(&patient.surface, {});
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.02, Vector3d(1, -1, 1).normalized()));
  const ImageFromReference located(turn * patient.T_true.rotation(),
                                   turn * patient.T_true.translation() + Vector3d(2, -1, 2));
  const auto alone = estimator.estimate_located({}, patient.samples, kTargets, located);
  ASSERT_TRUE(alone.has_estimate) << words(alone) << " seed " << kRegistrationSeed;
  EXPECT_EQ(alone.fiducial_count, 0);
  EXPECT_TRUE(std::isnan(alone.fre_mm)) << "no fiducials, no FRE";
  EXPECT_LT(patient.true_tre(alone.T_image_reference), 3.0 * alone.worst_target_tre_mm);

  patient.touch({0.2, 1, 0.3});
  EXPECT_NE(estimator.estimate_located(patient.fiducials, patient.samples, kTargets, located).refusal,
            Refusal::kContradictingFiducial);
  patient.fiducials.front().reference_mm += Vector3d(10, 10, 10);
  const auto &wrong = estimator.estimate_located(patient.fiducials, patient.samples, kTargets, located);
  EXPECT_EQ(wrong.refusal, Refusal::kContradictingFiducial);
  EXPECT_EQ(wrong.suspect, 0);
}

std::string excess_words(const RegistrationResult &result, const RegistrationOptions &options = {}) {
  std::array<char, 256> text;
  describe_excess(result, options, text);
  return text.data();
}

TEST(Registration, WhatARangeSensorReadsTooFarOnTiltedSkinIsEstimatedWithThePose) {
  Patient patient(kRegistrationSeed);
  const Vector3d excess(6.0, 1.5, -1.0);
  patient.scan(400, excess, [](const Vector3d &p) { return p.y() > 10.0 && std::abs(p.z()) < 60.0; });
  RegistrationOptions options;
  options.surface_sigma_mm = 0.1; // with less exact skin the prior draws the excess towards zero
  RegistrationEstimator estimator(&patient.surface, options);
  const auto result = estimator.estimate_located({}, patient.samples, kTargets, patient.near_truth());
  ASSERT_TRUE(result.has_estimate) << words(result) << " seed " << kRegistrationSeed;
  EXPECT_EQ(result.beam_count, 400);
  EXPECT_LT((result.excess_mm - excess).norm(), 1.0) << result.excess_mm.transpose();
  EXPECT_LT(result.excess_sigma_mm, 2.0);
  EXPECT_LT(patient.true_tre(result.T_image_reference), 0.15);
  EXPECT_LT(result.surface_rms_mm, 0.1);
  EXPECT_NE(excess_words(result).find("times 1 - cos(tilt): removed"), std::string::npos) << excess_words(result);

  RegistrationOptions as_read = options;
  as_read.excess_sigma_mm = 0.0;
  RegistrationEstimator without(&patient.surface, as_read);
  const auto &plain = without.estimate_located({}, patient.samples, kTargets, patient.near_truth());
  EXPECT_EQ(plain.excess_mm, Vector3d::Zero());
  EXPECT_EQ(excess_words(plain, as_read), "");
  EXPECT_GT(patient.true_tre(plain.T_image_reference), 0.5);
}

TEST(Registration, AnExcessThatTheScanDoesNotShowKeepsItsPriorAndIsSaid) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  RegistrationEstimator estimator(&patient.surface, {});
  const auto touched = estimator.estimate(patient.fiducials, {}, kTargets);
  EXPECT_EQ(excess_words(touched), "");
  // Skin that faces the sensor: the front of the cheeks, without the nose.
  patient.scan(100, Vector3d(6.0, 0.0, 0.0), [](const Vector3d &p) {
    return p.y() > 70.0 && p.y() < 78.0 && std::abs(p.x()) > 12.0 && std::abs(p.x()) < 18.0 && std::abs(p.z()) < 20.0;
  });
  const auto flat = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  ASSERT_TRUE(flat.has_estimate) << words(flat);
  EXPECT_GT(flat.excess_sigma_mm, 0.7 * RegistrationOptions().excess_sigma_mm);
  EXPECT_NE(excess_words(flat).find("does not show"), std::string::npos) << excess_words(flat);
  patient.samples.resize(1);
  const auto &one = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  ASSERT_TRUE(one.has_estimate);
  EXPECT_NEAR(one.excess_sigma_mm, RegistrationOptions().excess_sigma_mm, 0.1);
  EXPECT_NE(excess_words(one).find("5.0 mm, 1 sigma, is assumed"), std::string::npos) << excess_words(one);
}

TEST(Registration, FindsThePatientAndTheSurfaceHelps) {
  double with = 0.0;
  double without = 0.0;
  for (unsigned seed = kRegistrationSeed; seed < kRegistrationSeed + 40; ++seed) {
    Patient patient(seed);
    patient.touch_eight();
    patient.trace_scalp(300);
    RegistrationEstimator estimator(&patient.surface, {});
    const auto alone = estimator.estimate(patient.fiducials, {}, kTargets);
    ASSERT_EQ(alone.refusal, Refusal::kNone) << words(alone) << " seed " << seed;
    const auto joint = estimator.estimate(patient.fiducials, patient.samples, kTargets);
    ASSERT_EQ(joint.refusal, Refusal::kNone) << words(joint) << " seed " << seed;
    EXPECT_EQ(words(joint), "");
    EXPECT_EQ(joint.surface_count, 300);
    EXPECT_LT(joint.worst_target_tre_mm, alone.worst_target_tre_mm);
    EXPECT_EQ(joint.worst_target, 0);
    EXPECT_LT(joint.surface_effective, 100.0); // 300 samples of skin with a correlation length of 12 mm
    EXPECT_GT(joint.surface_effective, 10.0);
    EXPECT_NEAR(joint.fre_mm, joint.fre_expected_mm, 0.6 * joint.fre_expected_mm);
    with += std::pow(patient.true_tre(joint.T_image_reference), 2);
    without += std::pow(patient.true_tre(alone.T_image_reference), 2);
  }
  EXPECT_LT(with, 0.7 * without);
}

TEST(Registration, WithoutSurfaceItEqualsThePairedFit) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  std::vector<PointPair> pairs;
  for (const auto &f : patient.fiducials) {
    pairs.push_back({f.reference_mm, f.image_mm, f.reference_covariance, f.image_covariance});
  }
  const auto fit = fit_paired(pairs);
  RegistrationEstimator estimator(nullptr, {});
  const auto &result = estimator.estimate(patient.fiducials, {}, kTargets);
  EXPECT_LT((result.T_image_reference.matrix() - fit.T_target_source.matrix()).norm(), 1e-5);
  EXPECT_TRUE(result.covariance.isApprox(fit.covariance, 1e-5));
  EXPECT_NEAR(result.fre_mm, fit.fre_mm, 1e-5);
  EXPECT_EQ(result.surface_count, 0);
}

TEST(Registration, StartsFromThePreviousEstimateAndIgnoresAFarOne) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  patient.trace_scalp(300);
  RegistrationEstimator estimator(&patient.surface, {});
  const auto cold = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  const auto warm = estimator.estimate(patient.fiducials, patient.samples, kTargets, &cold.T_image_reference);
  EXPECT_LE(warm.iterations, cold.iterations);
  EXPECT_LT((warm.T_image_reference.matrix() - cold.T_image_reference.matrix()).norm(), 1e-3);
  const ImageFromReference wild(test::random_rotation(patient.rng), Vector3d(500.0, 0.0, 0.0));
  const auto saved = estimator.estimate(patient.fiducials, patient.samples, kTargets, &wild);
  EXPECT_LT((saved.T_image_reference.matrix() - cold.T_image_reference.matrix()).norm(), 1e-9);
}

// A trace that leaves the skin, or a pointer on the drape: a fifth of the samples are outliers.
TEST(Registration, SurfaceOutliersHaveNoWeight) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  patient.trace_scalp(300);
  RegistrationEstimator estimator(&patient.surface, {});
  const auto clean = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  const Vector3d head_in_reference = patient.T_true.inverse() * test::kHeadCentre;
  for (std::size_t i = 0; i < 60; ++i) {
    Vector3d &p = patient.samples[i].reference_mm;
    p += (8.0 + 0.1 * static_cast<double>(i)) * (p - head_in_reference).normalized();
  }
  const auto robust = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_EQ(robust.refusal, Refusal::kNone) << words(robust);
  EXPECT_GE(robust.surface_left_out, 50);
  EXPECT_LT((robust.T_image_reference * (clean.T_image_reference.inverse() * kTarget) - kTarget).norm(), 0.3);
}

TEST(Registration, SamplesThatAreNotFiniteAreIgnored) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  patient.trace_scalp(100);
  RegistrationEstimator estimator(&patient.surface, {});
  const auto clean = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  for (std::size_t i = 0; i < 40; ++i) {
    patient.samples.insert(patient.samples.begin() + static_cast<std::ptrdiff_t>(2 * i),
                           {Vector3d(std::nan(""), 1.0, 2.0), Matrix3d::Zero()});
  }
  const auto &result = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_EQ(result.surface_count, 100);
  EXPECT_EQ(result.T_image_reference.matrix(), clean.T_image_reference.matrix());
}

TEST(Registration, SurfaceErrorsAboveTheStatedSigmaReduceItsWeight) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  patient.trace(
      300, [](const Vector3d &p) { return p.z() > 20.0; }, 2.0);
  RegistrationEstimator estimator(&patient.surface, {}); // states 0.7 mm
  const auto &result = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_GT(result.surface_scale, 1.8);
  EXPECT_LT(result.surface_scale, 4.0);
  EXPECT_GT(result.surface_rms_mm, 1.2);
}

TEST(Registration, GoodFiducialsAreNotRefused) {
  int refused = 0;
  constexpr int kRuns = 2000;
  Patient patient(kRegistrationSeed, 2);
  RegistrationEstimator estimator(nullptr, {});
  for (int run = 0; run < kRuns; ++run) {
    patient.fiducials.clear();
    patient.touch_eight();
    refused += estimator.estimate(patient.fiducials, {}, kTargets).refusal == Refusal::kNone ? 0 : 1;
  }
  EXPECT_LE(refused, kRuns / 200) << "seed " << kRegistrationSeed; // 0.5 %; 0.2 % stated
}

TEST(RegistrationRefusal, TooFewFiducials) {
  Patient patient(kRegistrationSeed);
  patient.touch({0, 1, 0.2});
  patient.touch({1, 0, 0.2});
  patient.trace_scalp(300);
  RegistrationEstimator estimator(&patient.surface, {});
  const auto &result = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_EQ(result.refusal, Refusal::kTooFewFiducials);
  EXPECT_FALSE(result.has_estimate);
  EXPECT_EQ(words(result), "2 fiducials touched, at least 3 are needed");
}

TEST(RegistrationRefusal, NearlyCollinearFiducials) {
  Patient patient(kRegistrationSeed);
  for (const double s : {-40.0, -10.0, 15.0, 45.0}) {
    patient.touch({0, 1, 0.2});
    const Vector3d p(s, 60.0 + 0.05 * std::abs(s), 20.0);
    patient.fiducials.back().image_mm = p;
    patient.fiducials.back().reference_mm = patient.T_true.inverse() * p;
  }
  RegistrationEstimator estimator(&patient.surface, {});
  const auto &result = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_EQ(result.refusal, Refusal::kCollinearFiducials);
  EXPECT_FALSE(result.has_estimate);
  EXPECT_EQ(words(result),
            "the 4 fiducials lie nearly on a line (0.8 mm off it, 5.0 mm needed): touch one away from it");
}

TEST(RegistrationRefusal, AFiducialThatContradictsTheOthersIsNamed) {
  for (const double off_mm : {4.0, 8.0, 30.0}) {
    int named = 0;
    constexpr int kRuns = 50;
    for (unsigned seed = kRegistrationSeed; seed < kRegistrationSeed + kRuns; ++seed) {
      Patient patient(seed, 2);
      patient.touch_eight();
      patient.fiducials[5].reference_mm += off_mm * test::normal_vector(patient.rng, 1.0).normalized();
      RegistrationEstimator estimator(nullptr, {});
      const auto &result = estimator.estimate(patient.fiducials, {}, kTargets);
      if (result.refusal == Refusal::kContradictingFiducial && result.suspect == 5) {
        ++named;
        const std::string text = words(result);
        EXPECT_EQ(text.rfind("fiducial Nasion contradicts the others: ", 0), 0U) << text;
        EXPECT_NE(text.find(" mm from where they place it; touch it again or remove it"), std::string::npos) << text;
        EXPECT_NEAR(result.fiducials[5].leave_one_out_mm, off_mm, 0.2 * off_mm + 1.5);
        EXPECT_TRUE(result.has_estimate); // so that residuals can be shown
      }
    }
    EXPECT_GE(named, off_mm > 5.0 ? kRuns : kRuns - 8) << off_mm << " mm";
  }
}

TEST(RegistrationRefusal, TwoSwappedFiducialsAreBothNamed) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  const double apart_mm = (patient.fiducials[1].image_mm - patient.fiducials[4].image_mm).norm();
  std::swap(patient.fiducials[1].image_mm, patient.fiducials[4].image_mm);
  RegistrationEstimator estimator(nullptr, {});
  const auto &result = estimator.estimate(patient.fiducials, {}, kTargets);
  EXPECT_EQ(result.refusal, Refusal::kContradictingFiducial);
  EXPECT_EQ(result.suspect_count, 2);
  for (std::size_t i = 0; i < 8; ++i) {
    EXPECT_EQ(result.suspects[i], i == 1 || i == 4) << i;
  }
  EXPECT_LT(result.fiducials[1].p_value, 1e-9);
  EXPECT_GT(result.fiducials[0].p_value, 1e-3); // from the consistent fiducials, not from the corrupted estimate
  EXPECT_NEAR(result.fiducials[4].leave_one_out_mm, apart_mm, 4.0);
  const std::string text = words(result);
  EXPECT_EQ(text.rfind("fiducials Nasion contradict the others: up to ", 0), 0U) << text;
  EXPECT_NE(text.find("touch them again or remove them"), std::string::npos) << text;
}

TEST(RegistrationRefusal, FourWrongOfEightCannotBeIdentified) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  for (const std::size_t i : {0U, 2U, 5U, 7U}) {
    patient.fiducials[i].reference_mm += 25.0 * test::normal_vector(patient.rng, 1.0).normalized();
  }
  RegistrationEstimator estimator(nullptr, {});
  const auto &result = estimator.estimate(patient.fiducials, {}, kTargets);
  EXPECT_EQ(result.refusal, Refusal::kFreTooLarge);
  EXPECT_EQ(result.suspect_count, 0);
  const std::string text = words(result);
  EXPECT_EQ(text.rfind("FRE is ", 0), 0U) << text;
  EXPECT_NE(text.find("where the stated errors give 0.8"), std::string::npos) << text;
  EXPECT_NE(text.find("the wrong fiducials cannot be identified: touch them again"), std::string::npos) << text;
}

TEST(RegistrationRefusal, AWrongOneOfThreeFiducialsCannotBeIdentified) {
  Patient patient(kRegistrationSeed);
  for (const Vector3d &direction : {Vector3d(0, 1, 0.2), Vector3d(1, 0, 0.2), Vector3d(-1, -0.3, 0.4)}) {
    patient.touch(direction);
  }
  patient.fiducials[0].reference_mm.x() += 12.0;
  patient.fiducials[0].reference_mm.y() += 12.0;
  RegistrationEstimator estimator(nullptr, {});
  EXPECT_EQ(estimator.estimate(patient.fiducials, {}, kTargets).refusal, Refusal::kFreTooLarge);
}

// Three fiducials close together on the forehead do not determine the rotation until enough skin is traced.
TEST(RegistrationRefusal, AnUndeterminedDirectionIsNamedUntilTheSurfaceDeterminesIt) {
  Patient patient(kRegistrationSeed);
  for (const Vector3d &direction : {Vector3d(0, 1, 0.3), Vector3d(0.25, 1, 0.32), Vector3d(0.1, 1, 0.5)}) {
    patient.touch(direction, 0.1);
  }
  RegistrationEstimator estimator(&patient.surface, {});
  const auto &open = estimator.estimate(patient.fiducials, {}, kTargets);
  EXPECT_EQ(open.refusal, Refusal::kDirectionNotFixed);
  const std::string text = words(open);
  EXPECT_EQ(text.rfind("too little surface to fix rotation about ", 0), 0U) << text;
  EXPECT_NE(text.find(": predicted error at Thalamus_L "), std::string::npos) << text;
  EXPECT_NE(text.find(" mm, limit 2.0 mm; trace more of the head"), std::string::npos) << text;
  // A small patch near the fiducials is not sufficient.
  patient.trace(40, [](const Vector3d &p) { return (p - test::on_head({0, 1, 0.35})).norm() < 18.0; });
  EXPECT_EQ(estimator.estimate(patient.fiducials, patient.samples, kTargets).refusal, Refusal::kDirectionNotFixed);
  patient.trace(300, [](const Vector3d &p) { return p.z() > -40.0 && (p.z() > 10.0 || p.y() > 20.0); });
  const auto &fixed = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_EQ(fixed.refusal, Refusal::kNone) << words(fixed);
  EXPECT_LT(patient.true_tre(fixed.T_image_reference), 3.0);
}

TEST(RegistrationRefusal, WithoutTargetsTheHeadsCentreIsUsed) {
  Patient patient(kRegistrationSeed);
  for (const Vector3d &direction : {Vector3d(0, 1, 0.3), Vector3d(0.25, 1, 0.32), Vector3d(0.1, 1, 0.5)}) {
    patient.touch(direction, 0.1);
  }
  RegistrationEstimator estimator(&patient.surface, {});
  const auto &result = estimator.estimate(patient.fiducials, {}, {});
  EXPECT_EQ(result.refusal, Refusal::kDirectionNotFixed);
  EXPECT_EQ(result.worst_target, -1);
  std::array<char, 256> text;
  describe(result, {}, "", "", text);
  EXPECT_NE(std::string(text.data()).find("predicted error at a point inside the head "), std::string::npos)
      << text.data();
}

TEST(RegistrationRefusal, DirectionsHaveNames) {
  geometry::Vector6d d = geometry::Vector6d::Zero();
  d[3] = 0.9;
  d[1] = 0.2;
  EXPECT_EQ(name_direction(d), "translation along left-right");
  d << 0.1, 0.0, -0.9, 0.3, 0.2, 0.0;
  EXPECT_EQ(name_direction(d), "rotation about superior-inferior");
  d << 0.1, 0.8, -0.3, 0.3, 0.2, 0.0;
  EXPECT_EQ(name_direction(d), "rotation about anterior-posterior");
}

TEST(RegistrationRefusal, NotConverged) {
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  patient.trace_scalp(300);
  RegistrationOptions options;
  options.max_iterations = 1;
  RegistrationEstimator estimator(&patient.surface, options);
  const auto &result = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_EQ(result.refusal, Refusal::kNotConverged);
  EXPECT_FALSE(result.has_estimate);
  EXPECT_EQ(words(result, options), "the estimate did not converge in 1 iterations");
}

TEST(RegistrationRefusal, ALongTextIsCutNotOverrun) {
  RegistrationResult result;
  std::array<char, 8> text;
  text.fill('x');
  describe(result, {}, "", "", text);
  EXPECT_STREQ(text.data(), "0 fiduc");
}

TEST(Registration, EstimatesWithoutAllocation) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "the sanitizer owns malloc";
  }
  Patient patient(kRegistrationSeed);
  patient.touch_eight();
  patient.trace_scalp(300);
  RegistrationEstimator estimator(&patient.surface, {});
  auto contradicting = patient.fiducials;
  contradicting[2].reference_mm.x() += 9.0;
  std::array<char, 256> text;
  const test::AllocationScope scope;
  const auto &good = estimator.estimate(patient.fiducials, patient.samples, kTargets);
  EXPECT_EQ(good.refusal, Refusal::kNone);
  const auto &bad = estimator.estimate(contradicting, patient.samples, kTargets);
  EXPECT_EQ(bad.refusal, Refusal::kContradictingFiducial);
  describe(bad, estimator.options(), "Nasion", "Thalamus_L", text);
  EXPECT_EQ(scope.count(), 0U);
}

} // namespace
