// Transform files compared with ITK's reader and writer.
#include <Eigen/Eigenvalues> // before ITK brings its own, older copy
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gtest/gtest.h>
#include <itkAffineTransform.h>
#include <itkEuler3DTransform.h>
#include <itkSimilarity3DTransform.h>
#include <itkTransformFileReader.h>
#include <itkTransformFileWriter.h>
#include <itkTxtTransformIO.h>
#include <itkVersorRigid3DTransform.h>
#include <itkVersorTransform.h>

#include "casefile/itk_transform.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma::casefile;
using bregma::test::TemporaryFolder;
using Eigen::Vector3d;
using LinearTransform = itk::MatrixOffsetTransformBase<double, 3, 3>;

const Vector3d kPoints_ras[] = {{0, 0, 0}, {10, -20, 30}, {-70, 55, 12}};

Vector3d lps_of(const Vector3d &ras) { return {-ras.x(), -ras.y(), ras.z()}; }

Vector3d through(const LinearTransform &transform, const Vector3d &lps) {
  const auto out = transform.TransformPoint(LinearTransform::InputPointType(lps.data()));
  return {out[0], out[1], out[2]};
}

TEST(ItkTransformFiles, ItkReadsOursAndResamplesByIt) {
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "a.tfm").string();
  const TargetFromSource T(bregma::geometry::rotation_exp({0.4, -1.1, 0.7}), {12.0, -34.0, 56.0});
  ASSERT_TRUE(write_itk_transform(file, T.matrix()));
  auto reader = itk::TransformFileReaderTemplate<double>::New();
  reader->SetTransformIO(itk::TxtTransformIOTemplate<double>::New());
  reader->SetFileName(file);
  reader->Update();
  ASSERT_EQ(reader->GetTransformList()->size(), 1U);
  const auto *read = dynamic_cast<const LinearTransform *>(reader->GetTransformList()->front().GetPointer());
  ASSERT_NE(read, nullptr);
  // A resampler maps a point of the fixed image (target) to the moving one (source).
  for (const Vector3d &source : kPoints_ras) {
    EXPECT_LT((through(*read, lps_of(T * source)) - lps_of(source)).norm(), 1e-9);
  }
}

itk::Vector<double, 3> axis(double x, double y, double z) {
  itk::Vector<double, 3> out;
  out[0] = x;
  out[1] = y;
  out[2] = z;
  return out;
}

template <class Transform> void expect_read(const Transform &transform) {
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "a.tfm").string();
  auto writer = itk::TransformFileWriterTemplate<double>::New();
  writer->SetTransformIO(itk::TxtTransformIOTemplate<double>::New());
  writer->SetFileName(file);
  writer->SetInput(&transform);
  writer->Update();
  const auto T = read_itk_transform(file);
  ASSERT_TRUE(T) << T.error().message;
  for (const Vector3d &source : kPoints_ras) {
    const Vector3d target = T->topLeftCorner<3, 3>() * source + T->topRightCorner<3, 1>();
    EXPECT_LT((through(transform, lps_of(target)) - lps_of(source)).norm(), 1e-9) << transform.GetNameOfClass();
  }
}

TEST(ItkTransformFiles, OurReaderReadsItksAffineAndRigidFiles) {
  const double centre[] = {5.0, -6.0, 7.0};
  const double offset[] = {11.0, 22.0, -33.0};
  auto affine = itk::AffineTransform<double, 3>::New();
  affine->SetCenter(centre);
  affine->Rotate3D(axis(1.0, 2.0, 3.0), 0.8);
  affine->Shear(0, 2, 0.1);
  affine->Scale(1.2);
  affine->Translate(offset);
  expect_read(*affine);

  for (const bool zyx : {false, true}) {
    auto euler = itk::Euler3DTransform<double>::New();
    euler->SetComputeZYX(zyx);
    euler->SetCenter(centre);
    euler->SetRotation(0.3, -0.5, 1.9);
    euler->SetTranslation(offset);
    expect_read(*euler);
  }

  auto versor = itk::VersorRigid3DTransform<double>::New();
  versor->SetCenter(centre);
  versor->SetRotation(axis(1.0, -2.0, 0.5), 2.8);
  versor->SetTranslation(offset);
  expect_read(*versor);

  auto rotation = itk::VersorTransform<double>::New();
  rotation->SetCenter(centre);
  rotation->SetRotation(axis(0.3, -1.0, 0.5), 1.7);
  expect_read(*rotation);

  auto similarity = itk::Similarity3DTransform<double>::New();
  similarity->SetCenter(centre);
  similarity->SetRotation(axis(0.3, 1.0, -0.5), 2.1);
  similarity->SetTranslation(offset);
  similarity->SetScale(1.1);
  expect_read(*similarity);
}

} // namespace
