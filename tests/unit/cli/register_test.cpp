#include <gtest/gtest.h>

#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::Outcome;
using bregma::tests::run_bregma;

const std::string kSource = "name,x,y,z\nA,0,0,0\nB,100,0,0\nC,0,80,0\nD,0,0,60\n";
// A quarter turn about z and a translation of (10, 20, 30), in another order of points.
const std::string kTarget = "C,-70,20,30\nA,10,20,30\n# a remark\n\nD,10,20,90\nB,10,120,30\n";

Outcome register_points(const std::string &source, const std::string &target, const std::string &options = "") {
  const TemporaryFolder folder;
  folder.write("source.csv", source);
  folder.write("target.csv", target);
  return run_bregma(folder, "register points source.csv target.csv " + options);
}

TEST(RegisterPoints, PairsByNameAndGivesBothDirections) {
  const Outcome run = register_points(kSource, kTarget, "--json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = run.json();
  const auto &forth = json["T_target_source"];
  const auto &back = json["T_source_target"];
  EXPECT_NEAR(forth[0][1].get<double>(), -1.0, 1e-9);
  EXPECT_NEAR(forth[1][3].get<double>(), 20.0, 1e-6);
  EXPECT_NEAR(back[0][3].get<double>(), -20.0, 1e-6);
  EXPECT_NEAR(json["fre_mm"].get<double>(), 0.0, 1e-6);
  EXPECT_EQ(json["points"].size(), 4U);
  EXPECT_EQ(json["covariance"].size(), 6U);
}

TEST(RegisterPoints, WithoutNamesPointsArePairedByOrder) {
  const Outcome run = register_points("0,0,0\n100,0,0\n0,80,0\n", "10,20,30\n10,120,30\n-70,20,30\n", "--json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NEAR(run.json()["fre_mm"].get<double>(), 0.0, 1e-6);
}

TEST(RegisterPoints, NumbersInBothListsAreNames) {
  const Outcome run = register_points("1,0,0,0\n2,100,0,0\n3,0,80,0\n", "3,0,80,0\n1,0,0,0\n2,100,0,0\n", "--json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NEAR(run.json()["fre_mm"].get<double>(), 0.0, 1e-6);
}

TEST(RegisterPoints, TheTableShowsResidualsAndThatFreIsNotAccuracy) {
  const Outcome run =
      register_points(kSource, "A,10,20.3,30\nB,10,120,30\nC,-70,20,30.4\nD,10,20,90\n", "--at 0 0 100");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  for (const char *text : {"T_target_source", "T_source_target", "Residual mm", "Left out mm",
                           "a figure of consistency, not of accuracy", "estimated from the residuals",
                           "Predicted TRE (RMS) at the centroid", "Predicted TRE (RMS) at (0.0, 0.0, 100.0)"}) {
    EXPECT_NE(run.out.find(text), std::string::npos) << text << "\n" << run.out;
  }
}

TEST(RegisterPoints, ResidualsThatContradictTheStatedErrorAreRefused) {
  const Outcome run = register_points(kSource, "A,10,23,30\nB,10,120,30\nC,-70,20,30\nD,10,20,90\n", "--sigma-mm 0.2");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err.rfind("bregma: refused: the residuals are too large for the stated error", 0), 0U) << run.err;
  EXPECT_EQ(register_points(kSource, kTarget, "--sigma-mm 0.2").exit_code, 0);
}

TEST(RegisterPoints, PointsThatDoNotDetermineAPoseAreRefused) {
  Outcome run = register_points("0,0,0\n50,0,0\n", "0,0,0\n50,0,0\n");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err, "bregma: refused: 3 pairs of points are needed and at most 256 are taken, there are 2\n");
  const std::string line = "0,0,0\n50,0,0\n100,1,0\n";
  run = register_points(line, line);
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err.rfind("bregma: refused: the points lie on a line", 0), 0U) << run.err;
  run = register_points(line, line, "--json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.json()["accepted"], false);
}

TEST(RegisterPoints, AListInInchesIsNotTakenForALine) {
  // A head in inches is so small that its points are within 3 mm of a line.
  const Outcome run =
      register_points("A,0,0,0\nB,6,0,0\nC,0,3,0\nD,0,0,4\n", "A,0,0,0\nB,152.4,0,0\nC,0,76.2,0\nD,0,0,101.6\n");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.err.find("explained by scale 25.4"), std::string::npos) << run.err;
}

TEST(RegisterPoints, WrongFilesAreNamedWithLineAndValue) {
  const auto error_of = [](const std::string &source, const std::string &target) {
    const Outcome run = register_points(source, target);
    EXPECT_EQ(run.exit_code, 2);
    return run.err;
  };
  EXPECT_EQ(error_of("name,x,y,z\nA,0,zero,0\n", kTarget),
            "bregma: source.csv:2: point A: y = \"zero\": must be a finite number\n");
  EXPECT_EQ(error_of("A,0,nan,0\n", kTarget), "bregma: source.csv:1: point A: y = \"nan\": must be a finite number\n");
  EXPECT_EQ(error_of("1,2\n", kTarget),
            "bregma: source.csv:1: has 2 cells: without a header a row is x,y,z or name,x,y,z, and may go on with "
            "sx,sy,sz or cxx,cxy,cxz,cyy,cyz,czz\n");
  EXPECT_EQ(error_of("A,0,0,0\nB,50,0\n", kTarget), "bregma: source.csv:2: has 3 cells, there are 4 columns\n");
  EXPECT_EQ(error_of("A,0,0,0,1,1.5,1\nB,50,0,0,1,0,1\n", kTarget),
            "bregma: source.csv:2: point B: its error must be positive in every direction\n");
  EXPECT_EQ(error_of("A,0,0,0,1,0,0,1,2,1\n", kTarget),
            "bregma: source.csv:1: point A: its error must be positive in every direction\n");
  EXPECT_EQ(error_of("A,0,0,0\nA,50,0,0\nC,0,50,0\nD,0,0,50\n", kTarget),
            "bregma: source.csv: two points are called \"A\"; --by-order pairs the points by their order\n");
  EXPECT_EQ(error_of("0,0,0\n50,0,0\n0,50,0\n", "0,0,0\n50,0,0\n0,50,0\n0,0,50\n"),
            "bregma: source.csv has 3 points, target.csv has 4: they must be pairs to be paired by their order\n");
  EXPECT_EQ(error_of("A,0,0,0\nB,50,0,0\nC,0,50,0\n", "A,0,0,0\nX,50,0,0\nY,0,50,0\n"),
            "bregma: source.csv and target.csv have 1 names in common: \"A\", \"B\", \"C\" and \"A\", \"X\", \"Y\"; "
            "--by-order pairs the points by their order\n");
  const TemporaryFolder folder;
  EXPECT_EQ(run_bregma(folder, "register points a.dat b.csv").err,
            "bregma: a.dat: is neither a table (.csv, .tsv, .txt) nor .mrk.json nor .fcsv\n");
  EXPECT_EQ(run_bregma(folder, "register points a.csv b.csv").err, "bregma: a.csv: No such file or directory\n");
}

// CT and MR positions of a phantom's markers: far more points than a patient's fiducials are rejected.
TEST(RegisterPoints, SlicersFilesAreRead) {
  const TemporaryFolder folder;
  const auto markups = [](const std::string &system, const std::string &points) {
    return R"({"markups": [{"type": "Fiducial", "coordinateSystem": ")" + system + R"(", "controlPoints": [)" + points +
           "]}]}";
  };
  folder.write("lps.mrk.json", markups("LPS", R"({"label": "A", "position": [-1, -2, 3]},
    {"label": "B", "position": [-51, -2, 3]}, {"label": "C", "position": [-1, -62, 3]})"));
  folder.write("ras.mrk.json", markups("RAS", R"({"label": "A", "position": [1, 2, 3]},
    {"label": "B", "position": [51, 2, 3]}, {"label": "C", "position": [1, 62, 3]})"));
  const auto run = run_bregma(folder, "register points lps.mrk.json ras.mrk.json --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(run.json()["T_target_source"][i][i].get<double>(), 1.0, 1e-9) << "both mean the same points";
  }
}

TEST(RegisterPoints, WrongUnitsAreRefusedWithTheWidthAndAdvice) {
  const std::string metres = "A,0,0,0\nB,0.1,0,0\nC,0,0.08,0\nD,0,0,0.06\n";
  Outcome run = register_points(metres, kTarget);
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: source.csv: the set of points is 0.1 mm wide, at least 5 mm is taken: if the file is in "
                     "metres, say --source-units m\n");
  run = register_points(metres, kTarget, "--source-units m --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NEAR(run.json()["fre_mm"].get<double>(), 0.0, 1e-6);
  run = register_points(kSource,
                        "C,-70000,20000,30000\nA,10000,20000,30000\nD,10000,20000,90000\nB,10000,120000,30000\n");
  EXPECT_EQ(run.err,
            "bregma: target.csv: the set of points is 100000 mm wide, at most 1000 mm is taken: if the file is in "
            "micrometres, say --target-units um\n");
}

TEST(RegisterPoints, ATableInLpsIsTurnedIntoRas) {
  const std::string lps = "A,0,0,0\nB,-100,0,0\nC,0,-80,0\nD,0,0,60\n";
  const Outcome run = register_points(lps, kSource, "--source-space lps --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NEAR(run.json()["T_target_source"][0][0].get<double>(), 1.0, 1e-9);
  EXPECT_EQ(run.json()["frames"]["source"], "source.csv");
  EXPECT_EQ(run.json()["frames"]["axes"], "RAS");
}

TEST(RegisterPoints, ErrorsInTheFileAreUsedAsWeights) {
  // D has a stated error of 5 mm along z, and that error.
  const std::string source = "A,0,0,0,0.1,0.1,0.1\nB,100,0,0,0.1,0.1,0.1\nC,0,80,0,0.1,0.1,0.1\nD,0,0,65,0.1,0.1,5\n";
  const std::string target = "A,0,0,0\nB,100,0,0\nC,0,80,0\nD,0,0,60\n";
  const Outcome run = register_points(source, target, "--json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_FALSE(run.json()["sigma_estimated"].get<bool>());
  EXPECT_NEAR(run.json()["T_target_source"][2][3].get<double>(), 0.0, 0.01);
  EXPECT_NEAR(run.json()["points"][3]["norm_mm"].get<double>(), 5.0, 0.05);
  const Outcome both = register_points(source, target, "--sigma-mm 0.3");
  EXPECT_EQ(both.exit_code, 2);
  EXPECT_EQ(both.err, "bregma: the files state the error of their points: --sigma-mm is for files that do not\n");
}

const std::string kEight = "A,0,0,0\nB,100,0,0\nC,0,80,0\nD,0,0,60\nE,90,70,0\nF,90,0,50\nG,20,75,45\nH,70,60,55\n";
// E is 9 mm off.
const std::string kOneWrong = "A,0,0,0\nB,100,0,0\nC,0,80,0\nD,0,0,60\nE,90,70,9\nF,90,0,50\nG,20,75,45\nH,70,60,55\n";
// A and C are swapped.
const std::string kTwoWrong = "A,0,80,0\nB,100,0,0\nC,0,0,0\nD,0,0,60\nE,90,70,0\nF,90,0,50\nG,20,75,45\nH,70,60,55\n";

TEST(RegisterPoints, TheWrongPointsAreNamedWithTheirProbability) {
  const Outcome one = register_points(kEight, kOneWrong, "--sigma-mm 0.5");
  EXPECT_EQ(one.exit_code, 1);
  EXPECT_NE(
      one.err.find("these points contradict the others: \"E\" (9.00 mm from where the others predict it, probability "),
      std::string::npos)
      << one.err;
  const Outcome two = register_points(kEight, kTwoWrong, "--sigma-mm 0.5 --json");
  EXPECT_EQ(two.exit_code, 1);
  const auto json = two.json();
  ASSERT_EQ(json["suspects"].size(), 2U) << two.out;
  EXPECT_EQ(json["suspects"][0]["point"], "A");
  EXPECT_EQ(json["suspects"][1]["point"], "C");
  EXPECT_LT(json["suspects"][0]["p_value"].get<double>(), 1e-9);
  EXPECT_NEAR(json["suspects"][1]["from_the_others_mm"].get<double>(), 80.0, 1e-3);
  EXPECT_TRUE(json["points"][2]["suspect"].get<bool>());
  EXPECT_FALSE(json["points"][3]["suspect"].get<bool>());
}

TEST(RegisterPoints, SuspectsAreLeftOutOnlyWhenAsked) {
  const Outcome run = register_points(kEight, kTwoWrong, "--sigma-mm 0.5 --leave-out-suspects --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = run.json();
  EXPECT_TRUE(json["suspects_left_out"].get<bool>());
  EXPECT_EQ(json["suspects"].size(), 2U);
  EXPECT_NEAR(json["fre_mm"].get<double>(), 0.0, 1e-6);
  EXPECT_NEAR(json["T_target_source"][0][3].get<double>(), 0.0, 1e-6);
  const Outcome text = register_points(kEight, kTwoWrong, "--sigma-mm 0.5 --leave-out-suspects");
  EXPECT_NE(text.out.find("over 6 points"), std::string::npos) << text.out;
  EXPECT_NE(text.out.find("; left out"), std::string::npos) << text.out;
  // If the wrong points cannot be identified, no point is left out.
  const Outcome three = register_points("A,0,0,0\nB,100,0,0\nC,0,80,0\n", "A,0,0,0\nB,100,0,0\nC,0,95,0\n",
                                        "--sigma-mm 0.5 --leave-out-suspects");
  EXPECT_EQ(three.exit_code, 1);
  EXPECT_NE(three.err.find("the residuals do not show which"), std::string::npos) << three.err;
}

TEST(RegisterPoints, WithoutAStatedErrorAWrongPairIsRefusedByName) {
  const Outcome run = register_points(kEight, kOneWrong, "--json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_TRUE(run.json()["suspects"].empty()) << "only a stated error can be contradicted";
  EXPECT_NE(run.json()["reason"].get<std::string>().find("\"E\""), std::string::npos) << run.out;
}

TEST(RegisterPoints, TargetsHaveTheirPredictedErrorInTheTargetsFrame) {
  const TemporaryFolder folder;
  folder.write("source.csv", kSource);
  folder.write("target.csv", kTarget);
  folder.write("lesions.csv", "Near,10,50,40\nFar,10,50,540\n");
  const auto run =
      run_bregma(folder, "register points source.csv target.csv --sigma-mm 0.3 --targets lesions.csv --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = run.json();
  const auto &targets = json["targets"];
  ASSERT_EQ(targets.size(), 2U);
  EXPECT_EQ(targets[0]["target"], "Near");
  EXPECT_GT(targets[0]["tre_rms_mm"].get<double>(), 0.15); // sigma / sqrt(4) per coordinate, in three dimensions
  EXPECT_LT(targets[0]["tre_rms_mm"].get<double>(), 0.5);
  EXPECT_GT(targets[1]["tre_rms_mm"].get<double>(), 3.0 * targets[0]["tre_rms_mm"].get<double>());
  EXPECT_GT(targets[1]["within_95_mm"].get<double>(), targets[1]["tre_rms_mm"].get<double>());
  const auto text = run_bregma(folder, "register points source.csv target.csv --targets lesions.csv");
  EXPECT_NE(text.out.find("Predicted TRE mm (RMS)"), std::string::npos) << text.out;
  EXPECT_EQ(run_bregma(folder, "register points source.csv target.csv --targets none.csv").err,
            "bregma: none.csv: No such file or directory\n");
}

TEST(RegisterPoints, TheTransformIsWrittenForItkUnlessItIsRefused) {
  const TemporaryFolder folder;
  folder.write("source.csv", kSource);
  folder.write("target.csv", kTarget);
  ASSERT_EQ(run_bregma(folder, "register points source.csv target.csv --tfm out.tfm").exit_code, 0);
  const std::string tfm = bregma::tests::read_file(folder.path() / "out.tfm");
  EXPECT_EQ(tfm.rfind("#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n", 0), 0U)
      << tfm;
  folder.write("bent.csv", "A,10,23,30\nB,10,120,30\nC,-70,20,30\nD,10,20,90\n");
  EXPECT_EQ(run_bregma(folder, "register points source.csv bent.csv --sigma-mm 0.2 --tfm no.tfm").exit_code, 1);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "no.tfm"));
}

// 32 landmarks placed by two raters on the same image, so that the true pose is the identity.
TEST(RegisterPoints, TwoRatersOfTheSameHeadAgree) {
  BREGMA_SHARED_DATA(anat, "fiducials/afids_hcp/derivatives/afids_rater/sub-239944/anat");
  const TemporaryFolder folder;
  const std::string start = "'" + (anat / "sub-239944_space-T1w_desc-rater").string();
  const auto run = run_bregma(folder, "register points " + start + "GG_afids.fcsv' " + start + "CZ_afids.fcsv' --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto json = run.json();
  EXPECT_EQ(json["points"].size(), 32U);
  EXPECT_LT(json["fre_mm"].get<double>(), 3.0) << "they are numbered, and stand in another order";
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(json["T_target_source"][i][i].get<double>(), 1.0, 0.01);
  }
}

} // namespace
