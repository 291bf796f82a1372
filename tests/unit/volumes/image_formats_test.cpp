// Formats and fields that the images of tests/data do not have. The files are written here from the formats'
// definitions, so that reader and writer cannot have the same error.
#include <algorithm>
#include <cstring>
#include <map>
#include <sstream>

#include <gtest/gtest.h>
#include <zlib.h>

#include "casefile/volumes/volume.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

constexpr std::array<int, 3> kSize{4, 6, 8};
constexpr int kCount = 4 * 6 * 8;

// Stored value of the i-th voxel.
int stored(int i) { return i % 120; }

template <class T> std::string number(T value, bool big_endian = false) {
  std::string out(sizeof value, '\0');
  std::memcpy(out.data(), &value, sizeof value);
  if (big_endian) {
    std::reverse(out.begin(), out.end());
  }
  return out;
}

template <class T> std::string voxels(bool big_endian = false) {
  std::string out;
  for (int i = 0; i < kCount; ++i) {
    out += number(static_cast<T>(stored(i)), big_endian);
  }
  return out;
}

std::string gzipped(const std::string &bytes) {
  const TemporaryFolder folder;
  gzFile file = gzopen((folder / "a.gz").c_str(), "wb");
  gzwrite(file, bytes.data(), static_cast<unsigned>(bytes.size()));
  gzclose(file);
  return test::read_bytes(folder / "a.gz");
}

// Voxels of 1 x 2 x 3 mm; axes towards L, I and A as FreeSurfer's; the centre at (1, 2, 3).
std::string mgh(std::int32_t type, const std::string &data, std::int32_t frames = 1, std::int16_t good_ras = 1) {
  std::string out = number<std::int32_t>(1, true);
  for (const int size : kSize) {
    out += number<std::int32_t>(size, true);
  }
  out += number(frames, true) + number(type, true) + number<std::int32_t>(0, true) + number(good_ras, true);
  for (const float value :
       {1.0F, 2.0F, 3.0F, -1.0F, 0.0F, 0.0F, 0.0F, 0.0F, -1.0F, 0.0F, 1.0F, 0.0F, 1.0F, 2.0F, 3.0F}) {
    out += number(value, true);
  }
  out.resize(284, '\0');
  return out + data;
}

std::string message_of(const fs::path &file, Notes *notes = nullptr) {
  const auto read = read_volume(file, {}, notes);
  return read ? "was read" : read.error().message;
}

// Its place from FreeSurfer's definition: the centre minus half the size along the axes: (1, 2, 3) - (-2, 12, -6).
void expect_mgh(const fs::path &file) {
  const auto volume = read_volume(file);
  ASSERT_TRUE(volume) << volume.error().message;
  // In RAS order: i along the first axis backwards, j along the third, k along the second backwards.
  EXPECT_EQ(volume->size, (std::array{4, 8, 6})) << file;
  EXPECT_TRUE(volume->point_mm({3, 0, 5}).isApprox(Eigen::Vector3d(3, -10, 9))) << file << volume->point_mm({3, 0, 5});
  EXPECT_TRUE(volume->spacing_mm().isApprox(Eigen::Vector3d(1, 3, 2))) << file;
  for (int k = 0; k < 8; ++k) {
    for (int j = 0; j < 6; ++j) {
      for (int i = 0; i < 4; ++i) {
        ASSERT_EQ(volume->at(3 - i, k, 5 - j), static_cast<float>(stored(i + 4 * (j + 6 * k)))) << file;
      }
    }
  }
}

TEST(MghImage, EveryTypeIsReadWhereItsHeaderSays) {
  const TemporaryFolder folder;
  const std::map<std::int32_t, std::string> types{{0, voxels<std::uint8_t>()},
                                                  {1, voxels<std::int32_t>(true)},
                                                  {3, voxels<float>(true)},
                                                  {4, voxels<std::int16_t>(true)},
                                                  {10, voxels<std::uint16_t>(true)}};
  for (const auto &[type, data] : types) {
    const std::string bytes = mgh(type, data);
    for (const char *name : {"a.mgh", "A.MGH", "without_extension"}) {
      test::write_bytes(folder / name, bytes);
      expect_mgh(folder / name);
    }
    for (const char *name : {"a.mgz", "A.MGZ", "a.mgh.gz"}) {
      test::write_bytes(folder / name, gzipped(bytes + std::string(20, '\1'))); // times of the sequence behind
      expect_mgh(folder / name);
    }
  }
}

TEST(MghImage, WhatIsNotWholeOrNotStatedIsRefused) {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string &bytes, const std::string &reason) {
    test::write_bytes(folder / "a.mgh", bytes);
    EXPECT_NE(message_of(folder / "a.mgh").find(reason), std::string::npos) << message_of(folder / "a.mgh");
  };
  refused(mgh(0, voxels<std::uint8_t>(), 1, 0), "states no orientation (goodRASFlag = 0)");
  refused(mgh(0, voxels<std::uint8_t>() + voxels<std::uint8_t>(), 2), "has more than three dimensions: 4 x 6 x 8 x 2");
  refused(mgh(2, voxels<std::int64_t>()), "type = 2: is not read");
  refused(mgh(3, voxels<std::int16_t>()), "is not whole: it holds 384 bytes of voxels, its header asks for 768");
}

// NIfTI-1 (bytes 348) or NIfTI-2 (540) with a sform of the same grid as the MGH files above; int16 with slope 2 and
// intercept -5.
std::string nifti_header(int version, const std::string &magic, double start, bool big_endian) {
  const bool first = version == 1;
  std::string out(first ? 348 : 540, '\0');
  const auto put = [&](std::size_t at, const std::string &bytes) { out.replace(at, bytes.size(), bytes); };
  const auto code = [&](std::size_t at, int value) {
    put(at, first ? number(static_cast<std::int16_t>(value), big_endian) : number<std::int32_t>(value, big_endian));
  };
  const auto real = [&](std::size_t at, double value) {
    put(at, first ? number(static_cast<float>(value), big_endian) : number(value, big_endian));
  };
  const std::size_t real_bytes = first ? 4 : 8;
  put(0, number<std::int32_t>(first ? 348 : 540, big_endian));
  put(first ? 344 : 4, magic);
  const std::int64_t dimensions[] = {3, 4, 6, 8, 1, 1, 1, 1};
  for (std::size_t i = 0; i < 8; ++i) {
    put((first ? 40 : 16) + (first ? 2 : 8) * i,
        first ? number(static_cast<std::int16_t>(dimensions[i]), big_endian) : number(dimensions[i], big_endian));
  }
  put(first ? 70 : 12, number<std::int16_t>(4, big_endian));
  put(first ? 72 : 14, number<std::int16_t>(16, big_endian));
  for (std::size_t i = 0; i < 4; ++i) {
    real((first ? 76 : 104) + real_bytes * i, static_cast<double>(i));
  }
  if (first) {
    real(108, start);
    out[123] = 2;
  } else {
    put(168, number(static_cast<std::int64_t>(start), big_endian));
    put(500, number<std::int32_t>(2, big_endian));
  }
  real(first ? 112 : 176, 2.0);
  real(first ? 116 : 184, -5.0);
  code(first ? 254 : 348, 1);
  const double rows[] = {-1, 0, 0, 3, 0, 0, 3, -10, 0, -2, 0, 9};
  for (std::size_t i = 0; i < 12; ++i) {
    real((first ? 280 : 400) + real_bytes * i, rows[i]);
  }
  return out;
}

void expect_nifti(const fs::path &file) {
  const auto volume = read_volume(file);
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_EQ(volume->size, (std::array{4, 8, 6})) << file;
  EXPECT_TRUE(volume->point_mm({3, 0, 5}).isApprox(Eigen::Vector3d(3, -10, 9))) << file << volume->point_mm({3, 0, 5});
  EXPECT_EQ(volume->at(3, 0, 5), -5.0F);
  EXPECT_EQ(volume->at(3 - 1, 3, 5 - 2), static_cast<float>(2 * stored(1 + 4 * (2 + 6 * 3)) - 5)) << file;
}

const std::string kSingle1("n+1\0", 4), kPair1("ni1\0", 4), kSingle2("n+2\0\r\n\032\n", 8),
    kPair2("ni2\0\r\n\032\n", 8);

TEST(NiftiImage, BothVersionsAreReadInOneFileAndAsAPair) {
  for (const bool big_endian : {false, true}) {
    const std::string data = voxels<std::int16_t>(big_endian);
    for (const int version : {1, 2}) {
      const TemporaryFolder folder;
      const bool first = version == 1;
      const std::string single = nifti_header(version, first ? kSingle1 : kSingle2, first ? 352 : 544, big_endian);
      test::write_bytes(folder / "a.nii", single + std::string(4, '\0') + data);
      test::write_bytes(folder / "A.NII.GZ", gzipped(single + std::string(4, '\0') + data));
      expect_nifti(folder / "a.nii");
      expect_nifti(folder / "A.NII.GZ");
      const std::string pair = nifti_header(version, first ? kPair1 : kPair2, 0, big_endian);
      for (const auto &[header, image] : {std::pair("b.hdr", "b.img"), {"C.HDR", "C.IMG"}}) {
        test::write_bytes(folder / header, pair);
        test::write_bytes(folder / image, data);
        expect_nifti(folder / header);
        expect_nifti(folder / image);
      }
      test::write_bytes(folder / "d.hdr.gz", gzipped(pair));
      test::write_bytes(folder / "d.img.gz", gzipped(data));
      expect_nifti(folder / "d.hdr.gz");
      expect_nifti(folder / "d.img.gz");
    }
  }
}

TEST(NiftiImage, APairThatIsNotWholeAndAnalyzeAreRefusedByName) {
  const TemporaryFolder folder;
  const std::string pair = nifti_header(1, kPair1, 0, false);
  test::write_bytes(folder / "a.hdr", pair);
  EXPECT_NE(message_of(folder / "a.hdr").find("its voxels (.img) must be beside it"), std::string::npos);
  test::write_bytes(folder / "b.img", voxels<std::int16_t>());
  EXPECT_NE(message_of(folder / "b.img").find("its header (.hdr) must be beside it"), std::string::npos);
  test::write_bytes(folder / "a.img", voxels<std::int16_t>().substr(2));
  EXPECT_NE(message_of(folder / "a.hdr").find("a.img: is not whole: it holds 382 bytes of voxels"), std::string::npos);
  std::string analyze = pair;
  analyze.replace(344, 4, 4, '\0');
  test::write_bytes(folder / "c.hdr", analyze);
  test::write_bytes(folder / "c.img", voxels<std::int16_t>());
  for (const char *name : {"c.hdr", "c.img"}) {
    EXPECT_NE(message_of(folder / name).find("is an Analyze 7.5 header"), std::string::npos)
        << message_of(folder / name);
  }
}

TEST(NiftiImage, ATypeThatIsNotANumberOrContradictsItsSizeIsRefused) {
  const TemporaryFolder folder;
  for (const auto &[type, bits, reason] : {std::tuple(128, 24, "datatype = 128: is not read"),
                                           {32, 64, "datatype = 32: is not read"},
                                           {4, 8, "bitpix = 8: contradicts datatype 4"}}) {
    std::string header = nifti_header(1, kSingle1, 352, false);
    header.replace(70, 4, number(static_cast<std::int16_t>(type)) + number(static_cast<std::int16_t>(bits)));
    test::write_bytes(folder / "a.nii", header + std::string(4000, '\0'));
    EXPECT_NE(message_of(folder / "a.nii").find(reason), std::string::npos) << message_of(folder / "a.nii");
  }
}

// A file cut at any place is refused, whichever format.
TEST(FaultInput, NoImageOfTheOtherFormatsIsReadInPart) {
  const TemporaryFolder folder;
  const std::string nifti2 = nifti_header(2, kSingle2, 544, false) + std::string(4, '\0') + voxels<std::int16_t>();
  const std::map<std::string, std::string> files{{"a.mgh", mgh(4, voxels<std::int16_t>(true))},
                                                 {"a.mgz", gzipped(mgh(4, voxels<std::int16_t>(true)))},
                                                 {"n2.nii", nifti2},
                                                 {"n2.nii.gz", gzipped(nifti2)}};
  for (const auto &[name, bytes] : files) {
    for (std::size_t size = 0; size < bytes.size(); size += 1 + bytes.size() / 200) {
      test::write_bytes(folder / name, bytes.substr(0, size));
      EXPECT_NE(message_of(folder / name), "was read") << name << ", " << size << " bytes";
    }
    if (name.ends_with("z")) {
      std::string wrong = bytes;
      wrong[bytes.size() - bytes.size() / 4] ^= 0x10;
      test::write_bytes(folder / name, wrong);
      EXPECT_NE(message_of(folder / name), "was read") << name;
    }
  }
}

std::string meta(const std::string &tags, const std::string &dimensions = "4 6 8") {
  return "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nTransformMatrix = 1 0 0 0 "
         "1 0 "
         "0 0 1\nOffset = -1 -2 3\nElementSpacing = 1 2 3\nDimSize = " +
         dimensions + "\nElementType = MET_SHORT\n" + tags;
}

// The first voxel of meta() in RAS: LPS (-1, -2, 3), whose axes lead to L and P.
Eigen::Vector3d first_voxel(const Volume &volume) {
  return volume.point_mm({volume.size[0] - 1.0, volume.size[1] - 1.0, 0.0});
}

TEST(MetaImage, ItsUnitIsUsed) {
  const TemporaryFolder folder;
  for (const auto &[unit, scale] : {std::pair("cm", 10.0), {"um", 0.001}, {"mm", 1.0}, {"?", 1.0}, {"M", 1000.0}}) {
    test::write_bytes(folder / "a.mha", meta("DistanceUnits = " + std::string(unit) + "\nElementDataFile = LOCAL\n") +
                                            voxels<std::int16_t>());
    Notes notes;
    const auto volume = read_volume(folder / "a.mha", {}, &notes);
    if (scale == 1000.0) { // voxels of 3 m
      EXPECT_FALSE(volume);
      continue;
    }
    ASSERT_TRUE(volume) << volume.error().message;
    EXPECT_TRUE(first_voxel(*volume).isApprox(scale * Eigen::Vector3d(1, 2, 3))) << unit << first_voxel(*volume);
    EXPECT_TRUE(volume->spacing_mm().isApprox(scale * Eigen::Vector3d(1, 2, 3))) << unit;
    EXPECT_EQ(notes.size(), scale == 1.0 ? 0U : 1U) << unit;
  }
  test::write_bytes(folder / "a.mha", meta("DistanceUnits = ell\nElementDataFile = LOCAL\n") + voxels<std::int16_t>());
  EXPECT_NE(message_of(folder / "a.mha").find("DistanceUnits = \"ell\": must be mm, cm, m or um"), std::string::npos);
}

TEST(MetaImage, FourDimensionsAreRefusedByName) {
  const TemporaryFolder folder;
  std::string four = meta("ElementDataFile = LOCAL\n", "4 6 8 2");
  four.replace(four.find("NDims = 3"), 9, "NDims = 4");
  test::write_bytes(folder / "a.mha", four + voxels<std::int16_t>() + voxels<std::int16_t>());
  EXPECT_NE(message_of(folder / "a.mha").find("NDims = \"4\": a volume has three dimensions"), std::string::npos)
      << message_of(folder / "a.mha");
}

TEST(MetaImage, VoxelsBehindAnotherHeaderAreRead) {
  const TemporaryFolder folder;
  test::write_bytes(folder / "a.raw", std::string(100, 'x') + voxels<std::int16_t>());
  for (const char *size : {"100", "-1"}) {
    test::write_bytes(folder / "a.mhd", meta("HeaderSize = " + std::string(size) + "\nElementDataFile = a.raw\n"));
    const auto volume = read_volume(folder / "a.mhd");
    ASSERT_TRUE(volume) << volume.error().message;
    EXPECT_EQ(volume->at(3 - 1, 5 - 2, 3), static_cast<float>(stored(1 + 4 * (2 + 6 * 3)))) << size;
  }
  test::write_bytes(folder / "a.mhd", meta("HeaderSize = 101\nElementDataFile = a.raw\n"));
  EXPECT_NE(message_of(folder / "a.mhd").find("a.raw: is not whole"), std::string::npos);
}

std::string nrrd(const std::string &fields) {
  return "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 6 8\nendian: little\n" + fields + "\n\n";
}
// The space comes first: its fields depend on it.
std::string placed(const std::string &space, const std::string &more = "") {
  return "space: " + space + "\n" + more +
         "space directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (1,2,3)\nencoding: raw";
}

TEST(NrrdImage, EverySpaceOfAPatientIsReadByItsNames) {
  const TemporaryFolder folder;
  for (const auto &[names, x, y] :
       {std::tuple(std::array{"right-anterior-superior", "RAS", "Right-Anterior-Superior"}, 1.0, 1.0),
        {std::array{"left-anterior-superior", "LAS", "las"}, -1.0, 1.0},
        {std::array{"left-posterior-superior", "LPS", "lps"}, -1.0, -1.0}}) {
    for (const char *name : names) {
      test::write_bytes(folder / "a.nrrd", nrrd(placed(name)) + voxels<std::int16_t>());
      const auto volume = read_volume(folder / "a.nrrd");
      ASSERT_TRUE(volume) << volume.error().message;
      const Eigen::Vector3d first = volume->point_mm({x < 0 ? 3.0 : 0.0, y < 0 ? 5.0 : 0.0, 0.0});
      EXPECT_TRUE(first.isApprox(Eigen::Vector3d(x, 2.0 * y, 3.0))) << name << first;
      EXPECT_EQ(volume->at(x < 0 ? 3 - 1 : 1, y < 0 ? 5 - 2 : 2, 3), static_cast<float>(stored(1 + 4 * (2 + 6 * 3))));
    }
  }
  for (const auto &[name, reason] : {std::pair("right-anterior-superior-time", "has a time"),
                                     {"LPST", "has a time"},
                                     {"3D-left-handed", "is not a frame of a patient"},
                                     {"left-inferior-superior", "is not a frame of a patient"}}) {
    test::write_bytes(folder / "a.nrrd", nrrd(placed(name)) + voxels<std::int16_t>());
    EXPECT_NE(message_of(folder / "a.nrrd").find(reason), std::string::npos) << message_of(folder / "a.nrrd");
  }
  test::write_bytes(folder / "a.nrrd", nrrd(placed("scanner-xyz")) + voxels<std::int16_t>());
  EXPECT_NE(message_of(folder / "a.nrrd").find("\"scanner-xyz\", does not state the patient's sides"),
            std::string::npos);
}

TEST(NrrdImage, ItsUnitsAreUsed) {
  const TemporaryFolder folder;
  for (const auto &[fields, scale] : {std::pair(placed("RAS", "space units: \"cm\" \"cm\" \"cm\"\n"), 10.0),
                                      {placed("RAS", "space units: \"um\" \"um\" \"um\"\n"), 0.001},
                                      {placed("RAS", "space units: \"\" \"\" \"\"\n"), 1.0},
                                      {"spacings: 1 2 3\nencoding: raw\nunits: \"cm\" \"cm\" \"cm\"", 10.0},
                                      {"spacings: 1 2 3\nencoding: raw", 1.0}}) {
    test::write_bytes(folder / "a.nrrd", nrrd(fields) + voxels<std::int16_t>());
    Notes notes;
    const auto volume = read_volume(folder / "a.nrrd", {.space = Space::kRas}, &notes);
    ASSERT_TRUE(volume) << volume.error().message;
    EXPECT_TRUE(volume->spacing_mm().isApprox(scale * Eigen::Vector3d(1, 2, 3))) << fields;
    const Eigen::Vector3d at = fields.starts_with("space:") ? Eigen::Vector3d(1, 2, 3) : Eigen::Vector3d(0, 0, 0);
    EXPECT_TRUE(volume->origin_mm().isApprox(scale * at)) << fields << volume->origin_mm();
  }
  for (const char *units : {"mm mm cm", "mm mm s", "ell ell ell"}) {
    test::write_bytes(folder / "a.nrrd",
                      nrrd(placed("RAS", "space units: " + std::string(units) + "\n")) + voxels<std::int16_t>());
    EXPECT_NE(message_of(folder / "a.nrrd").find("must be one of mm, cm, m and um"), std::string::npos) << units;
  }
}

TEST(NrrdImage, LinesAndBytesBeforeTheVoxelsAreSkipped) {
  const TemporaryFolder folder;
  const std::string data = voxels<std::int16_t>();
  const std::string before = "line one\nline two\n";
  const std::string detached =
      "NRRD0004\ntype: short\ndimension: 3\nsizes: 4 6 8\nendian: little\nspace: RAS\n"
      "space directions: (1,0,0) (0,2,0) (0,0,3)\nspace origin: (1,2,3)\ndata file: a.raw\nencoding: ";
  for (const auto &[fields, bytes] : {std::pair(std::string("raw\nline skip: 2\n"), before + data),
                                      {"raw\nline skip: 1\nbyte skip: 9\n", before + data},
                                      {"raw\nbyte skip: 18\n", before + data},
                                      {"raw\nbyte skip: -1\n", before + data},
                                      {"gzip\nbyte skip: 18\n", gzipped(before + data)}}) {
    test::write_bytes(folder / "a.raw", bytes);
    test::write_bytes(folder / "a.nhdr", detached + fields);
    const auto volume = read_volume(folder / "a.nhdr");
    ASSERT_TRUE(volume) << fields << volume.error().message;
    EXPECT_EQ(volume->at(1, 2, 3), static_cast<float>(stored(1 + 4 * (2 + 6 * 3)))) << fields;
    test::write_bytes(folder / "a.raw", bytes.substr(0, bytes.size() - 1));
    if (fields != "raw\nbyte skip: -1\n") { // which states no first byte
      EXPECT_NE(message_of(folder / "a.nhdr").find("a.raw: is not whole"), std::string::npos) << fields;
    }
  }
  test::write_bytes(folder / "a.raw", before);
  test::write_bytes(folder / "a.nhdr", detached + "raw\nline skip: 3\n");
  EXPECT_NE(message_of(folder / "a.nhdr").find("the file has 2 lines before its data"), std::string::npos);
}

TEST(NrrdImage, WhatWouldBeLeftOutIsRefusedByName) {
  const TemporaryFolder folder;
  const std::string four =
      "NRRD0004\ntype: short\ndimension: 4\nsizes: 2 4 6 8\nendian: little\nencoding: raw\nspace: RAS\n"
      "space directions: none (1,0,0) (0,2,0) (0,0,3)\nspace origin: (1,2,3)\n\n";
  test::write_bytes(folder / "a.nrrd", four + voxels<std::int16_t>() + voxels<std::int16_t>());
  EXPECT_NE(message_of(folder / "a.nrrd").find("has more than three dimensions: 2 x 4 x 6 x 8"), std::string::npos);
  test::write_bytes(folder / "a.nrrd",
                    nrrd("spacings: 1 2 3\naxis mins: 5 6 7\nencoding: raw\nspace: RAS") + voxels<std::int16_t>());
  Notes notes;
  EXPECT_NE(message_of(folder / "a.nrrd", &notes).find("axis mins = \"5 6 7\": is not read"), std::string::npos);
  for (const std::string twice : {"space: LPS", "space origin: (0,0,0)", "byteskip: 4"}) {
    test::write_bytes(folder / "a.nrrd", nrrd("encoding: raw\nspace: RAS\nspace directions: (1,0,0) (0,2,0) (0,0,3)\n"
                                              "space origin: (1,2,3)\nbyte skip: 0\n" +
                                              twice) +
                                             voxels<std::int16_t>());
    EXPECT_NE(message_of(folder / "a.nrrd", &notes).find("is stated before as"), std::string::npos) << twice;
  }
}

} // namespace
} // namespace bregma::casefile
