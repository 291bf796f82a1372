// `bregma mri field` and `bregma mri correct` on files: the real phantom's markers, and a simulated scanner's image.
#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "casefile/volumes/displacement_file.hpp"
#include "casefile/volumes/volume.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/cli/run_bregma.hpp"
#include "tests/unit/mri/field_phantom.hpp"

namespace {

using namespace bregma;
using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;
using Eigen::Vector3d;
using geometry::Points3;

void write_points(const TemporaryFolder &folder, const char *name, const Points3 &points) {
  std::ofstream out(folder / name);
  out << "r,a,s\n";
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    out << points(0, i) << ',' << points(1, i) << ',' << points(2, i) << '\n';
  }
}

TEST(MriField, FindsTheRealScannersFieldWithoutHandWork) {
  BREGMA_SHARED_DATA(data, "distortion/repeat");
  const TemporaryFolder folder;
  const auto run = run_bregma(folder, "mri field " + (data / "CT.mrk.json").string() + " " +
                                          (data / "MR_AP.mrk.json").string() + " -o field.nrrd --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  const auto json = run.json();
  EXPECT_GE(json["match"]["pairs"].size(), 334U);
  EXPECT_EQ(json["match"]["ct_unmatched"].size() + json["match"]["pairs"].size(), 339U);
  EXPECT_NEAR(json["initial"]["overall"]["mean_mm"].get<double>(), 6.0, 0.2);
  EXPECT_LT(json["residual"]["overall"]["mean_mm"].get<double>(), 0.7);
  const auto field = casefile::read_displacement_field(folder / "field.nrrd");
  ASSERT_TRUE(field) << field.error().message;
  EXPECT_FALSE(field->expires.empty());
  const auto text =
      run_bregma(folder, "mri field " + (data / "CT.mrk.json").string() + " " + (data / "MR_AP.mrk.json").string());
  EXPECT_NE(text.out.find("CT point 337: isolated"), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("Axis  Initial mean (SD) mm"), std::string::npos) << text.out;

  // The two real series: CT is no image of this scanner, and a field of another scanner is refused.
  const std::string images = (data.parent_path()).string();
  const auto ct = run_bregma(folder, "mri correct field.nrrd " + images + "/CT_dicom -o out.nrrd");
  EXPECT_EQ(ct.exit_code, 1);
  EXPECT_NE(ct.err.find("has the modality \"CT\", not MR"), std::string::npos) << ct.err;
  const auto mr = run_bregma(folder, "mri correct field.nrrd " + images + "/MR_dicom -o out.nrrd");
  EXPECT_EQ(mr.exit_code, 0) << mr.err;
}

TEST(MriField, AnAmbiguousPhantomGivesNoField) {
  const TemporaryFolder folder;
  const Points3 lattice = test::lattice(5, 17.0);
  write_points(folder, "ct.csv", lattice);
  write_points(folder, "mr.csv", test::SourceField(1, 1.0).image_of(lattice));
  const auto run = run_bregma(folder, "mri field ct.csv mr.csv -o field.nrrd --any-orientation");
  EXPECT_EQ(run.exit_code, 1) << run.out << run.err;
  EXPECT_NE(run.out.find("ambiguous"), std::string::npos) << run.out;
  EXPECT_FALSE(std::filesystem::exists(folder / "field.nrrd"));
}

// An image of balls at known places, as a distorting scanner shows them.
TEST(MriCorrect, MovesTissueBackToItsPlace) {
  const TemporaryFolder folder;
  const test::SourceField truth(5, 3.0);
  const Points3 lattice = test::lattice(9, 20.0);
  write_points(folder, "ct.csv", lattice);
  write_points(folder, "mr.csv", truth.image_of(lattice));
  ASSERT_EQ(run_bregma(folder, "mri field ct.csv mr.csv -o field.nrrd --scanner \"A B\"").exit_code, 0);
  casefile::Volume image;
  image.size = {64, 64, 40};
  image.T_image_index.topLeftCorner<3, 3>() *= 2.0;
  image.T_image_index.topRightCorner<3, 1>() = Vector3d(-63.0, -63.0, -39.0);
  const Vector3d balls[] = {{40, 30, 20}, {-45, 20, -25}, {30, -50, 10}};
  for (std::size_t i = 0; i < image.pixels(); ++i) {
    double value = 0.0;
    for (const Vector3d &ball : balls) {
      value += 1000.0 * std::exp(-0.5 * (image.pixel_mm(i) - truth.image_of(ball)).squaredNorm() / 16.0);
    }
    image.voxels.push_back(static_cast<float>(value));
  }
  ASSERT_TRUE(casefile::write_volume(folder / "image.nrrd", image));
  const auto refused = run_bregma(folder, "mri correct field.nrrd image.nrrd -o out.nrrd");
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_NE(refused.err.find("say so by --not-corrected"), std::string::npos) << refused.err;
  const auto run = run_bregma(folder, "mri correct field.nrrd image.nrrd -o out.nrrd --not-corrected --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  EXPECT_GT(run.json()["max_shift_mm"].get<double>(), 1.0);
  const auto corrected = casefile::read_volume(folder / "out.nrrd");
  ASSERT_TRUE(corrected) << corrected.error().message;
  const auto centre = [](const casefile::Volume &v, const Vector3d &near) {
    Vector3d sum = Vector3d::Zero();
    double weight = 0.0;
    for (std::size_t i = 0; i < v.pixels(); ++i) {
      if ((v.pixel_mm(i) - near).norm() < 14.0) {
        sum += static_cast<double>(v.voxels[i]) * v.pixel_mm(i);
        weight += static_cast<double>(v.voxels[i]);
      }
    }
    return Vector3d(sum / weight);
  };
  for (const Vector3d &ball : balls) {
    const double before = (centre(image, truth.image_of(ball)) - ball).norm();
    EXPECT_LT((centre(*corrected, ball) - ball).norm(), 0.15) << "was off by " << before;
  }
}

TEST(MriCorrect, AnExpiredFieldIsRefused) {
  const TemporaryFolder folder;
  casefile::DisplacementField field;
  field.displacement_mm.size = {2, 2, 2};
  field.displacement_mm.voxels.resize(8, Eigen::Vector3f::Zero());
  field.signed_error_95_mm.size = {1, 1, 1};
  field.signed_error_95_mm.voxels = {0.1F};
  field.max_error_95_mm = 2.0;
  field.made = "2020-01-01";
  field.expires = "2020-04-01";
  ASSERT_TRUE(casefile::write_displacement_field(folder / "field.nrrd", field));
  const auto run = run_bregma(folder, "mri correct field.nrrd image.nrrd -o out.nrrd --not-corrected");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.err.find("expired on 2020-04-01"), std::string::npos) << run.err;
}

} // namespace
