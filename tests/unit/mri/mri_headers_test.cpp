// What DICOM headers state decides whether a field is applied: headers of several vendors, of mixed and nested folders.
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "casefile/volumes/displacement_file.hpp"
#include "casefile/volumes/scan_header.hpp"
#include "casefile/volumes/volume.hpp"
#include "drivers/sim/scanner/dicom_slice.hpp"
#include "tests/unit/casefile/files.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using namespace bregma;
using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;

constexpr int kSlices = 4;
const std::string kNotCorrected = "ORIGINAL\\PRIMARY\\M\\ND ";

struct Series {
  std::string image_type = kNotCorrected; // as long as that one
  std::string patient_position = "HFS";
  int mark_from = 0; // the first slice with that image type
  std::string uid = "1.2.3.4";
  unsigned darkest = 100; // pixel
};

// Transverse slices of 8 x 8 pixels of 2 mm around the isocentre.
void write_series(const std::filesystem::path &folder, const Series &series) {
  ASSERT_EQ(series.image_type.size(), kNotCorrected.size());
  std::filesystem::create_directories(folder);
  for (int k = 0; k < kSlices; ++k) {
    std::vector<std::uint16_t> pixels(64);
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      pixels[i] = static_cast<std::uint16_t>(series.darkest + 10 * i + static_cast<unsigned>(k));
    }
    sim::scanner::DicomSlice slice;
    slice.columns = slice.rows = 8;
    slice.pixels = pixels;
    slice.position_mm = {-7.0, -7.0, 2.0 * k - 3.0};
    slice.along_row = {1, 0, 0};
    slice.along_column = {0, 1, 0};
    slice.column_spacing_mm = slice.row_spacing_mm = slice.thickness_mm = 2.0;
    slice.patient_position = series.patient_position;
    slice.study_uid = "1.2.3";
    slice.series_uid = series.uid;
    slice.instance_uid = series.uid + "." + std::to_string(k + 1);
    slice.instance = k + 1;
    slice.description = "gre";
    slice.bandwidth_Hz = 260.0;
    std::string bytes = dicom_bytes(slice);
    if (k >= series.mark_from) {
      bytes.replace(bytes.find(kNotCorrected), kNotCorrected.size(), series.image_type);
    }
    std::ofstream(folder / ("IM" + std::to_string(k) + ".dcm"), std::ios::binary) << bytes;
  }
}

void write_field(const std::filesystem::path &file) {
  casefile::DisplacementField field;
  for (auto *grid : {static_cast<image::Grid<3> *>(&field.displacement_mm),
                     static_cast<image::Grid<3> *>(&field.signed_error_95_mm)}) {
    grid->size = {3, 3, 3};
    grid->T_image_index.diagonal().head<3>().setConstant(20.0);
    grid->T_image_index.topRightCorner<3, 1>().setConstant(-20.0);
  }
  field.displacement_mm.voxels.assign(27, Eigen::Vector3f(2, 0, 0)); // everything is shown one pixel to the right
  field.signed_error_95_mm.voxels.assign(27, 0.3F);
  field.max_error_95_mm = 2.0;
  field.made = "2026-01-01";
  const auto written = casefile::write_displacement_field(file, field);
  ASSERT_TRUE(written) << written.error().message;
}

TEST(MriHeaders, WhatIsNotStatedNeedsTheOperatorsWordAndWhatWasCorrectedHasNone) {
  const TemporaryFolder folder;
  write_field(folder / "field.nrrd");
  const auto correct = [&](const Series &series, const std::string &more = "") {
    std::filesystem::remove_all(folder / "images");
    std::filesystem::remove(folder / "out.nrrd");
    write_series(folder / "images/DICOM/S1", series); // as on a CD
    const auto run = run_bregma(folder, "mri correct field.nrrd images -o out.nrrd " + more);
    EXPECT_EQ(std::filesystem::exists(folder / "out.nrrd"), run.exit_code == 0) << run.err;
    return run.exit_code == 0 ? "corrected: " + run.notes : run.err;
  };
  EXPECT_EQ(correct({}), "corrected: ");
  for (const char *word : {"", "--not-corrected"}) {
    EXPECT_NE(correct({"ORIGINAL\\PRI\\M\\DIS2D  "}, word).find("was corrected by the vendor"), std::string::npos);
    EXPECT_NE(correct({"ORIGINAL\\PRI\\ND\\MOSAIC"}, word).find("is a mosaic"), std::string::npos);
    EXPECT_NE(correct({"ORIGINAL\\PRIMARY\\P\\ND "}, word).find("shows phases"), std::string::npos);
    // A series of which the vendor has corrected the last slices only, as by a program that moves images.
    EXPECT_NE(correct({"ORIGINAL\\PRI\\M\\DIS2D  ", "HFS", 2}, word).find("IM2.dcm: states the image type"),
              std::string::npos);
    EXPECT_NE(correct({kNotCorrected, "SITTING"}, word).find("images: patient position 'SITTING' is none of"),
              std::string::npos);
  }
  // As of vendors that do not mark it there.
  const Series other{"ORIGINAL\\PRIMARY\\OTHER"};
  EXPECT_NE(correct(other).find("does not state whether the vendor has corrected it"), std::string::npos);
  EXPECT_EQ(correct(other, "--not-corrected"), "corrected: ");
  EXPECT_NE(correct({kNotCorrected, "FFS"}, "--patient-position HFS").find("states the patient position FFS"),
            std::string::npos);
  EXPECT_NE(correct({kNotCorrected, ""}).find("does not state its patient position: HFS"), std::string::npos);
}

// Feet first, the same slices of the magnet have other coordinates and the reverse shift to the patient's right.
TEST(MriHeaders, AnotherPatientPositionTurnsTheField) {
  const TemporaryFolder folder;
  write_field(folder / "field.nrrd");
  const auto corrected = [&](const char *position) {
    write_series(folder / position, {kNotCorrected, position});
    const auto run = run_bregma(folder, std::string("mri correct field.nrrd ") + position + " -o out.nrrd");
    EXPECT_EQ(run.exit_code, 0) << run.err;
    const auto volume = casefile::read_volume(folder / "out.nrrd");
    EXPECT_TRUE(volume);
    return volume ? *volume : casefile::Volume();
  };
  const casefile::Volume before = [&] {
    write_series(folder / "before", {});
    return *casefile::read_volume(folder / "before");
  }();
  for (const auto &[position, pixels_right] : {std::pair("HFS", 1), {"FFP", 1}, {"FFS", -1}, {"HFP", -1}}) {
    const casefile::Volume after = corrected(position);
    ASSERT_EQ(after.size, before.size) << position;
    for (int i = 1; i < 7; ++i) {
      EXPECT_FLOAT_EQ(after.at(i, 4, 2), before.at(i + pixels_right, 4, 2)) << position << ' ' << i;
    }
  }
}

TEST(MriHeaders, OfTwoSeriesOneIsChosen) {
  const TemporaryFolder folder;
  write_field(folder / "field.nrrd");
  write_series(folder / "images/a", {});
  write_series(folder / "images/b", {"ORIGINAL\\PRI\\M\\DIS2D  ", "HFS", 0, "1.2.3.5"});
  const std::string command = "mri correct field.nrrd images -o out.nrrd";
  const auto both = run_bregma(folder, command);
  EXPECT_EQ(both.exit_code, 2);
  EXPECT_NE(both.err.find("holds 2 DICOM series, choose one of: 1.2.3.4 (gre); 1.2.3.5 (gre)"), std::string::npos)
      << both.err;
  EXPECT_EQ(run_bregma(folder, command + " --series 1.2.3.5").exit_code, 1);
  const auto one = run_bregma(folder, command + " --series 1.2.3.4");
  EXPECT_EQ(one.exit_code, 0) << one.err;
  const auto points = run_bregma(folder, "mri points images/b -o points.csv");
  EXPECT_EQ(points.exit_code, 2);
  EXPECT_NE(points.err.find("control points are written as .mrk.json"), std::string::npos) << points.err;
}

// Acquired with half as many samples along the rows as the image has columns.
TEST(MriHeaders, TheReadOutOfTheHeaderAndItsAcquiredPixelCount) {
  const TemporaryFolder folder;
  write_field(folder / "field.nrrd");
  write_series(folder / "images", {});
  for (int k = 0; k < kSlices; ++k) {
    const auto file = folder / ("images/IM" + std::to_string(k) + ".dcm");
    std::string bytes = tests::read_file(file);
    const std::string phase("\x18\x00\x12\x13", 4); // (0018,1312); the acquisition matrix comes before it
    bytes.insert(bytes.find(phase), std::string("\x18\x00\x10\x13US\x08\x00\x04\x00\x00\x00\x00\x00\x08\x00", 16));
    std::ofstream(file, std::ios::binary) << bytes;
  }
  const auto header = casefile::read_scan_header(folder / "images");
  ASSERT_TRUE(header) << header.error().message;
  EXPECT_EQ(header->bandwidth_Hz, 260.0);
  ASSERT_TRUE(header->read_out.has_value());
  EXPECT_EQ(*header->read_out, Eigen::Vector3d(1, 0, 0));
  EXPECT_DOUBLE_EQ(header->read_out_pixel_mm, 4.0);

  const auto run = [&](const std::string &more) {
    return run_bregma(folder, "mri correct field.nrrd images -o out.nrrd " + more);
  };
  EXPECT_EQ(run("--read-out L").exit_code, 0) << run("--read-out L").err;
  const auto across = run("--read-out A");
  EXPECT_EQ(across.exit_code, 2);
  EXPECT_NE(across.err.find("across that of its header, which runs along R and L"), std::string::npos) << across.err;
  EXPECT_EQ(run("--read-out X").exit_code, 2);
  EXPECT_EQ(run("--bandwidth-Hz 260").exit_code, 2);
}

TEST(MriHeaders, TheErrorsOfAFieldAreAnInputAsWell) {
  const TemporaryFolder folder;
  write_field(folder / "field.nrrd");
  write_series(folder / "images", {});
  const auto run = run_bregma(folder, "mri correct field.nrrd images -o field.error.nrrd");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("field.error.nrrd is an input file"), std::string::npos) << run.err;
  EXPECT_TRUE(casefile::read_displacement_field(folder / "field.nrrd"));
}

TEST(MriHeaders, ImagesOfOneRegistrationAreOfOnePositionAndOneCorrection) {
  const TemporaryFolder folder;
  write_series(folder / "off", {});
  std::ofstream(folder / "frame.toml") << "name = \"f\"\n"
                                          "[[coils]]\nname = \"a\"\nposition_mm = [0, 0, 0]\n"
                                          "[[coils]]\nname = \"b\"\nposition_mm = [50, 0, 0]\n"
                                          "[[coils]]\nname = \"c\"\nposition_mm = [0, 60, 0]\n"
                                          "[[coils]]\nname = \"d\"\nposition_mm = [0, 0, 70]\n";
  std::ofstream(folder / "scans.toml")
      << "frame = \"frame.toml\"\n[[scans]]\norientation = \"T\"\n"
         "background = \"off\"\nforeground = \"on\"\non = [\"a\", \"b\", \"c\", \"d\"]\n";
  const auto reason = [&](const Series &foreground) {
    std::filesystem::remove_all(folder / "on");
    write_series(folder / "on", foreground);
    const auto run = run_bregma(folder, "mri register scans.toml");
    EXPECT_EQ(run.exit_code, 2) << run.out;
    return run.err;
  };
  EXPECT_NE(reason({kNotCorrected, "FFS", 0, "1.2.3.4", 90}).find("has the patient position FFS, the list states HFS"),
            std::string::npos);
  EXPECT_NE(reason({"ORIGINAL\\PRI\\M\\DIS3D  ", "HFS", 0, "1.2.3.4", 90}).find("the vendor has corrected one of them"),
            std::string::npos);
}

} // namespace
