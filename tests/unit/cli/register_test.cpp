#include <gtest/gtest.h>

#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::tests::Outcome;
using bregma::tests::run_bregma;
using bregma::tests::TempFolder;

const std::string kSource = "name,x,y,z\nA,0,0,0\nB,100,0,0\nC,0,80,0\nD,0,0,60\n";
// A quarter turn about z and (10, 20, 30), in another order.
const std::string kTarget = "C,-70,20,30\nA,10,20,30\n# a remark\n\nD,10,20,90\nB,10,120,30\n";

Outcome register_points(const std::string &source, const std::string &target, const std::string &options = "") {
  const TempFolder folder;
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

TEST(RegisterPoints, WithoutNamesTheOrderCounts) {
  const Outcome run = register_points("0,0,0\n100,0,0\n0,80,0\n", "10,20,30\n10,120,30\n-70,20,30\n", "--json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NEAR(run.json()["fre_mm"].get<double>(), 0.0, 1e-6);
}

TEST(RegisterPoints, TheTableShowsResidualsAndSaysWhatFreIsNot) {
  const Outcome run =
      register_points(kSource, "A,10,20.3,30\nB,10,120,30\nC,-70,20,30.4\nD,10,20,90\n", "--at 0 0 100");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  for (const char *text : {"T_target_source", "T_source_target", "Residual mm", "Left out mm",
                           "a figure of consistency, not of accuracy", "estimated from the residuals",
                           "Predicted TRE (RMS) at the centroid", "Predicted TRE (RMS) at (0.0, 0.0, 100.0)"}) {
    EXPECT_NE(run.out.find(text), std::string::npos) << text << "\n" << run.out;
  }
}

TEST(RegisterPoints, AStatedErrorThatTheResidualsContradictIsRefused) {
  const Outcome run = register_points(kSource, "A,10,23,30\nB,10,120,30\nC,-70,20,30\nD,10,20,90\n", "--sigma-mm 0.2");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err.rfind("bregma: refused: the residuals are too large for the stated error", 0), 0U) << run.err;
  EXPECT_EQ(register_points(kSource, kTarget, "--sigma-mm 0.2").exit_code, 0);
}

TEST(RegisterPoints, PointsThatFixNoPoseAreRefused) {
  Outcome run = register_points("0,0,0\n1,0,0\n", "0,0,0\n1,0,0\n");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err, "bregma: refused: 2 points; 3 are needed, and at most 64 are taken\n");
  const std::string line = "0,0,0\n50,0,0\n100,1,0\n";
  run = register_points(line, line);
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.err.rfind("bregma: refused: the points lie on a line", 0), 0U) << run.err;
  run = register_points(line, line, "--json");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.json()["accepted"], false);
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
            "bregma: source.csv:1: must be \"name,x,y,z\" or \"x,y,z\", this line has 2 cells\n");
  EXPECT_EQ(error_of(kSource, "A,0,0,0\n"), "bregma: source.csv has 4 points, target.csv has 1: they must be pairs\n");
  EXPECT_EQ(error_of(kSource, "A,0,0,0\nB,1,0,0\nC,0,1,0\nX,0,0,1\n"), "bregma: target.csv: has no point \"D\"\n");
  const TempFolder folder;
  EXPECT_EQ(run_bregma(folder, "register points a.txt b.csv").err,
            "bregma: a.txt: is neither .csv nor .mrk.json nor .fcsv\n");
  EXPECT_EQ(run_bregma(folder, "register points a.csv b.csv").err,
            "bregma: a.csv: no such file, or it cannot be read\n");
}

// CT and MR positions of the markers of a phantom: many more than a patient's fiducials are not taken.
TEST(RegisterPoints, SlicersFilesAreRead) {
  const TempFolder folder;
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

} // namespace
