#include <gtest/gtest.h>

#include "tests/unit/cli/calibration_files.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;
using bregma::tests::write_poses;

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
  for (const char *key : {"tip_mm", "covariance_mm2", "pivot_mm"}) {
    EXPECT_TRUE(json.contains(key) && json[key].is_null()) << key;
  }
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
  EXPECT_NE(text.out.find("3.184    12.309"), std::string::npos) << "RMS and worst of least squares";
  EXPECT_EQ(text.out.find("395.143"), std::string::npos) << "a tip that is not fit for use is not shown";
  const auto run = run_bregma(folder, "calibrate pivot --json '" + shared + "/subset_57/tests/data/PivotCalibration'");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(run.json()["verdict"], "residual_too_large");
  const auto json = run.json();
  EXPECT_NEAR(json["least_squares"]["rms_mm"].get<double>(), 3.0496, 5e-5);
  EXPECT_TRUE(json["tip_mm"].is_null() && json["covariance_mm2"].is_null() && json["pivot_mm"].is_null());
  EXPECT_TRUE(json["least_squares"]["tip_mm"].is_null() && json["least_squares"]["pivot_mm"].is_null());
  EXPECT_TRUE(json["halves"]["tips_mm"].is_null() && json["halves"]["apart_mm"].is_number());
}

} // namespace
