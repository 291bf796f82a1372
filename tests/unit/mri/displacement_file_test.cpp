// The files of a distortion field: round trip, refusals by field, and cuts anywhere.
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "casefile/volumes/displacement_file.hpp"
#include "casefile/volumes/scan_fields_file.hpp"
#include "tests/unit/casefile/files.hpp"

namespace {

using namespace bregma;
using namespace bregma::casefile;
using bregma::test::TemporaryFolder;

DisplacementField small_field() {
  DisplacementField out;
  out.displacement_mm.size = {3, 4, 2};
  out.displacement_mm.T_image_index << 4, 0, 0, -10, 0, 4, 0, 20, 0, 0, 5, 30, 0, 0, 0, 1;
  for (int i = 0; i < 24; ++i) {
    out.displacement_mm.voxels.emplace_back(0.1F * static_cast<float>(i), -2.0F, 0.5F);
  }
  out.signed_error_95_mm.size = {2, 1, 1};
  out.signed_error_95_mm.voxels = {0.25F, -1.5F};
  out.max_error_95_mm = 2.0;
  out.scanner = "SIEMENS Avanto 18030";
  out.protocol = "gre_trans, 260 Hz/pixel";
  out.made = "2026-11-29";
  out.expires = "2027-02-27";
  return out;
}

TEST(DisplacementFile, WhatIsWrittenIsReadBack) {
  const TemporaryFolder folder;
  const DisplacementField field = small_field();
  const auto written = write_displacement_field(folder / "field.nrrd", field);
  ASSERT_TRUE(written) << written.error().message;
  const auto read = read_displacement_field(folder / "field.nrrd");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->displacement_mm.size, field.displacement_mm.size);
  EXPECT_EQ(read->displacement_mm.T_image_index, field.displacement_mm.T_image_index);
  EXPECT_EQ(read->displacement_mm.voxels, field.displacement_mm.voxels);
  EXPECT_EQ(read->signed_error_95_mm.voxels, field.signed_error_95_mm.voxels);
  EXPECT_EQ(read->max_error_95_mm, 2.0);
  EXPECT_EQ(read->scanner, field.scanner);
  EXPECT_EQ(read->protocol, field.protocol);
  EXPECT_EQ(read->patient_position, "HFS");
  EXPECT_EQ(read->made, field.made);
  EXPECT_EQ(read->expires, field.expires);
}

TEST(DisplacementFile, FilesThatAreNoFieldAreRefusedByField) {
  const TemporaryFolder folder;
  const auto file = folder / "field.nrrd";
  ASSERT_TRUE(write_displacement_field(file, small_field()));
  const std::string good = tests::read_file(file);
  const auto message = [&](const std::string &from, const std::string &to) {
    std::string text = good;
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    std::ofstream(file, std::ios::binary) << text;
    const auto read = read_displacement_field(file);
    return read ? std::string("accepted") : read.error().message.substr(file.string().size());
  };
  EXPECT_EQ(message("type: float", "type: double"),
            ": type \"double\" is not that of a distortion field as `bregma mri field` writes it: float");
  EXPECT_EQ(message("sizes: 3 3 4 2", "sizes: 3 3 4"),
            ": sizes \"3 3 4\" must be those of three axes with at most 64000000 nodes");
  EXPECT_EQ(message("sizes: 3 3 4 2", "sizes: 3 3 4 -2"), ": sizes \"3 3 4 -2\" must be whole numbers of at least one");
  EXPECT_EQ(message("max_error_95_mm:=2", "max_error_95_mm:=x"),
            ": bregma max_error_95_mm \"x\" is not a positive number");
  EXPECT_EQ(message("made:=2026-11-29", "made:=yesterday"),
            ": bregma made \"yesterday\" or expires \"2027-02-27\" is not a date (YYYY-MM-DD)");
  EXPECT_EQ(message("part:=", "part:=x"), ": bregma part \"x\" is not gradients or B0");
  EXPECT_EQ(message("(-4,-0,0)", "(0,0,0)").substr(0, 20), ": space directions \"");
  EXPECT_EQ(message("NRRD0005", "NIFTI005"), ": is not an NRRD file");
  const std::string cut = message(good, good.substr(0, good.size() - 1));
  EXPECT_NE(cut.find("its header asks for"), std::string::npos) << cut;

  DisplacementField lines = small_field();
  lines.scanner = "a\nb";
  const auto refused = write_displacement_field(file, lines);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, file.string() + ": scanner has a line break or a control character");
  EXPECT_FALSE(write_displacement_field(folder / "field.mha", small_field()));
}

TEST(ScanFieldsFile, BothPartsAreWrittenAndReadBack) {
  const TemporaryFolder folder;
  const auto file = folder / "field.nrrd";
  const DisplacementField one = small_field();
  const auto table =
      std::make_shared<const mri::FieldTable>(one.displacement_mm, one.signed_error_95_mm, one.max_error_95_mm);
  const Eigen::Vector3d mm_per_Hz(1.0 / 260.0, 0.0, -0.25);
  ASSERT_TRUE(write_scan_fields(file, mri::ScanFields(table, table, mm_per_Hz), one));
  const auto both = read_scan_fields(file);
  ASSERT_TRUE(both) << both.error().message;
  EXPECT_TRUE(both->fields.has_b0());
  EXPECT_EQ(both->fields.mm_per_Hz(), mm_per_Hz);
  EXPECT_EQ(both->header.scanner, one.scanner);
  EXPECT_EQ(both->fields.by_b0()->displacements().voxels, one.displacement_mm.voxels);
  const auto reason = [&](const std::filesystem::path &path) {
    const auto read = read_scan_fields(path);
    return read ? std::string("read") : read.error().message;
  };
  EXPECT_NE(reason(b0_file_of(file)).find("holds the part of B0 alone"), std::string::npos);

  // The part of B0 of another field, a broken one, and none.
  const std::string good = tests::read_file(b0_file_of(file));
  std::string other = good;
  other.replace(other.find("gradients:=") + 11, 4, "0000");
  std::ofstream(b0_file_of(file), std::ios::binary) << other;
  EXPECT_NE(reason(file).find("is not the part of B0 that belongs to"), std::string::npos) << reason(file);
  other = good;
  other.replace(other.find("mm_per_Hz:=("), 12, "mm_per_Hz:=x");
  std::ofstream(b0_file_of(file), std::ios::binary) << other;
  EXPECT_NE(reason(file).find("is not three numbers"), std::string::npos) << reason(file);
  std::filesystem::remove(b0_file_of(file));
  EXPECT_NE(reason(file).find("holds the part of the gradients alone"), std::string::npos) << reason(file);

  // A field of one read-out replaces both.
  ASSERT_TRUE(write_scan_fields(file, mri::ScanFields(table, table, mm_per_Hz), one));
  ASSERT_TRUE(write_scan_fields(file, mri::ScanFields(table, mm_per_Hz), one));
  EXPECT_FALSE(std::filesystem::exists(b0_file_of(file)));
  const auto single = read_scan_fields(file);
  ASSERT_TRUE(single) << single.error().message;
  EXPECT_FALSE(single->fields.has_b0());
  EXPECT_EQ(single->fields.mm_per_Hz(), mm_per_Hz);
}

TEST(DisplacementFile, ErrorsOfAnotherFieldAreRefusedAndAFailedWriteKeepsTheFormer) {
  const TemporaryFolder folder;
  DisplacementField other = small_field();
  other.displacement_mm.voxels.front().x() = 7.0F;
  ASSERT_TRUE(write_displacement_field(folder / "field.nrrd", small_field()));
  ASSERT_TRUE(write_displacement_field(folder / "other.nrrd", other));
  std::filesystem::copy_file(folder / "other.error.nrrd", folder / "field.error.nrrd",
                             std::filesystem::copy_options::overwrite_existing);
  const auto read = read_displacement_field(folder / "field.nrrd");
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("field.error.nrrd: holds the errors of another field than "), std::string::npos)
      << read.error().message;

  ASSERT_TRUE(write_displacement_field(folder / "field.nrrd", small_field()));
  std::filesystem::create_directory(folder / "field.nrrd.new"); // where the new file would be
  EXPECT_FALSE(write_displacement_field(folder / "field.nrrd", small_field()));
  const auto kept = read_displacement_field(folder / "field.nrrd");
  EXPECT_TRUE(kept) << kept.error().message;
}

TEST(DisplacementFile, ACutAnywhereIsRefused) {
  const TemporaryFolder folder;
  const auto file = folder / "field.nrrd";
  ASSERT_TRUE(write_displacement_field(file, small_field()));
  const std::string good = tests::read_file(file);
  for (std::size_t size = 0; size < good.size(); size += 7) {
    std::ofstream(file, std::ios::binary) << good.substr(0, size);
    EXPECT_FALSE(read_displacement_field(file)) << size;
  }
}

} // namespace
