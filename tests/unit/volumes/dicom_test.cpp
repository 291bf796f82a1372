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
  EXPECT_TRUE(notes.empty());
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

} // namespace
} // namespace bregma::casefile
