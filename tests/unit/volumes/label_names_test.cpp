// Names of regions: tables of several programs, and those of known atlases.
#include "casefile/volumes/label_names.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "casefile/volumes/case_builder.hpp"
#include "tests/unit/volumes/files.hpp"

namespace bregma::casefile {
namespace {

using test::TemporaryFolder;
using test::write_bytes;

TEST(LabelNames, AreReadAndChecked) {
  const TemporaryFolder scratch;
  write_bytes(scratch / "n.txt", "1 Precentral_L 2001\n\n# comment\n2 Precentral_R 2002\r\n");
  const auto names = read_label_names(scratch / "n.txt");
  ASSERT_TRUE(names);
  EXPECT_EQ((std::map<int, std::string>{{1, "Precentral_L"}, {2, "Precentral_R"}}), *names);
  write_bytes(scratch / "n.txt", "1 A\nB 2\n");
  EXPECT_EQ((scratch / "n.txt").string() + ": line 2: \"B 2\" is not a region number and a name",
            read_label_names(scratch / "n.txt").error().message);
  write_bytes(scratch / "n.txt", "1 A\n1 B\n");
  EXPECT_EQ((scratch / "n.txt").string() + ": line 2: region 1 is named a second time",
            read_label_names(scratch / "n.txt").error().message);
}

TEST(LabelNames, TablesOfOtherProgramsAreRead) {
  const TemporaryFolder scratch;
  const char *const xml = "<atlas><data><label><index>23</index><short_name>rAcc</short_name><name>Right "
                          "Accumbens Area</name></label>\n<label><index>1024</index>"
                          "<name>ctx-lh-precentral</name></label></data></atlas>"; // SPM
  for (const std::string table :
       {"# FreeSurfer\n23 Right Accumbens Area\n1024 ctx-lh-precentral 60 20 220 0\n",
        "23\tRight Accumbens Area\n1024\tctx-lh-precentral\t60\n",
        "ROIid;ROIabbr;ROIname\n23;rAcc;Right Accumbens Area\n1024;p;ctx-lh-precentral\n",
        "23,\"Right Accumbens Area\"\r\n1024,ctx-lh-precentral\r\n",
        "23 255 0 0 1 1 1 \"Right Accumbens Area\"\n1024 0 0 9 1 1 1 \"ctx-lh-precentral\"\n", xml}) {
    write_bytes(scratch / "n.txt", table);
    const auto names = read_label_names(scratch / "n.txt");
    ASSERT_TRUE(names) << names.error().message;
    EXPECT_EQ((LabelNames{{23, "Right Accumbens Area"}, {1024, "ctx-lh-precentral"}}), *names) << table;
  }
  for (const auto &[table, reason] : {std::pair("1 255 0 0\n", "is not a region number and a name"),
                                      {"1,2,3\n", "is not a region number and a name"},
                                      {"<a><index>x</index><name>b</name></a>", "has no name"},
                                      {"<a></a>", "holds no <index> and <name>"}}) {
    write_bytes(scratch / "n.txt", table);
    const auto names = read_label_names(scratch / "n.txt");
    ASSERT_FALSE(names) << table;
    EXPECT_NE(names.error().message.find(reason), std::string::npos) << names.error().message;
  }
}

TEST(LabelNames, SaySides) {
  for (const char *left : {"Precentral_L", "left M1", "Heschl gyrus L", "ctx-lh-cuneus", "Left-Thalamus", "Insula_l"}) {
    EXPECT_EQ(side_named(left), Side::kLeft) << left;
  }
  for (const char *right : {"Precentral_R", "Right PrG precentral gyrus", "ctx-rh-cuneus", "S_nigra_r", "rh_V1"}) {
    EXPECT_EQ(side_named(right), Side::kRight) << right;
  }
  for (const char *neither : {"Brain Stem", "Vermis_3", "left and right", ""}) {
    EXPECT_FALSE(side_named(neither)) << neither;
  }
}

TEST(LabelNames, OfKnownAtlasesNameBothSides) {
  for (const auto &[atlas, count, left, right] :
       {std::tuple("freesurfer", 48U + 70U, std::pair(1024, "ctx-lh-precentral"), std::pair(2024, "ctx-rh-precentral")),
        {"Hammers", 83U, {50, "FL_precen_G_l"}, {51, "FL_precen_G_r"}},
        {"neuromorphometrics",
         7U + 30U + 96U,
         {183, "Left PrG precentral gyrus"},
         {182, "Right PrG precentral gyrus"}}}) {
    const auto names = known_label_names(atlas);
    ASSERT_TRUE(names) << atlas;
    EXPECT_EQ(names->size(), count) << atlas;
    EXPECT_EQ(names->at(left.first), left.second);
    EXPECT_EQ(names->at(right.first), right.second);
    // Every critical structure is made of regions that the atlas has.
    for (const StructureRequest &structure : critical_structures(*names)) {
      for (const std::string &region : structure.regions) {
        EXPECT_TRUE(
            std::any_of(names->begin(), names->end(), [&](const auto &entry) { return entry.second == region; }))
            << atlas << ": " << region;
      }
    }
  }
  EXPECT_EQ(known_label_names("freesurfer")->at(2035), "ctx-rh-insula");
  EXPECT_EQ(known_label_names("hammers")->at(83), "G_sup_temp_ant_r");
  EXPECT_FALSE(known_label_names("labels.txt"));
}

} // namespace
} // namespace bregma::casefile
