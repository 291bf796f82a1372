// Images that were read wrongly once (tests/data/faults/volumes): all are one grid of 12 x 12 x 12 voxels of 2 mm.
#include <csignal>
#include <filesystem>
#include <iterator>
#include <string>

#include <sys/resource.h>

#include <gtest/gtest.h>

#include "casefile/volumes/volume.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;
const fs::path kVolumes = BREGMA_SOURCE_DIR "/tests/data/faults/volumes";

TEST(FaultInput, EveryFormatFrameAndUnitGivesTheSameGrid) {
  for (const char *name : {"ras.nrrd", "las.nrrd", "mm.nii", "metres.nii", "microns.nii"}) {
    const auto volume = read_volume(kVolumes / name);
    ASSERT_TRUE(volume) << volume.error().message;
    EXPECT_EQ(volume->size, (std::array{12, 12, 12})) << name;
    EXPECT_TRUE(volume->origin_mm().isApprox(Eigen::Vector3d(10, 40, -20), 1e-6))
        << name << ": " << volume->origin_mm();
    EXPECT_TRUE(volume->axes().isApprox(2.0 * Eigen::Matrix3d::Identity(), 1e-6)) << name;
  }
}

// Its first voxel lies where that of the others does, but its axes point to L and P.
TEST(FaultInput, TheAxesOfAMetaImageAreThoseOfItsMatrix) {
  const auto volume = read_volume(kVolumes / "whole.mha");
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_TRUE(volume->origin_mm().isApprox(Eigen::Vector3d(10.0 - 22.0, 40.0 - 22.0, -20.0), 1e-6));
}

TEST(FaultInput, AFrameThatIsNotStatedIsSaidOrTakenFromTheCaller) {
  EXPECT_FALSE(read_volume(kVolumes / "nospace.nrrd")) << "a reader that tells nobody refuses the file";
  Notes notes;
  ASSERT_TRUE(read_volume(kVolumes / "nospace.nrrd", {}, &notes));
  EXPECT_NE(notes[1].find("its space is not stated: LPS is assumed"), std::string::npos);
  Notes with_space;
  ASSERT_TRUE(read_volume(kVolumes / "nospace.nrrd", {.space = Space::kRas}, &with_space));
  EXPECT_EQ(with_space.size(), notes.size() - 1);
}

TEST(FaultInput, AnImageThatIsNotWholeIsRefused) {
  const auto cut = read_volume(kVolumes / "cut.mha");
  ASSERT_FALSE(cut);
  EXPECT_NE(cut.error().message.find("is not whole: it holds "), std::string::npos) << cut.error().message;
  // Every format, cut at any place, with every way of packing.
  const test::TemporaryFolder folder;
  const auto whole = read_volume(kVolumes / "ras.nrrd");
  ASSERT_TRUE(whole);
  for (const char *name : {"v.nii", "v.nii.gz", "v.nrrd", "v.mha"}) {
    ASSERT_TRUE(write_volume(folder / name, *whole));
    const std::string bytes = test::read_bytes(folder / name);
    for (std::size_t size = 0; size < bytes.size(); size += 1 + bytes.size() / 200) {
      test::write_bytes(folder / (std::string("cut_") + name), bytes.substr(0, size));
      Notes notes;
      EXPECT_FALSE(read_volume(folder / (std::string("cut_") + name), {}, &notes)) << name << ", " << size << " bytes";
    }
  }
}

// A header that states fewer slices than there are is that of another image; a few bytes more are said.
TEST(FaultInput, WhatLiesBehindTheVoxelsIsSaidOrRefused) {
  const test::TemporaryFolder folder;
  const std::string slice(288, '\0'); // 12 x 12 shorts
  const std::string nrrd = "NRRD0004\ntype: short\ndimension: 3\nspace: RAS\nsizes: 12 12 3\nendian: little\n"
                           "space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (0,0,0)\nencoding: raw\n\n";
  const std::string meta = "ObjectType = Image\nNDims = 3\nBinaryData = True\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n"
                           "Offset = 0 0 0\nElementSpacing = 2 2 2\nDimSize = 12 12 3\nElementType = MET_SHORT\n"
                           "ElementDataFile = LOCAL\n";
  for (const auto &[name, header] : {std::pair("v.nrrd", nrrd), {"v.mha", meta}}) {
    test::write_bytes(folder / name, header + slice + slice + slice + "tail");
    Notes notes;
    ASSERT_TRUE(read_volume(folder / name, {}, &notes));
    ASSERT_EQ(notes.size(), 1U);
    EXPECT_NE(notes[0].find("4 bytes behind its voxels are not read"), std::string::npos) << notes[0];
    for (const auto &[tail, said] : {std::pair(slice, "holds 1 slices more than its header states"),
                                     {slice + "tail", "holds 292 bytes (a slice has 288) more than its header"}}) {
      test::write_bytes(folder / name, header + slice + slice + slice + tail);
      const auto more = read_volume(folder / name, {}, &notes);
      ASSERT_FALSE(more);
      EXPECT_NE(more.error().message.find(said), std::string::npos) << more.error().message;
    }
  }
}

TEST(FaultInput, AMetaImageThatContradictsItselfIsRefused) {
  const test::TemporaryFolder folder;
  const std::string meta = "ObjectType = Image\nNDims = 3\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 1 2 3\n"
                           "ElementSpacing = 2 2 2\nDimSize = 2 2 2\nElementType = MET_UCHAR\n";
  for (const auto &[more, said] : {std::pair("", ""),
                                   {"Offset = 1 2 3\n", ""},
                                   {"HeaderSize = 0\n", ""},
                                   {"ObjectType = Tube\n", "ObjectType = \"Tube\": is stated before as \"Image\""},
                                   {"Offset = 0 0 0\n", "Offset = \"0 0 0\": is stated before as \"1 2 3\""},
                                   {"Position = 1 2 3\n", ""},
                                   {"Position = 0 0 0\n", "Offset = \"0 0 0\": is stated before as \"1 2 3\""},
                                   {"Rotation = 1 0 0 0 -1 0 0 0 1\n", "TransformMatrix = \"1 0 0 0 -1 0 0 0 1\": is"},
                                   {"HeaderSize = 3\n", "HeaderSize = \"3\": must be 0 where the voxels follow"},
                                   {"BinaryDataByteOrderMSB = False\nElementByteOrderMSB = False\n", ""},
                                   {"BinaryDataByteOrderMSB = False\nElementByteOrderMSB = True\n",
                                    "BinaryDataByteOrderMSB = \"True\": is stated before as \"False\""},
                                   {"ElementToIntensityFunctionSlope = 1\n", ""},
                                   {"ElementToIntensityFunctionSlope = 2\n", "a scale of the values is not read"}}) {
    test::write_bytes(folder / "v.mha", meta + more + "ElementDataFile = LOCAL\n12345678");
    const auto volume = read_volume(folder / "v.mha");
    EXPECT_EQ(volume.has_value(), *said == '\0') << more;
    EXPECT_TRUE(volume || volume.error().message.find(said) != std::string::npos) << volume.error().message;
  }
}

// Programs disagree about what they mean: a mirror image, a larger one, or nothing.
TEST(FaultInput, AMetaImageWithASpacingOrAxesOfAnotherKindIsRefused) {
  const test::TemporaryFolder folder;
  for (const auto &[matrix, spacing, said] :
       {std::tuple("1 0 0 0 1 0 0 0 1", "2 2 2", ""),
        {"1 0 0 0 1 0 0 0 1", "-2 2 2", "ElementSpacing = \"-2 2 2\": must be above 0"},
        {"1 0 0 0 1 0 0 0 1", "2 0 2", "ElementSpacing = \"2 0 2\": must be above 0"},
        {"2 0 0 0 2 0 0 0 2", "2 2 2", "its axes must have the length 1"},
        {"1 0 0 0 0 0 0 0 1", "2 2 2", "its axes must have the length 1"},
        {"0 1 0 -1 0 0 0 0 1", "2 2 2", ""}}) {
    test::write_bytes(folder / "v.mha",
                      "ObjectType = Image\nNDims = 3\nTransformMatrix = " + std::string(matrix) +
                          "\nOffset = 1 2 3\nElementSpacing = " + spacing +
                          "\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n12345678");
    const auto volume = read_volume(folder / "v.mha");
    EXPECT_EQ(volume.has_value(), *said == '\0') << matrix << ", " << spacing;
    EXPECT_TRUE(volume || volume.error().message.find(said) != std::string::npos) << volume.error().message;
  }
}

// With another size, or none, ITK reads a part of the voxels, and the rest is what the memory held.
TEST(FaultInput, APackedMetaImageStatesItsSize) {
  const test::TemporaryFolder folder;
  const auto whole = read_volume(kVolumes / "ras.nrrd");
  ASSERT_TRUE(whole && write_volume(folder / "v.mha", *whole));
  const std::string bytes = test::read_bytes(folder / "v.mha");
  const std::size_t begin = bytes.find("CompressedDataSize = ");
  ASSERT_NE(begin, std::string::npos);
  const std::size_t end = bytes.find('\n', begin) + 1;
  for (const char *line :
       {"", "CompressedDataSize = 10\n", "CompressedDataSize = 99999999\n", "CompressedDataSize = x\n"}) {
    test::write_bytes(folder / "v.mha", std::string(bytes).replace(begin, end - begin, line));
    const auto volume = read_volume(folder / "v.mha");
    ASSERT_FALSE(volume) << line;
    EXPECT_NE(volume.error().message.find("the compressed voxels have "), std::string::npos) << volume.error().message;
  }
}

TEST(FaultInput, AnNrrdOfTextHoldsNumbersAndAsManyAsItStates) {
  const test::TemporaryFolder folder;
  const std::string header = "NRRD0004\ntype: short\ndimension: 3\nspace: RAS\nsizes: 2 2 2\n"
                             "space directions: (2,0,0) (0,2,0) (0,0,2)\nspace origin: (0,0,0)\nencoding: ascii\n\n";
  for (const auto &[voxels, said] :
       {std::pair("1 2 3 4 5 6 7 8\n", ""),
        {"1 2 3 4 5 6 7 8", "note: the last line does not end: digits of its last number may be missing"},
        {"1 2 3 4 5 6 7\n", "is not whole: it holds 7 numbers, its header asks for 8"},
        {"1 2 3 4 5 6 7 8 9\n", "holds 9 numbers, its header asks for 8"},
        {"1 2 3 4 5x 6 7 8\n", "\"5x\" among its voxels is no number"}}) {
    test::write_bytes(folder / "v.nrrd", header + voxels);
    Notes notes;
    const auto volume = read_volume(folder / "v.nrrd", {}, &notes);
    std::string text = volume ? "" : volume.error().message;
    for (const std::string &note : notes) {
      text += "note: " + note.substr(note.find("v.nrrd: ") + 8);
    }
    EXPECT_NE(text.find(said), std::string::npos) << text;
    EXPECT_EQ(text.empty(), *said == '\0') << text;
  }
}

TEST(FaultInput, AnNrrdWhoseDirectionsAreInNoSpaceOrStatedTwiceIsRefused) {
  const test::TemporaryFolder folder;
  for (const auto &[more, said] :
       {std::pair("space: RAS\n", ""),
        {"space dimension: 3\n", ""},
        {"", "space directions = \"(2,0,0) (0,2,0) (0,0,2)\": are in no space"},
        {"space: RAS\nspacings: 2 2 2\n", "spacings = \"2 2 2\": is stated beside space directions"},
        {"space: RAS\nunits: \"cm\" \"cm\" \"cm\"\n", "units = \"\"cm\" \"cm\" \"cm\"\": is stated beside"}}) {
    test::write_bytes(folder / "v.nrrd", "NRRD0004\ntype: uint8\ndimension: 3\n" + std::string(more) +
                                             "sizes: 2 2 2\nspace directions: (2,0,0) (0,2,0) (0,0,2)\n"
                                             "space origin: (0,0,0)\nencoding: raw\n\n12345678");
    const auto volume = read_volume(folder / "v.nrrd", {.space = Space::kRas});
    EXPECT_EQ(volume.has_value(), *said == '\0') << more;
    EXPECT_TRUE(volume || volume.error().message.find(said) != std::string::npos) << volume.error().message;
  }
}

// ITK reports success where a NIfTI or MetaImage did not fit on the disk.
TEST(FaultInput, AnImageThatCouldNotBeWrittenWholeIsAnErrorAndKeepsTheEarlierOne) {
  const test::TemporaryFolder folder;
  const auto whole = read_volume(kVolumes / "ras.nrrd");
  ASSERT_TRUE(whole);
  Volume noise = *whole; // which cannot be compressed
  unsigned state = 1;
  for (float &voxel : noise.voxels) {
    state = state * 1664525U + 1013904223U;
    voxel = static_cast<float>(state >> 8U);
  }
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_FSIZE, &before), 0);
  for (const char *name : {"v.nii", "v.nii.gz", "v.nrrd", "v.mha"}) {
    ASSERT_TRUE(write_volume(folder / name, *whole));
    const std::string kept = test::read_bytes(folder / name);
    auto *const handler = std::signal(SIGXFSZ, SIG_IGN); // else a write beyond the limit ends the process
    const rlimit limit{3000, before.rlim_max};
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
    const auto written = write_volume(folder / name, noise);
    ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &before), 0);
    std::signal(SIGXFSZ, handler);
    EXPECT_FALSE(written) << name;
    EXPECT_EQ(test::read_bytes(folder / name), kept) << name;
  }
  const auto files = std::distance(std::filesystem::directory_iterator(folder.path()), {});
  EXPECT_EQ(files, 4) << "something was left behind";
}

TEST(FaultInput, AWrongBitInPackedVoxelsIsNoticed) {
  const test::TemporaryFolder folder;
  const auto whole = read_volume(kVolumes / "ras.nrrd");
  ASSERT_TRUE(whole);
  for (const char *name : {"v.nii.gz", "v.nrrd", "v.mha"}) { // written compressed
    ASSERT_TRUE(write_volume(folder / name, *whole));
    std::string bytes = test::read_bytes(folder / name);
    bytes[bytes.size() - bytes.size() / 4] ^= 0x10;
    test::write_bytes(folder / name, bytes);
    EXPECT_FALSE(read_volume(folder / name)) << name;
  }
}

} // namespace
} // namespace bregma::casefile
