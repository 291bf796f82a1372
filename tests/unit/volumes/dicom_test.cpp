// Real DICOM series: the result is compared with the bytes of the files, independent of the reading library.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "casefile/volumes/volume.hpp"
#include "dicom_slices.hpp"
#include "files.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

bool unpacked(const std::string &name, const fs::path &folder) {
  const fs::path archive = test::shared_data() / "images" / name;
  return fs::exists(archive) &&
         std::system(("tar -xzf '" + archive.string() + "' -C '" + folder.string() + "'").c_str()) == 0;
}

// Offset and length of an element's value in a little-endian file with implicit types, as used here.
std::string value_of(const std::string &file, std::uint16_t group, std::uint16_t number) {
  const std::uint16_t tag[] = {group, number};
  const std::size_t at = file.find(std::string(reinterpret_cast<const char *>(tag), sizeof tag), 128); // NOLINT
  std::uint32_t length = 0;
  std::memcpy(&length, file.data() + at + 4, sizeof length);
  return file.substr(at + 8, length);
}

std::vector<double> numbers(std::string text) {
  std::replace(text.begin(), text.end(), '\\', ' ');
  std::istringstream stream(text);
  std::vector<double> values;
  for (double value = 0.0; stream >> value;) {
    values.push_back(value);
  }
  return values;
}

std::uint16_t count_of(const std::string &file, std::uint16_t number) {
  std::uint16_t value = 0;
  std::memcpy(&value, value_of(file, 0x0028, number).data(), sizeof value);
  return value;
}

TEST(DicomSeries, ObliqueHeadLiesWhereItsSlicesSay) {
  const TemporaryFolder scratch;
  if (!unpacked("dicom_mr_oblique_384.tgz", scratch.path())) {
    GTEST_SKIP() << "needs " << test::shared_data() / "images/dicom_mr_oblique_384.tgz";
  }
  const auto volume = read_volume(scratch / "dicoms");
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_EQ((std::array<int, 3>{274, 384, 384}), volume->size);
  EXPECT_TRUE(volume->spacing_mm().isApprox(Eigen::Vector3d(0.7, 0.6667, 0.6667), 1e-4)) << volume->spacing_mm();
  const Eigen::Matrix4d T_index_image = volume->T_image_index.inverse();
  for (const char *name : {"dicoms/N2D_0001.dcm", "dicoms/N2D_0130.dcm", "dicoms/N2D_0384.dcm"}) {
    const std::string file = test::read_bytes(scratch / name);
    const auto position = numbers(value_of(file, 0x0020, 0x0032));
    const auto orientation = numbers(value_of(file, 0x0020, 0x0037));
    const auto spacing = numbers(value_of(file, 0x0028, 0x0030));
    ASSERT_TRUE(position.size() == 3 && orientation.size() == 6 && spacing.size() == 2);
    const Eigen::Vector3d origin = Eigen::Map<const Eigen::Vector3d>(position.data());
    const Eigen::Vector3d along_row = spacing[1] * Eigen::Map<const Eigen::Vector3d>(orientation.data());
    const Eigen::Vector3d along_column = spacing[0] * Eigen::Map<const Eigen::Vector3d>(orientation.data() + 3);
    // Pixels are the last element of these files, 16 bits each, uncompressed.
    const std::size_t rows = count_of(file, 0x0010);
    const std::size_t columns = count_of(file, 0x0011);
    ASSERT_LT(2 * rows * columns, file.size());
    std::vector<std::uint16_t> pixels(rows * columns);
    std::memcpy(pixels.data(), file.data() + file.size() - 2 * pixels.size(), 2 * pixels.size());
    std::size_t wrong = 0;
    double off_grid = 0.0;
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t column = 0; column < columns; ++column) {
        Eigen::Vector3d point = origin + double(column) * along_row + double(row) * along_column;
        point.head<2>() *= -1.0; // LPS to RAS
        const Eigen::Vector3d index = (T_index_image * point.homogeneous()).head<3>();
        const Eigen::Vector3d nearest = index.array().round();
        off_grid = std::max(off_grid, (index - nearest).cwiseAbs().maxCoeff());
        wrong += volume->at(int(nearest[0]), int(nearest[1]), int(nearest[2])) == float(pixels[row * columns + column])
                     ? 0
                     : 1;
      }
    }
    EXPECT_LT(off_grid, 0.01) << name;
    EXPECT_EQ(0U, wrong) << name;
  }
}

// A reader that tells nobody refuses the series; the note of another one has the reason. Between its slices the volume
// is interpolated, so at a slice's pixels it is compared with them on average.
TEST(DicomSeries, UnevenAndTiltedIsResampledAndSaid) {
  const TemporaryFolder scratch;
  if (!unpacked("dicom_ct_tilted_uneven_28.tgz", scratch.path())) {
    GTEST_SKIP() << "needs " << test::shared_data() / "images/dicom_ct_tilted_uneven_28.tgz";
  }
  const auto silent = read_volume(scratch / "In/GE");
  ASSERT_FALSE(silent);
  Notes notes;
  const auto volume = read_volume(scratch / "In/GE", {}, &notes);
  ASSERT_TRUE(volume) << volume.error().message;
  for (const std::string &part : std::vector<std::string>{
           (scratch / "In/GE").string() +
               ": the DICOM series is unevenly spaced: the gaps between its 28 slices run from 1.08 mm "
               "(14.dcm to 15.dcm) to 7.00 mm (24.dcm to 25.dcm), 14 of 27 differ from the median",
           std::string("tilted gantry: the slices are shifted sideways by 18.5 degrees"),
           std::string(". It is resampled, linearly, to an even and straight grid of ")}) {
    EXPECT_NE(std::string::npos, silent.error().message.find(part)) << silent.error().message;
    EXPECT_NE(std::string::npos, notes.back().find(part)) << notes.back();
  }
  const Eigen::Matrix4d T_index_image = volume->T_image_index.inverse();
  for (const char *name : {"In/GE/01.dcm", "In/GE/10.dcm", "In/GE/19.dcm", "In/GE/28.dcm"}) {
    const std::string file = test::read_bytes(scratch / name);
    const auto position = numbers(value_of(file, 0x0020, 0x0032));
    const auto orientation = numbers(value_of(file, 0x0020, 0x0037));
    const auto spacing = numbers(value_of(file, 0x0028, 0x0030));
    ASSERT_TRUE(position.size() == 3 && orientation.size() == 6 && spacing.size() == 2);
    const std::size_t rows = count_of(file, 0x0010);
    const std::size_t columns = count_of(file, 0x0011);
    std::vector<std::int16_t> pixels(rows * columns);
    std::memcpy(pixels.data(), file.data() + file.size() - 2 * pixels.size(), 2 * pixels.size());
    double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
    for (std::size_t row = 0; row < rows; row += 3) {
      for (std::size_t column = 0; column < columns; column += 3) {
        Eigen::Vector3d point = Eigen::Map<const Eigen::Vector3d>(position.data()) +
                                double(column) * spacing[1] * Eigen::Map<const Eigen::Vector3d>(orientation.data()) +
                                double(row) * spacing[0] * Eigen::Map<const Eigen::Vector3d>(orientation.data() + 3);
        point.head<2>() *= -1.0; // LPS to RAS
        const Eigen::Array3i at = (T_index_image * point.homogeneous()).head<3>().array().round().cast<int>();
        ASSERT_TRUE((at >= 0).all() && at[0] < volume->size[0] && at[1] < volume->size[1] && at[2] < volume->size[2])
            << name << " " << at.transpose();
        const double a = pixels[row * columns + column];
        const double b = volume->at(at[0], at[1], at[2]);
        n += 1, sa += a, sb += b, saa += a * a, sbb += b * b, sab += a * b;
      }
    }
    const double correlation = (sab - sa * sb / n) / std::sqrt((saa - sa * sa / n) * (sbb - sb * sb / n));
    EXPECT_GT(correlation, 0.97) << name;
  }
  const auto single = read_volume(scratch / "In/GE/01.dcm");
  ASSERT_FALSE(single);
  EXPECT_NE(std::string::npos, single.error().message.find("is one DICOM file; give the folder of its series"));
}

TEST(DicomSeries, SeveralInAFolderMustBeChosenFrom) {
  const TemporaryFolder scratch;
  if (!unpacked("dicom_ct_tilted_uneven_28.tgz", scratch.path()) ||
      !unpacked("dicom_mr_oblique_384.tgz", scratch.path())) {
    GTEST_SKIP() << "needs the DICOM series of " << test::shared_data() / "images";
  }
  for (const char *slice : {"N2D_0100.dcm", "N2D_0101.dcm", "N2D_0102.dcm", "N2D_0103.dcm"}) {
    fs::copy_file(scratch / "dicoms" / slice, scratch / "In/GE" / slice);
  }
  const auto either = read_volume(scratch / "In/GE");
  ASSERT_FALSE(either);
  const std::string &message = either.error().message;
  const std::size_t list = message.find("the folder holds 2 DICOM series, choose one of: ");
  ASSERT_NE(std::string::npos, list) << message;
  std::istringstream uids(message.substr(list + 48));
  int loaded = 0;
  for (std::string entry; std::getline(uids >> std::ws, entry, ';');) {
    const std::string uid = entry.substr(0, entry.find(" ("));
    Notes notes;
    const auto chosen = read_volume(scratch / "In/GE", {.series = uid}, &notes);
    loaded += chosen ? 1 : 0;
    EXPECT_TRUE(chosen) << chosen.error().message;
  }
  EXPECT_EQ(2, loaded);
  const auto unknown = read_volume(scratch / "In/GE", {.series = "1.2.3"});
  ASSERT_FALSE(unknown);
  EXPECT_NE(std::string::npos, unknown.error().message.find("holds no DICOM series 1.2.3, only: "));
}

TEST(DicomSeries, AFolderWithoutImagesIsRefused) {
  const TemporaryFolder scratch;
  const auto volume = read_volume(scratch.path());
  ASSERT_FALSE(volume);
  EXPECT_EQ(scratch.path().string() + ": the folder holds no DICOM images", volume.error().message);
}

// A CD: a list of its content at the top, the series in folders.
TEST(DicomSeries, ACdIsReadFromItsTopAndItsListIsNamed) {
  const TemporaryFolder scratch;
  if (!unpacked("dicom_mr_oblique_384.tgz", scratch.path())) {
    GTEST_SKIP() << "needs " << test::shared_data() / "images/dicom_mr_oblique_384.tgz";
  }
  fs::create_directories(scratch / "cd/IMAGES/A");
  fs::create_directories(scratch / "cd/IMAGES/B");
  for (int slice = 100; slice < 108; ++slice) {
    fs::copy_file(scratch / ("dicoms/N2D_0" + std::to_string(slice) + ".dcm"),
                  scratch / (std::string("cd/IMAGES/") + (slice % 2 == 0 ? "A" : "B") + "/I" + std::to_string(slice)));
  }
  using namespace std::string_literals;
  const std::string header = std::string(128, '\0') + "DICM\2\0\x10\0UI\x14\0"s + "1.2.840.10008.1.2.1\0"s;
  test::write_bytes(scratch / "cd/DICOMDIR", header);
  const auto cut = read_volume(scratch / "cd");
  ASSERT_FALSE(cut);
  EXPECT_NE(std::string::npos, cut.error().message.find("DICOMDIR: is not whole, or damaged: it ends before its data"));
  test::write_bytes(scratch / "cd/DICOMDIR", header + "\4\0\x30\x11"
                                                      "CS\2\0A "s);
  Notes notes;
  const auto volume = read_volume(scratch / "cd", {}, &notes);
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_EQ(*std::min_element(volume->size.begin(), volume->size.end()), 8);
  ASSERT_EQ(notes.size(), 1U) << "nothing of DICOMDIR";
  EXPECT_NE(std::string::npos, notes[0].find("has slices that are numbered from 100 on")) << notes[0];
  const auto itself = read_volume(scratch / "cd/DICOMDIR");
  ASSERT_FALSE(itself);
  EXPECT_NE(std::string::npos, itself.error().message.find("is the list of a DICOM medium; give the folder"));
}

// An equally spaced series without one slice: one gap is twice the others.
TEST(DicomSeries, AMissingSliceIsFound) {
  const TemporaryFolder scratch;
  if (!unpacked("dicom_mr_oblique_384.tgz", scratch.path())) {
    GTEST_SKIP() << "needs " << test::shared_data() / "images/dicom_mr_oblique_384.tgz";
  }
  fs::create_directories(scratch / "few");
  for (const int slice : {100, 101, 102, 104, 105, 106, 107}) {
    const std::string name = "N2D_0" + std::to_string(slice) + ".dcm";
    fs::copy_file(scratch / ("dicoms/" + name), scratch / ("few/" + name));
  }
  const auto gap = read_volume(scratch / "few");
  ASSERT_FALSE(gap);
  EXPECT_NE(std::string::npos, gap.error().message.find("N2D_0102.dcm")) << gap.error().message;
  EXPECT_NE(std::string::npos, gap.error().message.find("1 of 6 differ")) << gap.error().message;
  fs::copy_file(scratch / "few/N2D_0105.dcm", scratch / "few/copy.dcm");
  const auto twice = read_volume(scratch / "few");
  ASSERT_FALSE(twice);
  EXPECT_NE(std::string::npos, twice.error().message.find("has two slices in the same place")) << twice.error().message;
}

// A series of 12 small slices made here, with one of its files changed.
class MadeSeries : public testing::Test {
protected:
  void SetUp() override {
    image::Image<float, 3> image;
    image.size = {8, 8, 12};
    image.T_image_index = Eigen::Affine3d(Eigen::Translation3d(-4.5, -4.5, 10.5)).matrix();
    image.voxels.assign(image.pixels(), 100.0F);
    test::write_dicom(folder, image);
  }
  [[nodiscard]] std::string refusal() const {
    const auto volume = read_volume(folder);
    EXPECT_FALSE(volume);
    return volume ? std::string() : volume.error().message;
  }
  [[nodiscard]] std::string content(const std::string &name) const { return test::read_bytes(folder / name); }
  void replace(const std::string &name, const std::string &before, const std::string &after) const {
    std::string bytes = content(name);
    const std::size_t at = bytes.find(before);
    ASSERT_NE(at, std::string::npos) << before;
    test::write_bytes(folder / name, bytes.replace(at, before.size(), after));
  }

  TemporaryFolder scratch;
  fs::path folder = scratch / "made";
};

TEST_F(MadeSeries, IsReadWhole) {
  const auto volume = read_volume(folder);
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_EQ((std::array<int, 3>{8, 8, 12}), volume->size);
}

TEST_F(MadeSeries, ASliceThatIsNoDicomFileIsNotLeftOut) {
  const std::string whole = content("IM11");
  const std::string damaged = std::string(whole).replace(128, 4, "DIXM");
  for (const std::string &bytes :
       {std::string(), whole.substr(0, 100), whole.substr(0, 131), std::string(6000, '\x55'), damaged}) {
    test::write_bytes(folder / "IM11", bytes);
    EXPECT_NE(refusal().find("made/IM11: is"), std::string::npos) << refusal();
  }
  fs::remove(folder / "IM11");
  EXPECT_EQ(read_volume(folder)->size[2], 11) << "that the last one is missing cannot be known";
  test::write_bytes(folder / "copy.DCM", "");
  EXPECT_NE(refusal().find("copy.DCM: is named like a slice, and is no DICOM file: is it damaged?"), std::string::npos);
  fs::remove(folder / "copy.DCM");
  fs::create_symlink("/nowhere/IM11", folder / "IM11");
  EXPECT_NE(refusal().find("IM11: is a link to a file that is missing"), std::string::npos) << refusal();
}

TEST_F(MadeSeries, AFolderInPlaceOfASliceIsNotLeftOut) {
  fs::create_directory(folder / "other");
  EXPECT_TRUE(read_volume(folder));
  for (const char *name : {"IM12", "image.dcm"}) {
    fs::create_directory(folder / name);
    EXPECT_NE(refusal().find(std::string(name) + ": is named like a slice, and is a folder without slices"),
              std::string::npos)
        << refusal();
    test::write_bytes(folder / name / "notes.txt", "text");
    EXPECT_FALSE(read_volume(folder));
    fs::remove_all(folder / name);
  }
  fs::create_directory(folder / "second.dcm");
  fs::rename(folder / "IM11", folder / "second.dcm/IM11");
  const auto volume = read_volume(folder);
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_EQ(volume->size[2], 12) << "a folder of slices may have any name";
}

TEST_F(MadeSeries, WhatIsLeftOutIsNamed) {
  test::write_bytes(folder / "README.txt", "from the archive");
  test::write_bytes(folder / "IM12.gz", "");
  Notes notes;
  const auto volume = read_volume(folder, {}, &notes);
  ASSERT_TRUE(volume) << volume.error().message;
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_EQ(notes[0], (folder / "IM12.gz").string() + ", " + (folder / "README.txt").string() +
                          " are no DICOM files: they are left out");
}

TEST_F(MadeSeries, SlicesInItsFoldersBelongToIt) {
  fs::create_directory(folder / "more");
  for (const char *name : {"IM8", "IM9", "IM10", "IM11"}) {
    fs::rename(folder / name, folder / "more" / name);
  }
  const auto volume = read_volume(folder);
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_EQ(volume->size[2], 12);
}

TEST_F(MadeSeries, ASliceWithoutItsPixelsIsRefused) {
  const std::string whole = content("IM11");
  test::write_bytes(folder / "IM11", whole.substr(0, whole.rfind(test::tag(0x7FE0, 0x0010))));
  EXPECT_NE(refusal().find("IM11: is not whole: its header states 8 x 8 pixels, and it holds none"), std::string::npos)
      << refusal();
}

// An encoding that is not known.
TEST_F(MadeSeries, ASliceThatCannotBeReadIsNotLeftOut) {
  replace("IM11", "1.2.840.10008.1.2.1", "1.2.840.10008.9.9.9");
  EXPECT_NE(refusal().find("IM11: is a slice of the series that cannot be read"), std::string::npos) << refusal();
  replace("IM11", "1.2.3.6", "1.2.3.7");
  Notes notes;
  const auto volume = read_volume(folder.string() + "/", {}, &notes);
  ASSERT_TRUE(volume) << volume.error().message;
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_NE(notes[0].find("IM11 cannot be read: it is left out"), std::string::npos) << notes[0];
}

// Run lengths, with a fragment that is none.
TEST_F(MadeSeries, ASliceWhosePixelsCannotBeDecodedIsNamed) {
  replace("IM5", "1.2.840.10008.1.2.1", "1.2.840.10008.1.2.5");
  const std::string bytes = content("IM5");
  test::write_bytes(folder / "IM5", bytes.substr(0, bytes.rfind(test::tag(0x7FE0, 0x0010))) +
                                        test::long_element(0x7FE0, 0x0010, "OB", 0xFFFFFFFF, "") + test::item(0, "") +
                                        test::item(64, std::string(64, '\x7F')) + test::kSequenceEnd);
  EXPECT_NE(refusal().find("IM5: its pixels cannot be decoded: is it damaged?"), std::string::npos) << refusal();
}

// The first slice lies at 4.5\4.5\10.5.
TEST_F(MadeSeries, NumbersAreNothingButNumbers) {
  for (const char *text : {"4.5\\4.5\\10,5", "4.5\\4\\1e999", "4.5\\4.5\\0x10", "4.5\\4 5\\10 ", "4.5\\4.5\\nan ",
                           "4.5\\4.5\\10m ", "4.5\\4.51105 "}) {
    std::string padded = text;
    padded.resize(12, ' ');
    replace("IM0", "4.5\\4.5\\10.5", padded);
    EXPECT_NE(refusal().find("does not say where its slices lie: IM0 states Image Position as \""), std::string::npos)
        << refusal();
    replace("IM0", padded, "4.5\\4.5\\10.5");
  }
  replace("IM3", "-1\\0\\0\\0\\-1\\0", "-1\\0\\0\\0\\-1\\k");
  EXPECT_NE(refusal().find("IM3 states Image Orientation as \"-1\\0\\0\\0\\-1\\k\", not as 6 numbers"),
            std::string::npos)
      << refusal();
}

// GDCM takes them as 1.
TEST_F(MadeSeries, AScaleThatIsNoNumberIsRefused) {
  for (const char *slope : {"1,5 ", "0 ", "abc ", "nan "}) {
    const std::string element = test::text_element(0x0028, 0x1053, "DS", slope);
    const std::string pixels = test::tag(0x7FE0, 0x0010);
    replace("IM7", pixels, element + pixels);
    EXPECT_NE(refusal().find("does not say what its values are: IM7 states"), std::string::npos) << refusal();
    replace("IM7", element, "");
  }
  replace("IM7", "MONOCHROME2", "MONOCHROME1");
  EXPECT_NE(refusal().find("IM7 states inverted values (MONOCHROME1)"), std::string::npos) << refusal();
}

// Each slice may have its own scale.
TEST_F(MadeSeries, TheScaleOfEachSliceIsUsed) {
  for (int k = 0; k < 12; ++k) {
    const std::string pixels = test::tag(0x7FE0, 0x0010);
    replace("IM" + std::to_string(k), pixels,
            test::text_element(0x0028, 0x1052, "DS", "-7") +
                test::text_element(0x0028, 0x1053, "DS", std::to_string(1 + k % 3)) + pixels);
  }
  const auto volume = read_volume(folder);
  ASSERT_TRUE(volume) << volume.error().message;
  for (int k = 0; k < 12; ++k) {
    EXPECT_EQ(volume->at(3, 3, k), 100.0F * static_cast<float>(1 + k % 3) - 7.0F) << k;
  }
}

// A series in which something differs from slice 3 on, or of which slices are missing at an end.
TEST(DicomSeries, SlicesOfTwoScansAreRefusedAndNumbersThatAreMissingAreSaid) {
  const TemporaryFolder scratch;
  image::Image<float, 3> head;
  head.size = {4, 5, 6};
  head.voxels.assign(120, 7.0F);
  const auto series = [&](const std::string &name, int first, const auto &edit) {
    fs::create_directory(scratch / name);
    for (int k = first; k < head.size[2]; ++k) {
      std::string bytes = test::dicom_slice(head, k);
      const std::size_t at = bytes.find(test::tag(0x0028, 0x0002));
      test::write_bytes(scratch / (name + "/IM" + std::to_string(k)), bytes.substr(0, at) + edit(k) + bytes.substr(at));
    }
    return scratch / name;
  };
  const auto frame = [](int k) { return test::uid_element(0x0020, 0x0052, k < 3 ? "1.2.9" : "1.2.8"); };
  const auto moved = read_volume(series("moved", 0, frame));
  ASSERT_FALSE(moved);
  EXPECT_NE(moved.error().message.find("has slices in two frames of reference: the patient may have moved between "
                                       "them (IM0 and IM3)"),
            std::string::npos)
      << moved.error().message;
  const fs::path mixed = series("mixed", 0, [](int) { return std::string(); });
  std::string other = test::read_bytes(mixed / "IM5");
  test::write_bytes(mixed / "IM5", other.replace(other.find("Doe^Jane"), 8, "Roe^Jane"));
  const auto two = read_volume(mixed);
  ASSERT_FALSE(two);
  EXPECT_NE(two.error().message.find("has slices of two patients (IM0 and IM5)"), std::string::npos)
      << two.error().message;
  EXPECT_EQ(two.error().message.find("Roe"), std::string::npos);
  Notes notes;
  ASSERT_TRUE(
      read_volume(series("late", 2, [](int) { return test::text_element(0x0020, 0x1002, "IS", "6"); }), {}, &notes));
  ASSERT_EQ(notes.size(), 2U);
  EXPECT_NE(notes[0].find("has slices that are numbered from 3 on"), std::string::npos) << notes[0];
  EXPECT_NE(notes[1].find("has 4 files, which state 6 images in their acquisition"), std::string::npos) << notes[1];
}

} // namespace
} // namespace bregma::casefile
