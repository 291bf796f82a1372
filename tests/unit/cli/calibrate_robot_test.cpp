#include <initializer_list>
#include <string>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "tests/unit/cli/calibration_files.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;
using bregma::tests::write_hand_eye;
using bregma::tests::write_plane_scan;
using bregma::tests::write_readings;
using Eigen::Isometry3d;
using Eigen::Vector3d;

// Of a refused calibration nothing that could be used: null.
void expect_withheld(const nlohmann::json &json, std::initializer_list<const char *> keys) {
  EXPECT_EQ(json["accepted"], false);
  for (const char *key : keys) {
    EXPECT_TRUE(json.contains(key) && json[key].is_null()) << key << " of " << json;
  }
}

TEST(CalibrateHandEye, FindsBodyAndTracker) {
  const TemporaryFolder folder;
  write_hand_eye(folder, Vector3d::Ones());
  const auto json = run_bregma(folder, "calibrate hand-eye flange body --json").json();
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["verdict"], "accepted") << json["text"];
  EXPECT_EQ(json["pairs"], 15);
  EXPECT_EQ(json["poses_without_partner"], 1);
  EXPECT_NEAR(json["X"][2][3].get<double>(), 90.0, 1e-6);
  EXPECT_NEAR(json["Y"][2][3].get<double>(), 1400.0, 1e-6);
  EXPECT_EQ(run_bregma(folder, "calibrate hand-eye flange body").exit_code, 0);
}

TEST(CalibrateHandEye, RefusesOneAxis) {
  const TemporaryFolder folder;
  write_hand_eye(folder, Vector3d::UnitZ());
  const auto run = run_bregma(folder, "calibrate hand-eye flange body");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.out.find("about one axis"), std::string::npos) << run.out;
  EXPECT_EQ(run.out.find("X: "), std::string::npos) << run.out;
  expect_withheld(run_bregma(folder, "calibrate hand-eye flange body --json").json(),
                  {"X", "covariance_X", "Y", "covariance_Y"});
  write_hand_eye(folder, Vector3d::Ones());
  const Isometry3d elsewhere = bregma::tests::pose({0.5, 0.1, 0.2}, {30.0, 40.0, 50.0});
  folder.write("body/1000000000.txt", bregma::tests::text_of(elsewhere));
  folder.write("body/1050000000.txt", bregma::tests::text_of(elsewhere));
  const auto bad = run_bregma(folder, "calibrate hand-eye flange body --json");
  EXPECT_EQ(bad.exit_code, 1) << bad.out;
  expect_withheld(bad.json(), {"X", "covariance_X", "Y", "covariance_Y"});
}

TEST(CalibrateBeam, FindsTheBeamFromAPlane) {
  const TemporaryFolder folder;
  write_plane_scan(folder, 0.35);
  const auto json = run_bregma(folder, "calibrate beam plane.csv --range-mm 0.1 --json").json();
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["verdict"], "accepted") << json["text"];
  EXPECT_NEAR(json["origin_mm"][0].get<double>(), 12.0, 1e-4);
  EXPECT_NEAR(json["origin_mm"][2].get<double>(), 45.0, 1e-4);
}

TEST(CalibrateBeam, RefusesAFixedOrientationAndMissingColumns) {
  const TemporaryFolder folder;
  write_plane_scan(folder, 0.0);
  auto run = run_bregma(folder, "calibrate beam plane.csv");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_NE(run.out.find("kept its orientation"), std::string::npos) << run.out;
  EXPECT_EQ(run.out.find("Origin"), std::string::npos) << run.out;
  expect_withheld(run_bregma(folder, "calibrate beam plane.csv --json").json(),
                  {"origin_mm", "direction", "covariance"});
  folder.write("short.csv", "x_mm,y_mm\n1,2\n");
  run = run_bregma(folder, "calibrate beam short.csv");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: short.csv: no column \"z_mm\" in its header\n");
}

TEST(CalibrateRange, FitsAPowerLawAndNamesWhatItCannotRead) {
  const TemporaryFolder folder;
  write_readings(folder);
  const auto json = run_bregma(folder, "calibrate range readings.csv --json").json();
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["verdict"], "accepted") << json["text"];
  EXPECT_NEAR(json["scale_mm"].get<double>(), 270.0, 1e-6);
  EXPECT_NEAR(json["exponent"].get<double>(), -1.2, 1e-9);
  // Another law: the range of a sensor that is linear.
  std::string text = "reading,distance_mm\n";
  for (int mm = 100; mm <= 300; mm += 5) {
    text += std::to_string(1000 - 3 * mm) + "," + std::to_string(mm) + "\n";
  }
  folder.write("linear.csv", text);
  const auto linear = run_bregma(folder, "calibrate range linear.csv --json");
  EXPECT_EQ(linear.exit_code, 1) << linear.out;
  expect_withheld(linear.json(), {"scale_mm", "exponent", "covariance"});
  EXPECT_EQ(run_bregma(folder, "calibrate range linear.csv").out.find("exponent "), std::string::npos);
  folder.write("bad.csv", "reading,distance_mm\n1.2,here\n");
  const auto run = run_bregma(folder, "calibrate range bad.csv");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: bad.csv:2: distance_mm: no number\n");
}

} // namespace
