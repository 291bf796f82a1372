#include "casefile/itk_transform.hpp"

#include <numbers>
#include <random>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::TemporaryFolder;
using Eigen::Matrix4d;

std::string transform_error(const std::string &content, bool rigid = false) {
  const TemporaryFolder folder;
  const auto file = folder.write("a.tfm", content);
  std::string message = "no error";
  if (rigid) {
    const auto read = read_itk_rigid(file);
    message = read ? message : read.error().message;
  } else {
    const auto read = read_itk_transform(file);
    message = read ? message : read.error().message;
  }
  return message.substr(std::min(message.size(), message.find("a.tfm")));
}

const std::string kHead = "#Insight Transform File V1.0\n#Transform 0\n";

// The source lies 10 mm to the left, 20 mm behind and 30 mm below its position in the target. The file contains the
// inverse in LPS, which is what a resampler needs.
TEST(ItkTransform, TheFileIsLpsAndLeadsFromFixedToMoving) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "a.tfm";
  Matrix4d T = Matrix4d::Identity();
  T.topRightCorner<3, 1>() = Eigen::Vector3d(10, 20, 30);
  ASSERT_TRUE(write_itk_transform(file, T));
  EXPECT_EQ(bregma::tests::read_file(file), kHead +
                                                "Transform: AffineTransform_double_3_3\n"
                                                "Parameters: 1 0 0 0 1 0 0 0 1 10 20 -30\nFixedParameters: 0 0 0\n");
}

TEST(ItkTransform, RoundTripsToTheLastDigits) {
  const TemporaryFolder folder;
  std::mt19937 random(5); // printed with a failure by its use below
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d axis(uniform(random), uniform(random), uniform(random));
    const TargetFromSource T(bregma::geometry::rotation_exp(std::numbers::pi * axis / 2.0), 200.0 * axis.reverse());
    const auto file = folder.path() / "a.tfm";
    ASSERT_TRUE(write_itk_transform(file, T.matrix()));
    const auto read = read_itk_rigid(file);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_LT((read->matrix() - T.matrix()).norm(), 1e-11) << "seed 5, trial " << trial;
  }
  Matrix4d affine = Matrix4d::Identity();
  affine.topRows<3>() << 1.1, 0.1, 0.0, 5.0, -0.05, 0.9, 0.02, -7.0, 0.0, 0.03, 1.05, 1.0 / 3.0;
  ASSERT_TRUE(write_itk_transform(folder.path() / "b.tfm", affine));
  const auto read = read_itk_transform(folder.path() / "b.tfm");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_LT((*read - affine).norm(), 1e-12);
}

TEST(ItkTransform, UnreadableContentIsRefusedWithLineAndValue) {
  const std::string affine = "Transform: AffineTransform_double_3_3\n";
  const std::string parameters = "Parameters: 1 0 0 0 1 0 0 0 1 0 0 0\n";
  EXPECT_EQ(transform_error("hello\n"),
            "a.tfm:1: is not an ITK transform file: it must begin with \"#Insight Transform File V1.0\", or be a .mat "
            "file of ANTs");
  EXPECT_EQ(transform_error(kHead), "a.tfm: holds no transform");
  for (const std::string type : {"BSplineTransform_double_3_3", "AffineTransform_double_2_2"}) {
    EXPECT_EQ(transform_error(kHead + "Transform: " + type + "\n"),
              "a.tfm:3: Transform: " + type +
                  ": is not read; read are transforms of three dimensions (_double_3_3, _float_3_3): AffineTransform, "
                  "MatrixOffsetTransformBase, Rigid3DTransform, Euler3DTransform, VersorRigid3DTransform, "
                  "Similarity3DTransform, VersorTransform, QuaternionRigidTransform, TranslationTransform");
  }
  EXPECT_EQ(transform_error(kHead + affine + "Parameters: 1 0 0 0 1 0 0 0 1 0 0\nFixedParameters: 0 0 0\n"),
            "a.tfm:4: Parameters: 11 numbers that are no AffineTransform");
  EXPECT_EQ(transform_error(kHead + affine + "Parameters: 1 0 0 0 nan 0 0 0 1 0 0 0\n"),
            "a.tfm:4: Parameters: \"nan\" is not a finite number");
  EXPECT_EQ(transform_error(kHead + affine + parameters + "Parameters: 1 0 0 0 1 0 0 0 1 5 0 0\n"),
            "a.tfm:5: Parameters: is stated a second time");
  EXPECT_EQ(transform_error(kHead + affine + parameters), "a.tfm: is not whole: it has no FixedParameters");
  EXPECT_EQ(transform_error(kHead + affine + parameters + "FixedParameters:\n"),
            "a.tfm:5: FixedParameters: 0 numbers, the centre has 3");
  EXPECT_EQ(transform_error(kHead + affine + "Parameters: 1 0 0 1 0 0 0 0 1 0 0 0\nFixedParameters: 0 0 0\n"),
            "a.tfm:4: Parameters: the matrix has no inverse");
  EXPECT_EQ(transform_error(kHead + affine + parameters + "FixedParameters: 0 0 0\n" + affine),
            "a.tfm:6: is a second transform (AffineTransform_double_3_3), only one is read");
  EXPECT_EQ(transform_error(kHead + affine + "Parameters: 2 0 0 0 1 0 0 0 1 0 0 0\nFixedParameters: 0 0 0\n", true),
            "a.tfm: the transform is not rigid: it scales, shears or mirrors (determinant 0.5)");
  EXPECT_EQ(transform_error(kHead + "Transform: VersorRigid3DTransform_double_3_3\nParameters: 1 1 0 0 0 0\n"
                                    "FixedParameters: 0 0 0\n"),
            "a.tfm:4: Parameters: 6 numbers that are no VersorRigid3DTransform");
  EXPECT_EQ(transform_error(kHead + "Transform: VersorTransform_double_3_3\nParameters: 0 0 0 1 2 3\n"
                                    "FixedParameters: 0 0 0\n"),
            "a.tfm:4: Parameters: 6 numbers that are no VersorTransform");
  EXPECT_EQ(transform_error(kHead + "Transform: Similarity3DTransform_double_3_3\nParameters: 0 0 0 1 2 3 0.5\n"
                                    "FixedParameters: 0 0 0\n",
                            true),
            "a.tfm: the transform is not rigid: it scales, shears or mirrors (determinant 8)");
  const TemporaryFolder folder;
  EXPECT_FALSE(write_itk_transform(folder.path() / "b.tfm", Matrix4d::Zero()));
}

// The files of tests/data/faults/transforms hold one pose.
TEST(ItkTransform, EveryRigidKindOfItkAndAntsIsReadAsTheSamePose) {
  const std::filesystem::path folder = BREGMA_SOURCE_DIR "/tests/data/faults/transforms";
  const auto expected = read_itk_transform(folder / "affine.tfm");
  ASSERT_TRUE(expected) << expected.error().message;
  for (const char *name : {"rigid3d.tfm", "versor.tfm", "quat.tfm", "composite.tfm", "ants0GenericAffine.mat"}) {
    const auto T = read_itk_transform(folder / name);
    ASSERT_TRUE(T) << T.error().message;
    EXPECT_LT((*T - *expected).cwiseAbs().maxCoeff(), 1e-6) << name;
  }
}

TEST(ItkTransform, ABinaryFileThatIsNotWholeIsRefused) {
  const TemporaryFolder folder;
  const std::string whole =
      bregma::tests::read_file(BREGMA_SOURCE_DIR "/tests/data/faults/transforms/ants0GenericAffine.mat");
  for (std::size_t size = 1; size < whole.size(); ++size) {
    ASSERT_FALSE(read_itk_transform(folder.write("cut.mat", whole.substr(0, size)))) << size << " bytes";
  }
}

TEST(ItkTransform, ATextThatIsNotWholeIsRefused) {
  const TemporaryFolder folder;
  for (const char *name : {"affine.tfm", "rigid3d.tfm", "versor.tfm", "quat.tfm", "composite.tfm"}) {
    std::string whole =
        bregma::tests::read_file(std::string(BREGMA_SOURCE_DIR "/tests/data/faults/transforms/") + name);
    whole.resize(whole.find_last_not_of('\n') + 2);
    ASSERT_TRUE(read_itk_transform(folder.write("whole.tfm", whole))) << name;
    for (std::size_t size = 0; size < whole.size(); ++size) {
      ASSERT_FALSE(read_itk_transform(folder.write("cut.tfm", whole.substr(0, size)))) << name << " " << size;
    }
  }
}

// Each matrix is finite; its determinant, its inverse or the product with a centre is not.
TEST(ItkTransform, AMatrixThatOverflowsIsRefused) {
  const std::string affine = "Transform: AffineTransform_double_3_3\nParameters: ";
  for (const std::string numbers :
       {"1e150 0 0 0 1e150 0 0 0 1e150 0 0 0", "1e-2 0 0 0 1e-2 0 0 0 1e-2 1e308 0 0",
        "1e300 1e300 1e300 -1e300 1e300 0 0 0 1e-300 0 0 0", "1e160 0 0 0 1e-160 0 0 0 1 1e155 1e155 0"}) {
    EXPECT_EQ(transform_error(kHead + affine + numbers + "\nFixedParameters: 0 0 0\n"),
              "a.tfm:4: Parameters: the matrix has no inverse")
        << numbers;
  }
  EXPECT_EQ(transform_error(kHead + affine + "2e200 0 0 0 1 0 0 0 1 0 0 0\nFixedParameters: 1e200 0 0\n"),
            "a.tfm:4: Parameters: the matrix has no inverse");
}

TEST(ItkTransform, ACompositeOfTwoIsRefused) {
  const TemporaryFolder folder;
  const std::string one = "Transform: TranslationTransform_double_3_3\nParameters: 1 2 3\nFixedParameters:\n";
  const std::string head = "#Insight Transform File V1.0\nTransform: CompositeTransform_double_3_3\n";
  const auto read = read_itk_transform(folder.write("one.tfm", head + one));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE((Eigen::Vector3d(read->topRightCorner<3, 1>()).isApprox(Eigen::Vector3d(1, 2, -3))));
  const auto two = read_itk_transform(folder.write("two.tfm", head + one + one));
  ASSERT_FALSE(two);
  EXPECT_NE(two.error().message.find(":6: is a second transform"), std::string::npos) << two.error().message;
}

} // namespace
