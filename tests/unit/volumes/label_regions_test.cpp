// Names and colours of the regions of a label image, as displays draw them.
#include "casefile/volumes/label_regions.hpp"

#include <cstdint>
#include <set>

#include <gtest/gtest.h>

#include "casefile/volumes/crop.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

using test::TemporaryFolder;
using test::write_bytes;

LabelVolume labels_of(std::vector<std::int16_t> voxels) {
  LabelVolume out{{{static_cast<int>(voxels.size()), 1, 1}, Eigen::Matrix4d::Identity()}, std::move(voxels)};
  out.T_image_index.topRightCorner<3, 1>() << 10.0, 20.0, 30.0;
  return out;
}

TEST(LabelRegions, AreThoseOfTheImage) {
  const auto regions =
      regions_in(labels_of({0, 3, 3, -1, 7, 0, 3}), {{3, "Cuneus_L"}, {4, "Cuneus_R"}}, {{7, 0x102030}});
  ASSERT_EQ(regions.size(), 2U);
  EXPECT_EQ(regions.at(3).name, "Cuneus_L");
  EXPECT_EQ(regions.at(7), (LabelRegion{"region 7", 0x102030}));
}

TEST(LabelRegions, NeighboursHaveOtherColours) {
  std::vector<std::int16_t> voxels;
  for (std::int16_t i = 1; i <= 200; ++i) {
    voxels.push_back(i);
  }
  const auto regions = regions_in(labels_of(voxels), {}, {});
  ASSERT_EQ(regions.size(), 200U);
  std::set<std::uint32_t> colours;
  for (const auto &[number, region] : regions) {
    colours.insert(region.colour);
    const auto next = regions.find(number + 1);
    if (next == regions.end()) {
      continue;
    }
    int difference = 0;
    for (const unsigned shift : {0U, 8U, 16U}) {
      difference += std::abs(static_cast<int>(region.colour >> shift & 255U) -
                             static_cast<int>(next->second.colour >> shift & 255U));
    }
    EXPECT_GT(difference, 120) << number;
  }
  EXPECT_GT(colours.size(), 195U);
}

TEST(LabelRegions, ColoursOfOtherProgramsAreRead) {
  const TemporaryFolder scratch;
  const LabelColours wanted{{23, 0xFF8000}, {1024, 0x3C14DC}};
  for (const std::string table :
       {"# FreeSurfer\n23  Right-Accumbens-area   255 128 0 0\n1024    ctx-lh-precentral   60  20 220   0\n",
        "   23   255  128    0        1  1  1    \"Right, Accumbens\"\n 1024 60 20 220 1 1 1 \"ctx\"\r\n"}) {
    write_bytes(scratch / "n.txt", table);
    EXPECT_EQ(read_label_colours(scratch / "n.txt"), wanted) << table;
  }
  for (const char *without : {"1 Precentral_L 2001\n", "23,\"Right Accumbens Area\"\n", "5 256 0 0 1 1 1 \"A\"\n",
                              "5 A 1 2 3\n", "<a><index>1</index><name>b</name></a>"}) {
    write_bytes(scratch / "n.txt", without);
    EXPECT_TRUE(read_label_colours(scratch / "n.txt").empty()) << without;
  }
  EXPECT_TRUE(read_label_colours(scratch / "missing.txt").empty());
}

TEST(LabelRegions, AreWrittenAndReadBack) {
  const TemporaryFolder scratch;
  const LabelRegions regions{
      {3, {"Cerebellar Vermal Lobules I-V", 0xFF0001}}, {12, {"Insula; anterior, left", 0}}, {200, {"7", 0xABCDEF}}};
  ASSERT_TRUE(write_label_regions(scratch / "labels.txt", regions));
  const auto read = read_label_regions(scratch / "labels.txt");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(*read, regions);

  ASSERT_TRUE(write_label_regions(scratch / "labels.txt", {{1, {"a \"b\"\n2 c", 0}}}));
  const auto replaced = read_label_regions(scratch / "labels.txt");
  ASSERT_TRUE(replaced) << replaced.error().message;
  EXPECT_EQ(replaced->at(1).name, "a 'b' 2 c");
  EXPECT_EQ(replaced->size(), 1U);
}

TEST(LabelRegions, TheBoundingBoxKeepsItsPlace) {
  const auto part = cropped(labels_of({0, 0, 5, 0, 6, 0}), [](std::int16_t v) { return v != 0; });
  EXPECT_EQ(part.voxels, (std::vector<std::int16_t>{5, 0, 6}));
  EXPECT_EQ(part.point_mm({0.0, 0.0, 0.0}), Eigen::Vector3d(12.0, 20.0, 30.0));
  EXPECT_TRUE(cropped(labels_of({0, 0}), [](std::int16_t v) { return v != 0; }).voxels.empty());
}

} // namespace
} // namespace bregma::casefile
