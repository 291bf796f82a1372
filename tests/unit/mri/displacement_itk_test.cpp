// ITK reads a field as a displacement field and resamples by it in the same direction; DICOM headers of a real scanner.
#include <gtest/gtest.h>
#include <itkDisplacementFieldTransform.h>
#include <itkImageFileReader.h>
#include <itkNrrdImageIO.h>
#include <itkVector.h>

#include "casefile/volumes/displacement_file.hpp"
#include "casefile/volumes/scan_header.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma;
using Vector = itk::Vector<double, 3>;
using Field = itk::Image<Vector, 3>;

TEST(DisplacementFile, ItkReadsItAsATransformInTheResamplingDirection) {
  const test::TemporaryFolder folder;
  casefile::DisplacementField field;
  field.displacement_mm.size = {6, 5, 4};
  field.displacement_mm.T_image_index << 4, 0, 0, -10, 0, 3, 0, -5, 0, 0, 5, 7, 0, 0, 0, 1;
  for (std::size_t i = 0; i < field.displacement_mm.pixels(); ++i) {
    const Eigen::Vector3d p = field.displacement_mm.pixel_mm(i);
    field.displacement_mm.voxels.emplace_back((0.1 * p + Eigen::Vector3d(1.0, 2.0, 3.0)).cast<float>());
  }
  field.signed_error_95_mm.size = {1, 1, 1};
  field.signed_error_95_mm.voxels = {0.1F};
  field.max_error_95_mm = 2.0;
  field.made = "2026-11-29";
  const auto file = folder / "field.nrrd";
  ASSERT_TRUE(casefile::write_displacement_field(file, field));

  auto reader = itk::ImageFileReader<Field>::New();
  reader->SetImageIO(itk::NrrdImageIO::New());
  reader->SetFileName(file.string());
  reader->Update();
  auto transform = itk::DisplacementFieldTransform<double, 3>::New();
  transform->SetDisplacementField(reader->GetOutput());
  for (const Eigen::Vector3d &ras : {Eigen::Vector3d(-8, -3, 9), Eigen::Vector3d(2.5, 1.25, 15.0)}) {
    const Eigen::Vector3d expected = ras + 0.1 * ras + Eigen::Vector3d(1.0, 2.0, 3.0);
    const double lps[3] = {-ras.x(), -ras.y(), ras.z()};
    const auto mapped = transform->TransformPoint(itk::Point<double, 3>(lps));
    EXPECT_NEAR(mapped[0], -expected.x(), 1e-4);
    EXPECT_NEAR(mapped[1], -expected.y(), 1e-4);
    EXPECT_NEAR(mapped[2], expected.z(), 1e-4);
  }
}

TEST(ScanHeader, StatesScannerPositionAndVendorCorrection) {
  BREGMA_SHARED_DATA(mr, "distortion/MR_dicom");
  const auto header = casefile::read_scan_header(mr);
  ASSERT_TRUE(header) << header.error().message;
  EXPECT_EQ(header->modality, "MR");
  EXPECT_EQ(header->scanner(), "SIEMENS Avanto 18030");
  EXPECT_EQ(header->patient_position, "HFS");
  EXPECT_EQ(header->bandwidth_Hz, 260.0);
  EXPECT_EQ(header->vendor_correction(), casefile::VendorCorrection::kNone) << header->image_type;
  BREGMA_SHARED_DATA(ct, "distortion/CT_dicom");
  EXPECT_EQ(casefile::read_scan_header(ct)->modality, "CT");
  const auto none = casefile::read_scan_header(mr, "1.2.3");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().message, mr.string() + ": no DICOM image of the series 1.2.3");
}

TEST(ScanHeader, KnowsTheVendorsMarks) {
  using enum casefile::VendorCorrection;
  casefile::ScanHeader header;
  for (const char *type : {"ORIGINAL\\PRIMARY\\M\\DIS2D", "DERIVED\\PRIMARY\\M\\DIS3D\\NORM", "DIS3D",
                           "ORIGINAL\\PRIMARY\\M\\ND\\dis2d "}) {
    header.image_type = type;
    EXPECT_EQ(header.vendor_correction(), kCorrected) << type;
  }
  header.image_type = "ORIGINAL\\PRIMARY\\M\\ND\\NORM";
  EXPECT_EQ(header.vendor_correction(), kNone);
  // Other vendors have no such mark.
  for (const char *type :
       {"", "ORIGINAL\\PRIMARY\\OTHER", "ORIGINAL\\PRIMARY\\M_FFE\\M\\FFE", "ORIGINAL\\PRIMARY\\M\\NODIS2D\\NORM"}) {
    header.image_type = type;
    EXPECT_EQ(header.vendor_correction(), kNotStated) << type;
    EXPECT_FALSE(header.shows_phase()) << type;
  }
  for (const char *type : {"ORIGINAL\\PRIMARY\\P\\ND", "ORIGINAL\\PRIMARY\\PHASE MAP\\P\\FFE"}) {
    header.image_type = type;
    EXPECT_TRUE(header.shows_phase()) << type;
  }
}

} // namespace
