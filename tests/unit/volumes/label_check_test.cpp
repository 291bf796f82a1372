// Labels against the image that they are said to belong to.
#include "casefile/volumes/label_check.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

LabelVolume mirrored(LabelVolume labels) {
  for (int k = 0; k < labels.size[2]; ++k) {
    for (int j = 0; j < labels.size[1]; ++j) {
      const auto row = labels.voxels.begin() + static_cast<std::ptrdiff_t>(labels.offset(0, j, k));
      std::reverse(row, row + labels.size[0]);
    }
  }
  return labels;
}

TEST(LabelCheck, MirroredLabelsOfTheDemonstrationAreNoticed) {
  const auto image = read_volume(test::templates() / "ch2.nii.gz");
  const auto labels = read_labels(test::templates() / "aal.nii.gz");
  const auto names = read_label_names(test::templates() / "aal.nii.txt");
  if (!image || !labels || !names) {
    GTEST_SKIP() << "needs mricron-data";
  }
  EXPECT_EQ(label_doubts(*labels, *names, *image), std::vector<std::string>());
  const auto doubts = label_doubts(mirrored(*labels), *names, *image);
  ASSERT_EQ(doubts.size(), 1U);
  EXPECT_EQ(doubts[0], "lie on the other side than their names say (108 of 108 regions): are they mirrored left to "
                       "right, or of another table of names?");
  EXPECT_EQ(label_doubts(mirrored(*labels), {}, *image), std::vector<std::string>()) << "without names";
}

TEST(LabelCheck, AnotherGridAndLabelsOutsideAreSaid) {
  Volume image{{{20, 20, 20}, Eigen::Matrix4d::Identity()}, std::vector<float>(8'000, 1.0F)};
  LabelVolume labels{{{20, 20, 20}, Eigen::Matrix4d::Identity()}, std::vector<std::int16_t>(8'000, 1)};
  EXPECT_TRUE(label_doubts(labels, {}, image).empty());
  labels.T_image_index(0, 3) = 5.0;
  const auto doubts = label_doubts(labels, {}, image);
  ASSERT_EQ(doubts.size(), 2U);
  EXPECT_EQ(doubts[0], "lie on another grid than the image: were they made from it?");
  EXPECT_EQ(doubts[1], "lie outside of the image in 25 % of their voxels");
  labels.T_image_index(0, 3) = 0.01;
  EXPECT_TRUE(label_doubts(labels, {}, image).empty()) << "rounding of a header";
}

} // namespace
} // namespace bregma::casefile
