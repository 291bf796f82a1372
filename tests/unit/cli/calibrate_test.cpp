#include <cmath>

#include <gtest/gtest.h>

#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;

// A tool with its tip at (0, 100, 0) that rotates about the origin by turn_rad about both axes, with errors of 0.15 mm.
void write_poses(const TemporaryFolder &folder, int count, double turn_rad) {
  for (int i = 0; i < count; ++i) {
    const double a = turn_rad * std::sin(0.37 * i);
    const double b = turn_rad * std::sin(0.23 * i + 1.0);
    // R = Rx(a) Rz(b); t = -R tip
    const double ca = std::cos(a), sa = std::sin(a), cb = std::cos(b), sb = std::sin(b);
    const auto error = [i](int axis) { return 0.2 * std::sin(1.7 * i * i + 2.0 * axis); };
    char text[512];
    std::snprintf(text, sizeof text, "%.12f %.12f 0 %.12f\n%.12f %.12f %.12f %.12f\n%.12f %.12f %.12f %.12f\n0 0 0 1\n",
                  cb, -sb, 100.0 * sb + error(0), ca * sb, ca * cb, -sa, -100.0 * ca * cb + error(1), sa * sb, sa * cb,
                  ca, -100.0 * sa * cb + error(2));
    folder.write("poses/" + std::to_string(1'000'000'000 + 50'000'000LL * i) + ".txt", text);
  }
}

TEST(CalibratePivot, AGoodRecordingIsAccepted) {
  const TemporaryFolder folder;
  write_poses(folder, 100, 0.4);
  const auto run = run_bregma(folder, "calibrate pivot poses");
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find(" mm from the tool's origin, known to 0."), std::string::npos) << run.out;
  EXPECT_NE(run.out.find("robust"), std::string::npos);
  const auto json = run_bregma(folder, "calibrate pivot poses --json").json();
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["verdict"], "accepted");
  EXPECT_NEAR(json["tip_mm"][1].get<double>(), 100.0, 0.3);
  EXPECT_EQ(json["covariance_mm2"].size(), 3U);
  EXPECT_EQ(json["poses"], 100);
}

TEST(CalibratePivot, AToolThatDidNotTurnIsRefused) {
  const TemporaryFolder folder;
  write_poses(folder, 100, 0.0);
  const auto run = run_bregma(folder, "calibrate pivot poses");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.out.rfind("refused: the tool was not moved (it turned by 0.0 degrees)\n", 0), 0U) << run.out;
  const auto json = run_bregma(folder, "calibrate pivot poses --json").json();
  EXPECT_EQ(json["verdict"], "static");
  EXPECT_FALSE(json.contains("tip_mm")) << "no tip where none was estimated";
}

TEST(CalibratePivot, FilesThatCannotBeReadAreNamed) {
  const TemporaryFolder folder;
  auto run = run_bregma(folder, "calibrate pivot nothing.tgz");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: nothing.tgz: no such file or folder\n");
  folder.write("poses/5.txt", "1 0 0 0\n0 1 0 zero\n");
  run = run_bregma(folder, "calibrate pivot poses");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: poses/5.txt:2: \"zero\" is not a finite number\n");
  folder.write("a.igs.mha", "Seq_Frame0000_ProbeToTrackerTransform = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\n"
                            "Seq_Frame0000_ProbeToTrackerTransformStatus = INVALID\nSeq_Frame0000_Timestamp = 1\n"
                            "ElementDataFile = LOCAL\n");
  run = run_bregma(folder, "calibrate pivot a.igs.mha");
  EXPECT_EQ(run.err, "bregma: a.igs.mha: no transform \"StylusToReference\"; the recording has ProbeToTracker, their "
                     "inverses and chains\n");
  run = run_bregma(folder, "calibrate pivot a.igs.mha --transform ProbeToTracker");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: a.igs.mha: none of its 1 frames has a valid ProbeToTracker (every link of status OK)\n");
}

TEST(CalibratePivot, TheRealRecordingsAreNotFitForNavigation) {
  BREGMA_SHARED_DATA(data, "tracker/pivot_optical");
  const TemporaryFolder folder;
  const auto shared = std::filesystem::canonical(data).string();
  const auto text = run_bregma(folder, "calibrate pivot '" + shared + "/poses_1151.tgz'");
  std::printf("%s", text.out.c_str());
  EXPECT_EQ(text.exit_code, 1);
  EXPECT_EQ(text.out.rfind("not fit for navigation: RMS ", 0), 0U);
  EXPECT_NE(text.out.find("-14.476  395.143  -7.558   3.184    12.309"), std::string::npos);
  const auto run = run_bregma(folder, "calibrate pivot --json '" + shared + "/subset_57/tests/data/PivotCalibration'");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.json()["verdict"], "residual_too_large");
  EXPECT_NEAR(run.json()["least_squares"]["rms_mm"].get<double>(), 3.0496, 5e-5);
}

} // namespace
