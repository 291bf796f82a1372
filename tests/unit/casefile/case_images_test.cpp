// Images that were registered to the planning image, and points that were placed in them.
#include <cstdio>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "casefile/case.hpp"
#include "casefile/itk_transform.hpp"
#include "casefile/markups.hpp"
#include "casefile/sha256.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace {

using namespace bregma::casefile;
using bregma::geometry::Matrix6d;
using bregma::geometry::Vector6d;
using Eigen::Vector3d;
using Pose = bregma::geometry::Rigid3<bregma::geometry::frame::Image, bregma::geometry::frame::Source>;

const Pose kPose(Eigen::AngleAxisd(0.3, Vector3d(1, 2, -1).normalized()).toRotationMatrix(), Vector3d(5, -12, 30));

// 0.3 mm and 0.2 degrees about a point of the head, with correlations.
Matrix6d covariance() {
  Matrix6d root = Matrix6d::Zero();
  root.diagonal() << 0.003, 0.004, 0.002, 0.3, 0.25, 0.4;
  root(3, 1) = 0.1;
  root(5, 0) = -0.15;
  return root * root.transpose();
}

class CaseWithImage : public testing::Test {
protected:
  void SetUp() override {
    folder_.write("image.nii.gz", "planning image");
    std::filesystem::create_directories(folder_.path() / "images");
    folder_.write("images/t2.nii.gz", "second image");
    case_ = bregma::tests::sample_case(folder_.path());
    RegisteredImage image;
    image.name = "T2";
    image.file = folder_.path() / "images/t2.nii.gz";
    image.T_image_source = {kPose, covariance()};
    image.measure = "nmi";
    image.verdict = "found";
    image.date = "2026-11-29T12:00:00Z";
    image.sha256 = to_hex(sha256("second image"));
    image.planning_sha256 = to_hex(sha256("planning image"));
    case_.images.push_back(image);
    case_.targets.push_back({"Cyst", in_t2_, "T2"});
    case_.trajectories.push_back({"Cyst path", in_t2_ + Vector3d(0, 30, 40), in_t2_, "T2", "T2"});
    case_.trajectories.push_back({"Mixed", {0, 40, 80}, in_t2_, "", "T2"});
    map_to_image(case_, case_.targets.back());
    map_to_image(case_, case_.trajectories[1]);
    map_to_image(case_, case_.trajectories[2]);
    const auto saved = save_case(case_);
    ASSERT_TRUE(saved) << saved.error().message;
    toml_ = bregma::tests::read_file(folder_.path() / "case.toml");
  }

  std::string load_error() {
    const auto loaded = load_case(folder_.path());
    return loaded ? "no error" : loaded.error().message;
  }
  std::string error_with(const std::string &old_text, const std::string &new_text) {
    std::string changed = toml_;
    const auto at = changed.find(old_text);
    EXPECT_NE(at, std::string::npos) << old_text << "\n" << toml_;
    changed.replace(at, old_text.size(), new_text);
    folder_.write("case.toml", changed);
    std::string error = load_error();
    folder_.write("case.toml", toml_);
    return error;
  }
  static void expect_part(const std::string &text, const std::string &part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  }

  bregma::test::TemporaryFolder folder_;
  Case case_;
  std::string toml_;
  Vector3d in_t2_ = kPose.inverse() * Vector3d(12, 3, 25);
};

TEST_F(CaseWithImage, PointsPlacedInItAreMappedWithTheErrorOfItsRegistration) {
  for (int round = 0; round < 2; ++round) {
    const auto loaded = load_case(folder_.path());
    ASSERT_TRUE(loaded) << loaded.error().message;
    ASSERT_EQ(loaded->images.size(), 1U);
    const RegisteredImage &image = loaded->images.front();
    EXPECT_TRUE(image.T_image_source.pose.matrix().isApprox(kPose.matrix(), 1e-12));
    EXPECT_EQ(image.T_image_source.covariance, covariance()) << "written exactly";
    EXPECT_EQ(image.measure + image.verdict + image.date, "nmifound2026-11-29T12:00:00Z");

    ASSERT_EQ(loaded->targets.size(), 2U);
    EXPECT_EQ(loaded->targets[0].placing_covariance_mm2, Eigen::Matrix3d::Zero()) << "of the planning image";
    const NamedPoint &cyst = loaded->targets[1];
    EXPECT_EQ(cyst.placed_in, "T2");
    EXPECT_LT((cyst.position_mm - Vector3d(12, 3, 25)).norm(), 1e-9);
    EXPECT_TRUE(cyst.placing_covariance_mm2.isApprox(
        bregma::geometry::point_covariance(case_.images.front().T_image_source, in_t2_), 1e-9));

    ASSERT_EQ(loaded->trajectories.size(), 3U);
    EXPECT_LT((loaded->trajectory("Cyst path")->target_mm - Vector3d(12, 3, 25)).norm(), 1e-9);
    EXPECT_LT((loaded->trajectory("Mixed")->entry_mm - Vector3d(0, 40, 80)).norm(), 1e-9);
    EXPECT_LT((loaded->trajectory("Mixed")->target_mm - Vector3d(12, 3, 25)).norm(), 1e-9);
    ASSERT_TRUE(save_case(*loaded)) << "a case that is loaded and saved stays the same";
  }
  // A file of an image has the coordinates of that image, as Slicer shows them over it.
  const auto written = read_points(folder_.path() / "images/t2.targets.mrk.json");
  ASSERT_TRUE(written) << written.error().message;
  EXPECT_LT((written->front().position_mm - in_t2_).norm(), 1e-9);
  EXPECT_EQ(written->front().placed_in, "T2");
}

TEST_F(CaseWithImage, AnImageThatHasChangedIsRefused) {
  folder_.write("images/t2.nii.gz", "another image");
  expect_part(load_error(), "t2.nii.gz has changed since it was registered: register it again");
  folder_.write("images/t2.nii.gz", "second image");
  EXPECT_EQ(load_error(), "no error");
  folder_.write("image.nii.gz", "another planning image");
  expect_part(load_error(), "the planning image has changed since image \"T2\" was registered to it");
  folder_.write("image.nii.gz", "planning image");
  std::filesystem::remove(folder_.path() / "images/t2.nii.gz");
  expect_part(load_error(), "images[0].file");
}

TEST_F(CaseWithImage, PointsMoveWithANewRegistration) {
  RegisteredImage again = case_.images.front();
  again.T_image_source.pose =
      kPose * bregma::geometry::Rigid3<bregma::geometry::frame::Source, bregma::geometry::frame::Source>(
                  Eigen::Quaterniond::Identity(), kPose.inverse().rotation() * Vector3d(0, 0, 1.5));
  again.T_image_source.covariance *= 4.0;
  put_image(case_, again);
  ASSERT_EQ(case_.images.size(), 1U);
  EXPECT_LT((case_.targets[1].position_mm - Vector3d(12, 3, 26.5)).norm(), 1e-9);
  EXPECT_LT((case_.trajectory("Mixed")->target_mm - Vector3d(12, 3, 26.5)).norm(), 1e-9);
  EXPECT_LT((case_.trajectory("Mixed")->entry_mm - Vector3d(0, 40, 80)).norm(), 1e-9) << "of the planning image";
  EXPECT_TRUE(case_.targets[1].placing_covariance_mm2.isApprox(
      bregma::geometry::point_covariance(again.T_image_source, in_t2_), 1e-9));
}

TEST_F(CaseWithImage, OnlyAFoundRegistrationEntersUnlessAPersonSaysOtherwise) {
  expect_part(error_with("verdict = \"found\"", "verdict = \"ambiguous\""),
              "images[0].verdict = \"ambiguous\": is not \"found\", and \"accepted\" does not state why it is used");
  expect_part(error_with("verdict = \"found\"", "verdict = \"ambiguous\"\naccepted = \"  \""), "images[0].verdict");
  EXPECT_EQ(error_with("verdict = \"found\"", "verdict = \"ambiguous\"\naccepted = \"compared by Dr Example\""),
            "no error");
}

TEST_F(CaseWithImage, PointsMustNameAnImageOfTheCase) {
  case_.targets.back().placed_in = "FLAIR";
  expect_part(check_case(case_).error().message,
              "targets: \"Cyst\" is placed in image \"FLAIR\", which the case does not have; there are \"T2\"");
  case_.targets.back().placed_in = "T2";
  case_.fiducials.front().placed_in = "T2";
  expect_part(check_case(case_).error().message, "fiducials are placed in the planning image");
  case_.fiducials.front().placed_in.clear();
  case_.structures.front().segmented_in = "FLAIR";
  expect_part(check_case(case_).error().message, "structures[0].image: names image \"FLAIR\"");
  case_.structures.front().segmented_in.clear();
  case_.trajectories.back().target_in = "PD";
  expect_part(check_case(case_).error().message, "trajectories: \"Mixed\" is placed in image \"PD\"");
  case_.trajectories.back().target_in = "T2";
  case_.images.push_back(case_.images.front());
  expect_part(check_case(case_).error().message, "images: image 2 has the name \"T2\", which is already taken");
}

TEST_F(CaseWithImage, ErrorsThatCannotBeThoseOfARegistrationAreRefused) {
  Matrix6d &stated = case_.images.front().T_image_source.covariance;
  stated.setZero();
  expect_part(check_case(case_).error().message, "images[0].covariance: ");
  stated = covariance();
  stated(0, 0) = -1e-6;
  expect_part(check_case(case_).error().message, "is not that of an error");
  stated = 2000.0 * covariance();
  expect_part(check_case(case_).error().message, "must be above 0 and at most 10 mm");
  Eigen::Matrix4d scaled = kPose.matrix();
  scaled.topLeftCorner<3, 3>() *= 1.01;
  ASSERT_TRUE(write_itk_transform(folder_.path() / "images/t2.tfm", scaled));
  expect_part(load_error(), "the transform is not rigid");
}

// The registration that was found errs by its covariance; the true place of the target is where the true pose puts it.
TEST_F(CaseWithImage, ThePredictedRegionCoversTheTargetInNineteenOfTwentyDraws) {
  const auto loaded = load_case(folder_.path());
  ASSERT_TRUE(loaded) << loaded.error().message;
  const NamedPoint &cyst = loaded->targets[1];
  const Eigen::LLT<Eigen::Matrix3d> region(cyst.placing_covariance_mm2);
  const Matrix6d root = covariance().llt().matrixL();
  std::mt19937_64 random(17);
  std::normal_distribution<double> normal;
  int inside = 0;
  for (int draw = 0; draw < 1000; ++draw) {
    Vector6d twist;
    for (double &value : twist) {
      value = normal(random);
    }
    twist = root * twist;
    const double angle = twist.head<3>().norm();
    const Vector3d truth =
        Eigen::AngleAxisd(angle, twist.head<3>() / angle) * Vector3d(kPose * in_t2_) + Vector3d(twist.tail<3>());
    const Vector3d error = truth - cyst.position_mm;
    inside += error.dot(region.solve(error)) <= 7.815 ? 1 : 0; // chi-square, 3 degrees of freedom, 95 %
  }
  std::printf("seed 17: %d of 1000 in the 95 %% region\n", inside);
  EXPECT_GE(inside, 930);
  EXPECT_LE(inside, 970);
}

} // namespace
