// Inputs that were read wrongly once (tests/data/faults): each with what is right.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::Outcome;
using bregma::tests::run_bregma;

const std::string kFaults = BREGMA_SOURCE_DIR "/tests/data/faults/";

// The first list maps to the second by 25 degrees and (120, -45, 300) mm.
double from_truth_mm(const nlohmann::json &out) {
  const double truth[] = {120.0, -45.0, 300.0};
  double squares = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    squares += std::pow(out["T_target_source"][i][3].get<double>() - truth[i], 2);
  }
  return std::sqrt(squares);
}

struct Row {
  const char *name;
  const char *files; // source and target, in the folder of the name
  std::size_t pairs;
  double within_mm;
  std::vector<std::string> said; // in a note
};

TEST(FaultInput, TablesAndNamesAreReadForWhatTheySay) {
  const std::vector<Row> rows{
      {"csv_header_zyx", "a.csv b.mrk.json", 8, 0.002, {"RAS is assumed"}},
      {"csv_header_lps", "a.csv b.mrk.json", 8, 0.002, {}},
      {"csv_slicer_export", "a.csv b.mrk.json", 8, 0.002, {"not used: columns selected, visible, locked, description"}},
      {"csv_ants_xyzt", "a.csv b.csv", 8, 1.0, {"LPS is read", "not used: column t", "paired by their order"}},
      {"csv_plus_signs", "a.csv b.mrk.json", 8, 0.002, {"\"F1\" has no partner"}},
      {"points_subset",
       "a.csv b.mrk.json",
       5,
       0.002,
       {"\"Bregma\", \"Inion\", \"ParietalR\" have no partner", "mirror"}},
      {"points_unplaced_fcsv", "a.csv b.fcsv", 7, 0.002, {"(TragusL): positionStatus = 0: it was never placed"}},
      {"points_from_to_names", "a.fcsv b.fcsv", 8, 0.002, {"paired by number (\"From-1\" and \"To-1\")"}},
      {"points_bom_numbers", "a.csv b.csv", 8, 0.01, {}},
      {"points_zero_padded", "a.csv b.csv", 8, 0.01, {"paired by number (\"1\" and \"01\")"}},
      {"points_skipped_number", "a.csv b.csv", 6, 0.01, {"\"1\" has no partner", "\"8\" has no partner"}},
  };
  const TemporaryFolder folder;
  for (const Row &row : rows) {
    SCOPED_TRACE(row.name);
    const Outcome run =
        run_bregma(folder, "register points --json $(cd '" + kFaults + row.name + "' && realpath " + row.files + ")");
    ASSERT_EQ(run.exit_code, 0) << run.err;
    const auto out = run.json();
    EXPECT_EQ(out["verdict"], "found");
    EXPECT_EQ(out["points"].size(), row.pairs);
    EXPECT_LT(from_truth_mm(out), row.within_mm);
    for (const std::string &words : row.said) {
      EXPECT_NE(out["notes"].dump().find(nlohmann::json(words).dump().substr(1, words.size())), std::string::npos)
          << words << " is not in " << out["notes"];
    }
  }
}

TEST(FaultInput, ARefusedRegistrationNamesWhatExplainsItAndGivesNothingThatCouldBeUsed) {
  const TemporaryFolder folder;
  for (const auto &[name, reason] : {std::pair("points_cm_for_mm", "explained by scale 10"),
                                     {"points_mirrored", "explained by one list is the mirror image"}}) {
    SCOPED_TRACE(name);
    const std::string files = kFaults + name + "/a.csv " + kFaults + name + "/b.mrk.json";
    const Outcome run = run_bregma(folder, "register points --json --tfm out.tfm " + files);
    EXPECT_EQ(run.exit_code, 1);
    const auto out = run.json();
    EXPECT_EQ(out["verdict"], "refused");
    EXPECT_NE(out["reason"].get<std::string>().find(reason), std::string::npos) << out["reason"];
    for (const char *key : {"T_target_source", "T_source_target", "covariance", "tre_centroid_mm", "targets"}) {
      EXPECT_TRUE(out[key].is_null()) << key;
    }
    EXPECT_EQ(out["points"].size(), 8U);
    EXPECT_FALSE(std::filesystem::exists(folder / "out.tfm"));
    const Outcome text = run_bregma(folder, "register points " + files);
    EXPECT_EQ(text.out.find("T_target_source"), std::string::npos);
    EXPECT_EQ(text.out.find("TRE"), std::string::npos);
  }
}

TEST(FaultInput, TargetsKeepTheirUnitAndEveryRow) {
  const TemporaryFolder folder;
  const std::string points = "register points --json " + kFaults + "targets_units/a.csv " + kFaults +
                             "targets_units/b.mrk.json --targets " + kFaults + "targets_units/";
  const auto lesion = run_bregma(folder, points + "lesion.mrk.json --target-units m").json();
  EXPECT_NEAR(lesion["targets"][0]["position_mm"][2].get<double>(), 330.0, 1e-6);
  const auto rows = run_bregma(folder, points + "t5.csv").json();
  ASSERT_EQ(rows["targets"].size(), 2U);
  EXPECT_EQ(rows["targets"][0]["target"], "Lesion");
  EXPECT_NEAR(rows["targets"][0]["position_mm"][0].get<double>(), 150.0, 1e-6);
  const Outcome far = run_bregma(folder, points + "t.csv --target-units m");
  EXPECT_EQ(far.exit_code, 2);
  EXPECT_NE(far.err.find("is it in another unit or space?"), std::string::npos) << far.err;
}

// A name twice, an image of another one, and what nobody placed.
TEST(FaultInput, TargetsAndPointsOfOneFileBelongTogether) {
  const TemporaryFolder folder;
  const std::string points =
      "register points --json " + kFaults + "targets_units/a.csv " + kFaults + "targets_units/b.mrk.json";
  const auto markup = [](const std::string &control_points) {
    return R"({"markups":[{"type":"Fiducial","coordinateSystem":"LPS","coordinateUnits":"mm","controlPoints":[)" +
           control_points + "]}]}";
  };
  folder.write("mixed.mrk.json", markup(R"({"label":"A","position":[1,2,3]},)"
                                        R"({"label":"B","position":[9,2,3],"description":"image: T2"})"));
  folder.write("unplaced.mrk.json", markup(R"({"label":"A","position":[0,0,0],"positionStatus":"undefined"})"));
  folder.write("twice.csv", "name,r,a,s\nL,150,-20,330\nL,151,-20,330\n");
  folder.write("lps.csv", "# CoordinateSystem = LPS\nL,-150,20,330\n");
  folder.write("numbers.csv", "12.5,150,-20,330\n");
  for (const auto &[file, said] :
       {std::pair("mixed.mrk.json",
                  "its points were placed in different images: \"A\" in no named image, \"B\" in the image T2"),
        {"unplaced.mrk.json", "holds no points; note that unplaced.mrk.json: markup 1, control point 1 (A)"},
        {"twice.csv", "two points are called \"L\""},
        {"numbers.csv", "\"12.5\" is no name: 4 numbers need a header"}}) {
    const Outcome run = run_bregma(folder, points + " --targets " + file);
    EXPECT_EQ(run.exit_code, 2) << file;
    EXPECT_NE(run.err.find(said), std::string::npos) << run.err;
  }
  const auto lps = run_bregma(folder, points + " --targets lps.csv").json();
  EXPECT_NEAR(lps["targets"][0]["position_mm"][0].get<double>(), 150.0, 1e-6);
  folder.write("far.csv", "name,r,a,s\nL,-150,20,-330\n");
  const auto far = run_bregma(folder, points + " --targets far.csv").json();
  EXPECT_NE(far["notes"].dump().find("is it in another unit or space?"), std::string::npos) << far["notes"];
}

// A mirror image lies within any error that is large enough.
TEST(FaultInput, AStatedErrorDoesNotHideAMirrorImage) {
  const TemporaryFolder folder;
  const Outcome run = run_bregma(folder, "register points --json --sigma-mm 60 " + kFaults + "points_mirrored/a.csv " +
                                             kFaults + "points_mirrored/b.mrk.json");
  EXPECT_EQ(run.exit_code, 1);
  const auto out = run.json();
  EXPECT_NE(out["reason"].get<std::string>().find("explained by one list is the mirror image"), std::string::npos)
      << out["reason"];
  EXPECT_TRUE(out["T_target_source"].is_null());
}

TEST(FaultInput, AnInputIsNotWrittenOver) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "series");
  for (const char *name : {"s.mhd", "s.raw", "series/IM1", "cloud.csv"}) {
    std::ofstream(folder / name) << "x,y,z\n1,2,3\n";
  }
  for (const auto &[command, said] :
       {std::pair("register cloud cloud.csv cloud.csv --correspondences cloud.csv",
                  "--correspondences cloud.csv is an input file: it is not written over"),
        {"image register series s.mhd --tfm s.raw", "--tfm s.raw is a part of the input s.mhd: it is not written over"},
        {"image register series s.mhd --tfm series/IM1",
         "--tfm series/IM1 is a part of the input series: it is not written over"}}) {
    const Outcome run = run_bregma(folder, command);
    EXPECT_EQ(run.exit_code, 2);
    EXPECT_NE(run.err.find(said), std::string::npos) << run.err;
  }
  std::filesystem::copy(kFaults + "csv_header_lps/a.csv", folder / "a.csv");
  const Outcome run =
      run_bregma(folder, "register points a.csv " + kFaults + "csv_header_lps/b.mrk.json --tfm ./a.csv");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_NE(run.err.find("is an input file: it is not written over"), std::string::npos) << run.err;
}

} // namespace
