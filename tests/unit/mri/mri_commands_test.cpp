// `bregma mri field` and `bregma mri correct` on files: the real phantom's markers, and a simulated scanner's image.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

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

// Positions of a list as they stand in the file: LPS.
std::vector<Vector3d> markups(const std::filesystem::path &file) {
  std::ifstream in(file);
  const auto list = nlohmann::json::parse(in).at("markups").at(0);
  EXPECT_EQ(list.at("coordinateSystem"), "LPS");
  std::vector<Vector3d> out;
  for (const auto &p : list.at("controlPoints")) {
    const auto &at = p.at("position");
    out.emplace_back(at[0].get<double>(), at[1].get<double>(), at[2].get<double>());
  }
  return out;
}

TEST(MriPoints, FindsTheMarkersInSlicesOfTheRealPhantom) {
  BREGMA_SHARED_DATA(data, "distortion");
  const TemporaryFolder folder;
  const auto run =
      run_bregma(folder, "mri points " + (data / "MR_dicom").string() + " -o found.mrk.json --markers --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::vector<Vector3d> found = markups(folder / "found.mrk.json");
  // The marker file's z runs over 88 slices 352 / 87 mm apart from -182 mm (dicom_data.json); the headers state 4 mm
  // from -178 mm. Here each of its positions is where its slice is.
  int expected = 0, near = 0;
  double worst_in_plane = 0.0, worst = 0.0;
  for (Vector3d p : markups(data / "MR.mrk.json")) {
    p.z() = -178.0 + 4.0 * (p.z() + 182.0) / (352.0 / 87.0);
    if (p.z() < -20.0 || p.z() > 16.0) { // not in these slices
      continue;
    }
    ++expected;
    const Vector3d closest = *std::min_element(found.begin(), found.end(), [&](const Vector3d &a, const Vector3d &b) {
      return (a - p).squaredNorm() < (b - p).squaredNorm();
    });
    near += (closest - p).norm() < 0.5 ? 1 : 0;
    worst = std::max(worst, (closest - p).norm());
    worst_in_plane = std::max(worst_in_plane, (closest - p).head<2>().norm());
  }
  EXPECT_EQ(expected, 58);
  EXPECT_EQ(found.size(), 58U); // all of them, and nothing else
  EXPECT_GE(near, 57);
  EXPECT_LT(worst_in_plane, 0.3);
  EXPECT_LT(worst, 0.6);
}

TEST(MriPoints, RealSlicesWithoutControlPointsAreRefusedByReason) {
  BREGMA_SHARED_DATA(data, "distortion");
  const TemporaryFolder folder;
  const auto reason = [&](const std::string &images, const std::string &more) {
    const auto run = run_bregma(folder, "mri points " + images + " -o none.mrk.json " + more);
    EXPECT_NE(run.exit_code, 0) << run.out;
    EXPECT_FALSE(std::filesystem::exists(folder / "none.mrk.json"));
    return run.err;
  };
  const auto copy = [&](const char *name, int first, int last) {
    std::filesystem::create_directory(folder / name);
    for (int n = first; n <= last; ++n) {
      const std::string file = "MR0000" + std::to_string(n) + ".dcm";
      std::filesystem::copy_file(data / "MR_dicom" / file, folder / name / file);
    }
  };
  // The grid chain: markers are no grid, and the couch in two slices of CT is no volume.
  EXPECT_NE(reason((data / "MR_dicom").string(), "").find("crossings of bars are seen"), std::string::npos);
  EXPECT_NE(reason((data / "CT_dicom").string(), "--ct").find("2 slices, a volume needs three"), std::string::npos);
  EXPECT_NE(reason((data / "CT_dicom").string(), "--markers").find("2 slices"), std::string::npos);
  // Slices beside the markers, to both chains.
  copy("below", 40, 43);
  copy("above", 47, 50);
  for (const char *name : {"below", "above"}) {
    EXPECT_NE(reason(name, "").find("less than two cells"), std::string::npos);
    EXPECT_NE(reason(name, "--markers").find("0 separate markers of 10 mm are seen"), std::string::npos);
  }
}

// The real series as if its vendor had corrected it: the image type is replaced by one of the same length.
void copy_as_corrected(const std::filesystem::path &from, const std::filesystem::path &to) {
  const std::string before = "ORIGINAL\\PRIMARY\\M\\ND", after = "ORIGINAL\\PRI\\DIS2D\\ND";
  ASSERT_EQ(before.size(), after.size());
  std::filesystem::create_directory(to);
  for (const auto &file : std::filesystem::directory_iterator(from)) {
    std::ifstream in(file.path(), std::ios::binary);
    std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    const auto at = bytes.find(before);
    ASSERT_NE(at, std::string::npos) << file.path();
    bytes.replace(at, before.size(), after);
    std::ofstream(to / file.path().filename(), std::ios::binary) << bytes;
  }
}

TEST(MriCorrect, WhatTheVendorHasCorrectedIsNeverCorrectedAgain) {
  BREGMA_SHARED_DATA(data, "distortion");
  const TemporaryFolder folder;
  casefile::DisplacementField field;
  for (auto *grid : {static_cast<image::Grid<3> *>(&field.displacement_mm),
                     static_cast<image::Grid<3> *>(&field.signed_error_95_mm)}) {
    grid->size = {3, 3, 3};
    grid->T_image_index.diagonal().head<3>().setConstant(200.0);
    grid->T_image_index.topRightCorner<3, 1>().setConstant(-200.0);
  }
  field.displacement_mm.voxels.assign(27, Eigen::Vector3f(1, 0, 0));
  field.signed_error_95_mm.voxels.assign(27, 0.3F);
  field.max_error_95_mm = 2.0;
  field.made = "2026-01-01";
  ASSERT_TRUE(casefile::write_displacement_field(folder / "field.nrrd", field));
  copy_as_corrected(data / "MR_dicom", folder / "corrected");

  // A series and one file of it, with and without the operator's word; a phantom's points do not show the distortion.
  for (const char *image : {"corrected", "corrected/MR000045.dcm"}) {
    for (const char *word : {"", " --not-corrected"}) {
      const auto run = run_bregma(folder, std::string("mri correct field.nrrd ") + image + " -o out.nrrd" + word);
      EXPECT_EQ(run.exit_code, 1) << image << word << run.out;
      EXPECT_NE(run.err.find("was corrected by the vendor"), std::string::npos) << run.err;
      EXPECT_FALSE(std::filesystem::exists(folder / "out.nrrd"));
    }
  }
  const auto points = run_bregma(folder, "mri points corrected -o points.mrk.json --markers");
  EXPECT_EQ(points.exit_code, 1);
  EXPECT_NE(points.err.find("do not show the scanner's distortion"), std::string::npos) << points.err;
  // Formats that cannot state it need the operator's word.
  casefile::Volume volume;
  volume.size = {4, 4, 4};
  volume.voxels.assign(64, 1.0F);
  for (const char *file : {"a.nrrd", "a.nii.gz", "a.mha"}) {
    ASSERT_TRUE(casefile::write_volume(folder / file, volume).has_value()) << file;
    const auto silent = run_bregma(folder, std::string("mri correct field.nrrd ") + file + " -o out.nrrd");
    EXPECT_EQ(silent.exit_code, 1) << file;
    EXPECT_NE(silent.err.find("--not-corrected"), std::string::npos) << silent.err;
    const auto said =
        run_bregma(folder, std::string("mri correct field.nrrd ") + file + " -o out.nrrd --not-corrected");
    EXPECT_EQ(said.exit_code, 0) << said.err;
    std::filesystem::remove(folder / "out.nrrd");
  }
}

TEST(MriField, TheRealRepeatsSeparateGradientsAndB0) {
  BREGMA_SHARED_DATA(data, "distortion/repeat");
  const TemporaryFolder folder;
  const std::string files = "mri field " + (data / "CT.mrk.json").string() + " " + (data / "MR_AP.mrk.json").string() +
                            " " + (data / "MR_PA.mrk.json").string();
  const std::string protocol = " --pixel-mm 2.578 --bandwidth-Hz 260";
  // The repeats differ along the read-out (x) and, less, along the slices' normal (z): both are reversed.
  const auto run = run_bregma(folder, files + protocol +
                                          " --read-out R --read-out L --slice-shift S --slice-shift I"
                                          " --thickness-mm 4 --pulse-Hz 1200 -o gradients.nrrd --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = run.json();
  ASSERT_EQ(json["scans"].size(), 2U);
  // The first scan alone does not describe the second.
  const auto mean = [&](const char *by) { return json["scans"][1][by]["overall"]["mean_mm"].get<double>(); };
  EXPECT_GT(mean("by_first_scan"), 2.0 * mean("by_all_scans"));
  EXPECT_TRUE(std::filesystem::exists(folder / "gradients.nrrd"));

  const auto refused = [&](const std::string &more) {
    const auto bad = run_bregma(folder, files + more);
    EXPECT_EQ(bad.exit_code, 1) << more << bad.out;
    return bad.err;
  };
  EXPECT_NE(refused("").find("2 scans need --read-out once per scan"), std::string::npos);
  EXPECT_NE(refused(" --read-out R --read-out L").find("--pixel-mm"), std::string::npos);
  EXPECT_EQ(run_bregma(folder, files + protocol + " --read-out R --read-out Q").exit_code, 2);
  EXPECT_EQ(run_bregma(folder, files + protocol).exit_code, 2);
  EXPECT_NE(refused(protocol + " --read-out R --read-out R").find("alike"), std::string::npos);
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
  const auto json = run_bregma(folder, "mri field ct.csv mr.csv -o field.nrrd --any-orientation --json").json();
  EXPECT_EQ(json["accepted"], false);
  EXPECT_TRUE(json["output"].is_null() && json["residual"].is_null()) << json;
}

TEST(MriField, PointsThatDoNotBelongTogetherAreRefusedByReason) {
  const TemporaryFolder folder;
  const Points3 lattice = test::lattice(5, 17.0);
  write_points(folder, "ct.csv", lattice);
  write_points(folder, "mr.csv", test::SourceField(1, 1.0).image_of(lattice));
  write_points(folder, "cm.csv", 0.1 * lattice);
  write_points(folder, "few.csv", lattice.leftCols(11));
  const auto reason = [&](const std::string &files) {
    const auto run = run_bregma(folder, "mri field ct.csv " + files + " -o field.nrrd");
    EXPECT_EQ(run.exit_code, 1) << run.out;
    EXPECT_EQ(std::count(run.err.begin(), run.err.end(), '\n'), 1) << run.err;
    EXPECT_FALSE(std::filesystem::exists(folder / "field.nrrd"));
    return run.err;
  };
  const std::string units = "apart in CT and 1.70 mm in MR: are both of one phantom, and in one unit?";
  EXPECT_NE(reason("cm.csv").find(units), std::string::npos) << reason("cm.csv");
  EXPECT_NE(reason("few.csv").find("12 points are needed in each list, there are 125 in CT and 11 in MR"),
            std::string::npos);
  EXPECT_NE(reason("ct.csv").find("ct.csv and ct.csv hold the same points"), std::string::npos);
  write_points(folder, "many.csv", test::lattice(22, 17.0));
  EXPECT_NE(reason("many.csv").find("many.csv holds 10648 points, control points of a phantom are at most 10000"),
            std::string::npos);
  // Exchanged, the field would distort twice.
  const Points3 wide = test::lattice(8, 17.0);
  write_points(folder, "straight.csv", wide);
  write_points(folder, "bent.csv", test::SourceField(5, 4.0).image_of(wide));
  const auto exchanged = run_bregma(folder, "mri field bent.csv straight.csv -o field.nrrd --json");
  EXPECT_EQ(exchanged.exit_code, 1) << exchanged.out;
  EXPECT_NE(exchanged.out.find("so the files are exchanged"), std::string::npos) << exchanged.out;
  EXPECT_EQ(run_bregma(folder, "mri field straight.csv bent.csv").exit_code, 0);
  const std::string two = reason("mr.csv cm.csv --read-out R --read-out L --pixel-mm 1 --bandwidth-Hz 260");
  EXPECT_NE(two.find("cm.csv: no match"), std::string::npos) << two;
  EXPECT_NE(two.find(units), std::string::npos) << two;
}

Points3 columns(const std::vector<Vector3d> &points) {
  Points3 out(3, static_cast<Eigen::Index>(points.size()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.col(static_cast<Eigen::Index>(i)) = points[i];
  }
  return out;
}

// Soft balls at these places, in voxels of 2 mm.
casefile::Volume image_of_balls(const Points3 &shown_mm) {
  casefile::Volume out;
  out.size = {64, 64, 40};
  out.T_image_index.topLeftCorner<3, 3>() *= 2.0;
  out.T_image_index.topRightCorner<3, 1>() = Vector3d(-63.0, -63.0, -39.0);
  for (std::size_t i = 0; i < out.pixels(); ++i) {
    double value = 0.0;
    for (const auto &ball : shown_mm.colwise()) {
      value += 1000.0 * std::exp(-0.5 * (out.pixel_mm(i) - ball).squaredNorm() / 16.0);
    }
    out.voxels.push_back(static_cast<float>(value));
  }
  return out;
}

Vector3d centre_near(const casefile::Volume &v, const Vector3d &near) {
  Vector3d sum = Vector3d::Zero();
  double weight = 0.0;
  for (std::size_t i = 0; i < v.pixels(); ++i) {
    if ((v.pixel_mm(i) - near).norm() < 14.0) {
      sum += static_cast<double>(v.voxels[i]) * v.pixel_mm(i);
      weight += static_cast<double>(v.voxels[i]);
    }
  }
  return sum / weight;
}

// An image of balls at known places, as a distorting scanner shows them.
TEST(MriCorrect, MovesTissueBackToItsPlace) {
  const TemporaryFolder folder;
  const test::SourceField truth(5, 3.0);
  const Points3 lattice = test::lattice(9, 20.0);
  write_points(folder, "ct.csv", lattice);
  write_points(folder, "mr.csv", truth.image_of(lattice));
  ASSERT_EQ(run_bregma(folder, "mri field ct.csv mr.csv -o field.nrrd --scanner \"A B\"").exit_code, 0);
  const std::vector<Vector3d> balls{{40, 30, 20}, {-45, 20, -25}, {30, -50, 10}};
  const casefile::Volume image = image_of_balls(truth.image_of(columns(balls)));
  ASSERT_TRUE(casefile::write_volume(folder / "image.nrrd", image));
  const auto refused = run_bregma(folder, "mri correct field.nrrd image.nrrd -o out.nrrd");
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_NE(refused.err.find("say so by --not-corrected"), std::string::npos) << refused.err;
  const auto run = run_bregma(folder, "mri correct field.nrrd image.nrrd -o out.nrrd --not-corrected --json");
  ASSERT_EQ(run.exit_code, 0) << run.out << run.err;
  EXPECT_GT(run.json()["max_shift_mm"].get<double>(), 1.0);
  for (const char *command :
       {"mri field ct.csv mr.csv", "mri correct field.nrrd image.nrrd -o again.nrrd --not-corrected"}) {
    tests::expect_lost_output_is_said(folder, command);
  }
  const auto corrected = casefile::read_volume(folder / "out.nrrd");
  ASSERT_TRUE(corrected) << corrected.error().message;
  for (const Vector3d &ball : balls) {
    const double before = (centre_near(image, truth.image_of(ball)) - ball).norm();
    EXPECT_LT((centre_near(*corrected, ball) - ball).norm(), 0.15) << "was off by " << before;
  }
}

// The phantom with opposed read-outs along x; the image with one along y and half the shift per Hz.
TEST(MriCorrect, TheB0OfEveryReadOutIsCorrected) {
  const TemporaryFolder folder;
  const test::SourceField gradients(6, 2.0), b0(7, 40.0); // mm; Hz as the first coordinate
  const auto shown = [&](const Points3 &points, const Vector3d &mm_per_Hz) {
    Points3 out = gradients.image_of(points);
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      out.col(i) += b0.displacement(points.col(i)).x() * mm_per_Hz;
    }
    return out;
  };
  const Points3 lattice = test::lattice(9, 20.0);
  const Vector3d d = Vector3d::UnitX() / 26.0;
  write_points(folder, "ct.csv", lattice);
  write_points(folder, "right.csv", shown(lattice, d));
  write_points(folder, "left.csv", shown(lattice, -d));
  const std::string protocol = " --pixel-mm 1 --bandwidth-Hz 26";
  ASSERT_EQ(run_bregma(folder, "mri field ct.csv right.csv -o one.nrrd --read-out R" + protocol).exit_code, 0);
  const auto both =
      run_bregma(folder, "mri field ct.csv right.csv left.csv -o both.nrrd --read-out R --read-out L" + protocol);
  ASSERT_EQ(both.exit_code, 0) << both.err;
  EXPECT_NE(both.out.find("both.b0.nrrd"), std::string::npos) << both.out;

  const std::vector<Vector3d> balls{{40, 30, 20}, {-45, 20, -25}, {30, -50, 10}};
  const Points3 imaged = shown(columns(balls), -Vector3d::UnitY() * (2.0 / 104.0));
  ASSERT_TRUE(casefile::write_volume(folder / "image.nrrd", image_of_balls(imaged)));
  const auto largest = [&](const std::string &file) {
    const auto corrected = casefile::read_volume(folder / file);
    double out = corrected ? 0.0 : 99.0;
    for (const Vector3d &ball : balls) {
      out = std::max(out, corrected ? (centre_near(*corrected, ball) - ball).norm() : 99.0);
    }
    return out;
  };
  const std::string correct = "mri correct both.nrrd image.nrrd --not-corrected -o ";
  const auto plain = run_bregma(folder, correct + "plain.nrrd");
  EXPECT_EQ(plain.exit_code, 0) << plain.err;
  EXPECT_NE(plain.notes.find("the part of B0 is not corrected"), std::string::npos) << plain.notes;
  const auto whole = run_bregma(folder, correct + "whole.nrrd --read-out P --bandwidth-Hz 104");
  EXPECT_EQ(whole.exit_code, 0) << whole.err;
  EXPECT_EQ(whole.err, "");
  EXPECT_LT(largest("whole.nrrd"), 0.15);
  EXPECT_GT(largest("plain.nrrd"), 2.0 * largest("whole.nrrd"));

  // A field of one read-out says where it is not that of the image.
  const auto other =
      run_bregma(folder, "mri correct one.nrrd image.nrrd --not-corrected -o out.nrrd --read-out P --bandwidth-Hz 104");
  EXPECT_EQ(other.exit_code, 0) << other.err;
  EXPECT_NE(other.notes.find("measured with another read-out, pixel or bandwidth"), std::string::npos) << other.notes;
  std::filesystem::remove(folder / "out.nrrd");

  // A bandwidth that nobody states; a field of the opposite read-out.
  const auto silent = run_bregma(folder, correct + "out.nrrd --read-out P");
  EXPECT_EQ(silent.exit_code, 2);
  EXPECT_NE(silent.err.find("state it by --bandwidth-Hz"), std::string::npos) << silent.err;
  const auto opposite =
      run_bregma(folder, "mri correct one.nrrd image.nrrd --not-corrected -o out.nrrd --read-out L --bandwidth-Hz 104");
  EXPECT_EQ(opposite.exit_code, 2);
  EXPECT_NE(opposite.err.find("measured with the opposite read-out"), std::string::npos) << opposite.err;
  EXPECT_FALSE(std::filesystem::exists(folder / "out.nrrd"));
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
  const auto json = run_bregma(folder, "mri correct field.nrrd image.nrrd -o out.nrrd --not-corrected --json").json();
  EXPECT_TRUE(json["accepted"] == false && json["output"].is_null()) << json;
}

} // namespace
