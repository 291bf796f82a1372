// Rigid registration of images: poses are found from any start, and what cannot be registered is not "found".
#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include <gtest/gtest.h>

#include "algorithms/intensity/rigid_image.hpp"
#include "algorithms/intensity/rigid_verdict.hpp"
#include "tests/unit/algorithms/intensity/phantom.hpp"

namespace bregma::intensity {
namespace {

using Eigen::Vector3d;

constexpr unsigned kImageSeed = 20260407;
constexpr double kScale = 2.6; // of the phantom: to the size of a head

// The body in an image whose header places it by T_image_body; `other`: with grey values of another modality and noise.
Volume head(std::array<int, 3> size, double spacing_mm, const ReferenceFromFloating &T_body_image, bool other) {
  Eigen::Affine3d to_body = Eigen::Affine3d::Identity();
  to_body.scale(1.0 / kScale);
  to_body.matrix() *= T_body_image.matrix();
  Volume out;
  out.size = size;
  // The grid is centred on the body.
  const Vector3d centre = T_body_image.inverse() * Vector3d::Zero();
  for (int d = 0; d < 3; ++d) {
    out.T_image_index(d, d) = spacing_mm;
    out.T_image_index(d, 3) = centre[d] - 0.5 * spacing_mm * (size[static_cast<std::size_t>(d)] - 1);
  }
  std::mt19937 rng(kImageSeed);
  std::normal_distribution<float> normal(0.0F, 3.0F);
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    const float grey = test::phantom_grey(to_body * out.pixel_mm(i));
    out.voxels.push_back(other ? 90.0F * std::sin(grey / 45.0F) + normal(rng) : grey);
  }
  return out;
}
Volume reference_head() { return head({52, 60, 48}, 3.2, {}, false); }

RigidImageOptions quick() {
  RigidImageOptions options;
  options.finest_mm = 3.2;
  options.max_samples = 30'000;
  options.measure_options.tail = 0.001;
  return options;
}

ReferenceFromFloating placed(const Vector3d &rotation_deg, const Vector3d &translation_mm) {
  const Eigen::Matrix3d R = test::pose(rotation_deg, Vector3d::Zero()).topLeftCorner<3, 3>();
  return {R, translation_mm};
}

TEST(RigidImage, FindsAnotherModalityFromAnyPoseOfTheHeader) {
  parallel::Team team(2);
  const Volume reference = reference_head();
  for (const auto &truth : {placed({10, -15, 20}, {20, -10, 15}), placed({0, 0, 175}, {80, 20, -60}),
                            placed({100, 60, -40}, {-30, 90, 10})}) {
    const RigidImageResult found = register_rigid(reference, head({50, 56, 50}, 3.4, truth, true), quick(), team);
    EXPECT_EQ(found.verdict, ImageVerdict::kFound) << found.reason;
    EXPECT_LT(apart_mm(found.T_reference_floating, truth, Vector3d::Zero()), 0.5);
    EXPECT_TRUE(found.covariance.isApprox(found.covariance.transpose()));
    EXPECT_GT(found.covariance.diagonal().minCoeff(), 0.0);
  }
}

TEST(RigidImage, NearTheHeadersBothOptimisersAndEveryThreadCountAgree) {
  const Volume reference = reference_head();
  const ReferenceFromFloating truth = placed({4, -6, 5}, {8, -4, 6});
  const Volume floating = head({50, 56, 50}, 3.4, truth, true);
  RigidImageOptions options = quick();
  options.start = Start::kPose;
  parallel::Team one(1);
  parallel::Team three(3);
  const RigidImageResult alone = register_rigid(reference, floating, options, one);
  EXPECT_EQ(alone.verdict, ImageVerdict::kFound) << alone.reason;
  const RigidImageResult shared = register_rigid(reference, floating, options, three);
  EXPECT_EQ(shared.T_reference_floating.matrix(), alone.T_reference_floating.matrix());
  EXPECT_EQ(shared.covariance, alone.covariance);
  options.optimiser = Optimiser::kLines;
  const RigidImageResult lines = register_rigid(reference, floating, options, one);
  EXPECT_LT(apart_mm(lines.T_reference_floating, alone.T_reference_floating, Vector3d::Zero()), 0.2);
}

// As by a moving mask, or padding: beside a voxel without a value the derivative is unknown, and must not become that
// of all.
TEST(RigidImage, MissingVoxelsOfEitherImageAreLeftOut) {
  parallel::Team team(2);
  const ReferenceFromFloating truth = placed({4, -6, 5}, {8, -4, 6});
  const auto in_circle = [](Volume image) {
    const Vector3d centre = image.point_mm(0.5 * Vector3d(image.size[0] - 1, image.size[1] - 1, image.size[2] - 1));
    for (std::size_t i = 0; i < image.voxels.size(); ++i) {
      if ((image.pixel_mm(i) - centre).head<2>().norm() > 75.0) {
        image.voxels[i] = std::nanf("");
      }
    }
    return image;
  };
  RigidImageOptions options = quick();
  options.start = Start::kPose;
  const RigidImageResult found =
      register_rigid(in_circle(reference_head()), in_circle(head({50, 56, 50}, 3.4, truth, true)), options, team);
  EXPECT_EQ(found.verdict, ImageVerdict::kFound) << found.reason;
  EXPECT_LT(apart_mm(found.T_reference_floating, truth, Vector3d::Zero()), 0.5);
}

TEST(RigidImage, AffineFindsAScale) {
  parallel::Team team(2);
  const Volume reference = reference_head();
  Volume floating = head({50, 56, 50}, 3.4, {}, true);
  floating.T_image_index.row(0) *= 1.04; // as with a wrong gradient calibration
  RigidImageOptions options = quick();
  options.start = Start::kPose;
  options.affine = true;
  const RigidImageResult found = register_rigid(reference, floating, options, team);
  EXPECT_NEAR(found.affine(0, 0), 1.0 / 1.04, 0.003);
  EXPECT_NEAR(found.affine(1, 1), 1.0, 0.003);
}

// The usual case: two images of one session. The lead is on the scale of unrelated poses, not of the start poses.
TEST(RigidImage, CorrectHeadersAreConfirmedFromThem) {
  parallel::Team team(2);
  RigidImageOptions options = quick();
  for (const Start start : {Start::kPose, Start::kCentres}) {
    options.start = start;
    const RigidImageResult found = register_rigid(reference_head(), head({50, 56, 50}, 3.4, {}, true), options, team);
    EXPECT_EQ(found.verdict, ImageVerdict::kFound) << found.reason;
    EXPECT_GT(found.mirror_lead, 0.0);
    EXPECT_LE(found.mirror_lead, 1.0);
    EXPECT_LT(std::abs(found.stretch), 0.01);
  }
}

// A header with a wrong spacing, or the head of another patient: the best rigid pose is wrong by millimetres at the
// border, and restarts, lead and mirror image show nothing of it.
TEST(RigidImage, DoesNotFindAHeadOfAnotherSize) {
  parallel::Team team(2);
  const Volume reference = reference_head();
  const ReferenceFromFloating truth = placed({4, -6, 5}, {8, -4, 6});
  const auto result = [&](const Vector3d &scale, bool affine = false) {
    Volume floating = head({50, 56, 50}, 3.4, truth, true);
    floating.T_image_index.topRows<3>() = (scale.asDiagonal() * floating.T_image_index.topRows<3>()).eval();
    RigidImageOptions options = quick();
    options.start = Start::kCentres;
    options.affine = affine;
    return register_rigid(reference, floating, options, team);
  };
  const RigidImageResult thick = result({1.0, 1.0, 1.06});
  EXPECT_EQ(thick.verdict, ImageVerdict::kAmbiguous);
  EXPECT_EQ(thick.reason,
            "the head of the floating image is 6 % larger along inferior-superior: a wrong spacing in one "
            "of the headers, or another patient?");
  EXPECT_NEAR(thick.stretch, 0.06, 0.01);
  EXPECT_EQ(result({0.96, 0.96, 0.96}).verdict, ImageVerdict::kAmbiguous);
  EXPECT_EQ(result({1.0, 1.008, 1.0}).verdict, ImageVerdict::kFound) << "a scanner's gradients are not better";
  EXPECT_EQ(result({1.0, 1.0, 1.06}, true).verdict, ImageVerdict::kFound) << "the scale is wanted";
}

TEST(RigidImage, RefusesWhatCannotBeRegistered) {
  parallel::Team team(2);
  const Volume reference = reference_head();
  const auto reason = [&](const Volume &floating, Start start = Start::kSearch) {
    RigidImageOptions options = quick();
    options.start = start;
    const RigidImageResult result = register_rigid(reference, floating, options, team);
    EXPECT_EQ(result.verdict, ImageVerdict::kRefused);
    return result.reason;
  };
  EXPECT_EQ(reason(head({50, 56, 1}, 3.4, {}, true)),
            "the floating image has 1 slice along an axis; at least 4 are needed for a pose in space");
  Volume flat = reference;
  std::fill(flat.voxels.begin(), flat.voxels.end(), 3.0F);
  EXPECT_EQ(reason(flat), "the floating image has one grey value only");
  Volume mask = reference;
  for (float &v : mask.voxels) {
    v = v > 40.0F ? 1.0F : 0.0F;
  }
  EXPECT_EQ(reason(mask), "the floating image has 2 grey values only: a mask or a segmentation, not a scan?");
  EXPECT_EQ(reason(head({50, 56, 50}, 3.4, placed({0, 0, 0}, {900, 0, 0}), true), Start::kPose),
            "the images do not overlap where their headers place them");
}

TEST(RigidImage, DoesNotFindWhatIsNotThere) {
  parallel::Team team(2);
  const Volume reference = reference_head();
  Volume noise = reference;
  std::mt19937 rng(kImageSeed);
  std::normal_distribution<float> normal(100.0F, 20.0F);
  std::generate(noise.voxels.begin(), noise.voxels.end(), [&] { return normal(rng); });
  const RigidImageResult of_noise = register_rigid(reference, noise, quick(), team);
  EXPECT_NE(of_noise.verdict, ImageVerdict::kFound);
  EXPECT_FALSE(of_noise.reason.empty());
  // A ball turns freely.
  Volume ball = reference;
  for (std::size_t i = 0; i < ball.voxels.size(); ++i) {
    ball.voxels[i] = 100.0F / (1.0F + std::exp(static_cast<float>(ball.pixel_mm(i).norm() - 55.0) / 3.0F));
  }
  const RigidImageResult of_ball = register_rigid(ball, ball, quick(), team);
  EXPECT_EQ(of_ball.verdict, ImageVerdict::kAmbiguous) << of_ball.lead << " " << of_ball.returned;
}

TEST(RigidImage, IsNotFoundByAMeasureThatFindsWrongPoses) {
  RigidImageResult result;
  result.overlap = result.mutual_information = result.lead = result.mirror_lead = 1.0;
  result.returned = result.restarts = 8;
  result.covariance.setIdentity();
  result.covariance *= 1e-8;
  for (const auto &[measure, verdict] : {std::pair(Measure::kNmi, ImageVerdict::kFound),
                                         {Measure::kGiMi, ImageVerdict::kFound},
                                         {Measure::kQMi, ImageVerdict::kAmbiguous},
                                         {Measure::kRmi, ImageVerdict::kAmbiguous},
                                         {Measure::kCmi, ImageVerdict::kAmbiguous}}) {
    RigidImageOptions options;
    options.measure = measure;
    judge(result, Vector3d::Zero(), options);
    EXPECT_EQ(result.verdict, verdict) << static_cast<int>(measure) << ": " << result.reason;
  }
}

TEST(RigidImage, AWrongPoseIsNotCalledAMirroredHead) {
  RigidImageResult result;
  result.overlap = 0.9;
  result.mutual_information = 0.4;
  result.lead = 0.5;
  result.mirror_lead = -0.2;
  result.restarts = 4;
  judge(result, Eigen::Vector3d::Zero(), {});
  EXPECT_EQ(result.verdict, ImageVerdict::kAmbiguous);
  EXPECT_EQ(result.reason.rfind("only 0 of 4 restarts from perturbed poses came back", 0), 0U) << result.reason;
  result.returned = 4;
  judge(result, Eigen::Vector3d::Zero(), {});
  EXPECT_NE(result.reason.find("are left and right exchanged"), std::string::npos) << result.reason;
}

TEST(RigidImage, StopsWhenItsCallerWantsThat) {
  parallel::Team team(1);
  RigidImageOptions options = quick();
  int calls = 0;
  options.progress = [&](double done, std::string_view stage) {
    EXPECT_GE(done, 0.0);
    EXPECT_FALSE(stage.empty());
    return ++calls < 3;
  };
  const RigidImageResult result = register_rigid(reference_head(), reference_head(), options, team);
  EXPECT_EQ(result.verdict, ImageVerdict::kRefused);
  EXPECT_EQ(result.reason, "stopped");
  EXPECT_EQ(calls, 3);
}

} // namespace
} // namespace bregma::intensity
