// Enhanced multi-frame DICOM: every pixel lies where the functional groups of its frame say, or the file is refused.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include "casefile/volumes/volume.hpp"
#include "tests/unit/volumes/dicom_bytes.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

using Eigen::Vector3d;
using test::item;
using test::kItemEnd;
using test::kSequenceEnd;
using test::little;
using test::long_element;
using test::short_element;

const std::string kEnhancedCt = "1.2.840.10008.5.1.4.1.1.2.1";
const std::string kEnhancedMr = "1.2.840.10008.5.1.4.1.1.4.1";
const std::string kLegacyCt = "1.2.840.10008.5.1.4.1.1.2.2";
const std::string kLegacyMr = "1.2.840.10008.5.1.4.1.1.4.4";

constexpr std::size_t kColumns = 4;
constexpr std::size_t kRows = 3;

struct Frames {
  std::string storage = kEnhancedMr;
  std::vector<Vector3d> positions_mm; // LPS
  Vector3d row = Vector3d(0.8, 0.6, 0.0);
  Vector3d column = Vector3d(0.0, 0.0, -1.0);
  Eigen::Vector2d spacing_mm{0.9, 0.7};          // between rows, between columns
  std::vector<std::pair<double, double>> scales; // slope and intercept of each frame; empty: none stated
  bool orientation_of_each = false;
  bool stated_lengths = false; // of sequences and items
  bool has_groups = true;
  std::size_t stated_frames = 0; // 0: as many as there are
};

std::uint16_t pixel(std::size_t frame, std::size_t row, std::size_t column) {
  return static_cast<std::uint16_t>(100 * frame + 10 * row + column);
}

std::string even_text(const std::string &text, char pad) { return text.size() % 2 == 0 ? text : text + pad; }
std::string uid(std::uint32_t group, std::uint32_t element, const std::string &value) {
  return short_element(group, element, "UI", even_text(value, '\0'));
}
std::string decimals(std::uint32_t group, std::uint32_t element, const std::vector<double> &values) {
  std::string text;
  for (const double value : values) {
    char one[20];
    (void)std::snprintf(one, sizeof one, "%.9g", value);
    text += (text.empty() ? "" : "\\") + std::string(one);
  }
  return short_element(group, element, "DS", even_text(text, ' '));
}
std::string number(std::uint32_t element, std::size_t value) {
  return short_element(0x0028, element, "US", little(static_cast<std::uint32_t>(value), 2));
}

std::string sequence(const Frames &frames, std::uint32_t group, std::uint32_t element,
                     const std::vector<std::string> &items) {
  std::string content;
  for (const std::string &one : items) {
    content +=
        frames.stated_lengths ? item(static_cast<std::uint32_t>(one.size()), one) : item(0xFFFFFFFF, one + kItemEnd);
  }
  return frames.stated_lengths ? long_element(group, element, "SQ", static_cast<std::uint32_t>(content.size()), content)
                               : long_element(group, element, "SQ", 0xFFFFFFFF, content + kSequenceEnd);
}

std::string groups_of(const Frames &f) {
  const auto macro = [&](std::uint32_t group, std::uint32_t element, const std::string &content) {
    return sequence(f, group, element, {content});
  };
  const std::string orientation = macro(
      0x0020, 0x9116, decimals(0x0020, 0x0037, {f.row[0], f.row[1], f.row[2], f.column[0], f.column[1], f.column[2]}));
  const std::string measures = macro(
      0x0028, 0x9110, decimals(0x0018, 0x0050, {9.0}) + decimals(0x0028, 0x0030, {f.spacing_mm[0], f.spacing_mm[1]}));
  std::vector<std::string> each;
  for (std::size_t i = 0; i < f.positions_mm.size(); ++i) {
    const Vector3d &at = f.positions_mm[i];
    std::string one = macro(0x0020, 0x9113, decimals(0x0020, 0x0032, {at[0], at[1], at[2]}));
    one += f.orientation_of_each ? orientation : std::string();
    one += f.scales.empty()
               ? std::string()
               : macro(0x0028, 0x9145,
                       decimals(0x0028, 0x1052, {f.scales[i].second}) + decimals(0x0028, 0x1053, {f.scales[i].first}) +
                           short_element(0x0028, 0x1054, "LO", "US"));
    each.push_back(std::move(one));
  }
  return sequence(f, 0x5200, 0x9229, {(f.orientation_of_each ? std::string() : orientation) + measures}) +
         sequence(f, 0x5200, 0x9230, each);
}

std::string file_of(const Frames &f) {
  std::string pixels;
  for (std::size_t k = 0; k < f.positions_mm.size(); ++k) {
    for (std::size_t j = 0; j < kRows; ++j) {
      for (std::size_t i = 0; i < kColumns; ++i) {
        pixels += little(pixel(k, j, i), 2);
      }
    }
  }
  const std::string meta = uid(2, 2, f.storage) + uid(2, 3, "1.2.3.4") + uid(2, 0x10, "1.2.840.10008.1.2.1");
  const std::size_t stated = f.stated_frames == 0 ? f.positions_mm.size() : f.stated_frames;
  return std::string(128, '\0') + "DICM" +
         short_element(2, 0, "UL", little(static_cast<std::uint32_t>(meta.size()), 4)) + meta +
         uid(0x0008, 0x0016, f.storage) + uid(0x0008, 0x0018, "1.2.3.4") +
         short_element(0x0008, 0x0060, "CS", f.storage == kEnhancedCt || f.storage == kLegacyCt ? "CT" : "MR") +
         uid(0x0020, 0x000D, "1.2.3.5") + uid(0x0020, 0x000E, "1.2.3.6") + number(0x0002, 1) +
         short_element(0x0028, 0x0004, "CS", "MONOCHROME2 ") +
         short_element(0x0028, 0x0008, "IS", even_text(std::to_string(stated), ' ')) + number(0x0010, kRows) +
         number(0x0011, kColumns) + number(0x0100, 16) + number(0x0101, 16) + number(0x0102, 15) + number(0x0103, 0) +
         (f.has_groups ? groups_of(f) : std::string()) +
         long_element(0x7FE0, 0x0010, "OW", static_cast<std::uint32_t>(pixels.size()), pixels);
}

Vector3d normal_of(const Frames &f) { return f.row.cross(f.column); }

// Five frames, 1.5 mm apart.
Frames five(const std::string &storage) {
  Frames out;
  out.storage = storage;
  for (int i = 0; i < 5; ++i) {
    out.positions_mm.push_back(Vector3d(-12.0, 34.0, 56.0) + 1.5 * i * normal_of(out));
  }
  return out;
}

// The largest difference between a pixel and the voxel where its frame says that it lies.
double largest_difference(const Frames &f, const Volume &volume) {
  const Eigen::Matrix4d T_index_image = volume.T_image_index.inverse();
  double out = 0.0;
  for (std::size_t k = 0; k < f.positions_mm.size(); ++k) {
    for (std::size_t j = 0; j < kRows; ++j) {
      for (std::size_t i = 0; i < kColumns; ++i) {
        Vector3d point = f.positions_mm[k] + static_cast<double>(i) * f.spacing_mm[1] * f.row +
                         static_cast<double>(j) * f.spacing_mm[0] * f.column;
        point.head<2>() *= -1.0; // LPS to RAS
        const Vector3d index = (T_index_image * point.homogeneous()).head<3>();
        const Eigen::Array3i at = index.array().round().cast<int>();
        if ((index - at.cast<double>().matrix()).norm() > 0.01 || at.minCoeff() < 0 || at[0] >= volume.size[0] ||
            at[1] >= volume.size[1] || at[2] >= volume.size[2]) {
          return 1e9;
        }
        const auto [slope, intercept] = f.scales.empty() ? std::pair(1.0, 0.0) : f.scales[k];
        out = std::max(
            out, std::abs(slope * pixel(k, j, i) + intercept - static_cast<double>(volume.at(at[0], at[1], at[2]))));
      }
    }
  }
  return out;
}

class DicomFrames : public ::testing::Test {
protected:
  base::Result<Volume> read(const Frames &frames, Notes *notes = nullptr) {
    test::write_bytes(folder_ / "frames.dcm", file_of(frames));
    return read_volume(folder_ / "frames.dcm", {}, notes);
  }
  std::string refusal(const Frames &frames) {
    Notes notes;
    const auto volume = read(frames, &notes);
    return volume ? "read" : volume.error().message;
  }
  test::TemporaryFolder folder_;
};

TEST_F(DicomFrames, EveryPixelLiesWhereItsFrameSays) {
  for (const std::string &storage : {kEnhancedCt, kEnhancedMr, kLegacyCt, kLegacyMr}) {
    for (const bool stated_lengths : {false, true}) {
      Frames frames = five(storage);
      frames.stated_lengths = stated_lengths;
      frames.orientation_of_each = stated_lengths;
      const auto volume = read(frames);
      ASSERT_TRUE(volume) << storage << ": " << volume.error().message;
      EXPECT_EQ(largest_difference(frames, *volume), 0.0) << storage;
      const auto in_folder = read_volume(folder_.path());
      ASSERT_TRUE(in_folder) << in_folder.error().message;
      EXPECT_EQ(in_folder->voxels, volume->voxels);
      EXPECT_EQ(in_folder->T_image_index, volume->T_image_index);
    }
  }
}

TEST_F(DicomFrames, TheOrderOfTheFramesDoesNotMatter) {
  for (const std::string &storage : {kEnhancedCt, kEnhancedMr, kLegacyCt, kLegacyMr}) {
    Frames frames = five(storage);
    std::reverse(frames.positions_mm.begin(), frames.positions_mm.end());
    const auto reversed = read(frames);
    ASSERT_TRUE(reversed) << reversed.error().message;
    EXPECT_EQ(largest_difference(frames, *reversed), 0.0) << storage;
    std::swap(frames.positions_mm[1], frames.positions_mm[3]);
    std::swap(frames.positions_mm[0], frames.positions_mm[1]);
    const auto mixed = read(frames);
    ASSERT_TRUE(mixed) << mixed.error().message;
    EXPECT_EQ(largest_difference(frames, *mixed), 0.0) << storage;
  }
}

TEST_F(DicomFrames, TheScaleOfEachFrameIsUsed) {
  for (const std::string &storage : {kEnhancedCt, kEnhancedMr, kLegacyCt, kLegacyMr}) {
    Frames frames = five(storage);
    frames.scales.assign(5, {1.0, -1024.0});
    const auto hounsfield = read(frames);
    ASSERT_TRUE(hounsfield) << hounsfield.error().message;
    EXPECT_EQ(largest_difference(frames, *hounsfield), 0.0) << storage;
    frames.scales = {{2.0, 0.0}, {0.25, 3.0}, {1.5, -7.0}, {2.0, 1.0}, {3.0, 0.0}};
    const auto each = read(frames);
    ASSERT_TRUE(each) << each.error().message;
    EXPECT_LT(largest_difference(frames, *each), 1e-3) << storage;
    frames.scales[2].first = 0.0;
    EXPECT_NE(refusal(frames).find("frame 3"), std::string::npos) << refusal(frames);
  }
}

TEST_F(DicomFrames, ATiltedStackIsResampledAndSaid) {
  Frames frames = five(kEnhancedCt);
  for (std::size_t i = 0; i < 5; ++i) {
    frames.positions_mm[i] += 0.4 * static_cast<double>(i) * frames.column;
  }
  EXPECT_FALSE(read(frames)) << "a reader that prints no notes";
  Notes notes;
  ASSERT_TRUE(read(frames, &notes));
  ASSERT_FALSE(notes.empty());
  EXPECT_NE(notes.back().find("has a tilted gantry: the slices are shifted sideways by 14.9 degrees"),
            std::string::npos)
      << notes.back();
}

TEST_F(DicomFrames, WhatIsNoVolumeIsRefusedByName) {
  // Several volumes in one file: time, echo, direction of diffusion.
  Frames twice = five(kEnhancedMr);
  const std::vector<Vector3d> once = twice.positions_mm;
  twice.positions_mm.insert(twice.positions_mm.end(), once.begin(), once.end());
  EXPECT_NE(refusal(twice).find("has two slices in the same place"), std::string::npos) << refusal(twice);

  Frames lacking = five(kLegacyMr);
  lacking.positions_mm.erase(lacking.positions_mm.begin() + 2);
  lacking.positions_mm.push_back(lacking.positions_mm.back() + 1.5 * normal_of(lacking));
  lacking.positions_mm.push_back(lacking.positions_mm.back() + 1.5 * normal_of(lacking));
  EXPECT_NE(refusal(lacking).find("lacks slices"), std::string::npos) << refusal(lacking);

  Frames without = five(kEnhancedCt);
  without.has_groups = false;
  EXPECT_NE(refusal(without).find("only enhanced multi-frame images are read"), std::string::npos) << refusal(without);

  Frames skewed = five(kEnhancedCt);
  skewed.column = Vector3d(0.5, 0.0, -1.0);
  EXPECT_NE(refusal(skewed).find("not two unit vectors"), std::string::npos) << refusal(skewed);

  Frames flat = five(kEnhancedCt);
  flat.spacing_mm[1] = -0.7;
  EXPECT_NE(refusal(flat).find("pixel spacing of -0.700"), std::string::npos) << refusal(flat);

  Frames nowhere = five(kEnhancedMr);
  nowhere.positions_mm[3][1] = std::nan("");
  EXPECT_NE(refusal(nowhere).find("frame 4"), std::string::npos) << refusal(nowhere);

  Frames more = five(kEnhancedMr);
  more.stated_frames = 6;
  EXPECT_NE(refusal(more).find("is not whole"), std::string::npos) << refusal(more);
}

TEST_F(DicomFrames, ACutFileIsRefusedWhereverItIsCut) {
  for (const bool stated_lengths : {false, true}) {
    Frames frames = five(kEnhancedMr);
    frames.stated_lengths = stated_lengths;
    const std::string whole = file_of(frames);
    for (std::size_t size = 140; size < whole.size(); size += 13) {
      test::write_bytes(folder_ / "frames.dcm", whole.substr(0, size));
      EXPECT_FALSE(read_volume(folder_ / "frames.dcm")) << size << " of " << whole.size();
    }
  }
}

TEST_F(DicomFrames, SeveralFilesInAFolderMustBeGivenAlone) {
  test::write_bytes(folder_ / "a.dcm", file_of(five(kEnhancedMr)));
  test::write_bytes(folder_ / "b.dcm", file_of(five(kEnhancedMr)));
  const auto both = read_volume(folder_.path());
  ASSERT_FALSE(both);
  EXPECT_NE(both.error().message.find("give that file, or another, alone"), std::string::npos) << both.error().message;
  EXPECT_TRUE(read_volume(folder_ / "b.dcm"));
}

} // namespace
} // namespace bregma::casefile
