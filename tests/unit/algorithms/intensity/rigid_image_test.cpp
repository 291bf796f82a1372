// Rigid registration of images: poses are found from any start, and what cannot be registered is not "found".
#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "algorithms/intensity/rigid_image.hpp"
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
