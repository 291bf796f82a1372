#include <array>
#include <cmath>
#include <cstdio>
#include <string>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;
using Eigen::Isometry3d;
using Eigen::Vector3d;

Isometry3d pose(const Vector3d &turn, const Vector3d &at) {
  Isometry3d out = Isometry3d::Identity();
  out.linear() = Eigen::AngleAxisd(turn.norm() + 1e-12, (turn + 1e-12 * Vector3d::UnitX()).normalized()).matrix();
  out.translation() = at;
  return out;
}

Vector3d wave(int i, double scale) {
  return scale * Vector3d(std::sin(1.7 * i), std::sin(2.3 * i + 1.0), std::sin(0.9 * i + 2.0));
}

std::string text_of(const Isometry3d &T) {
  std::string out;
  for (int r = 0; r < 4; ++r) {
    std::array<char, 160> line{};
    std::snprintf(line.data(), line.size(), "%.15g %.15g %.15g %.15g\n", T(r, 0), T(r, 1), T(r, 2), T(r, 3));
    out += line.data();
  }
  return out;
}

void write_hand_eye(const TemporaryFolder &folder, const Vector3d &turns) {
  const Isometry3d X = pose({0.1, 0.2, -0.3}, {20.0, -35.0, 90.0});
  const Isometry3d Y = pose({0.4, -0.2, 1.0}, {150.0, -300.0, 1400.0});
  for (int i = 0; i < 15; ++i) {
    const Isometry3d A = pose(wave(i, 0.6).cwiseProduct(turns), Vector3d(400.0, 0.0, 500.0) + wave(3 * i + 1, 100.0));
    const std::string name = std::to_string(1'000'000'000 + 50'000'000LL * i) + ".txt";
    folder.write("flange/" + name, text_of(A));
    folder.write("body/" + name, text_of(Y.inverse() * A * X));
  }
  folder.write("body/9000000000.txt", text_of(X));
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
}

void write_plane_scan(const TemporaryFolder &folder, double turn) {
  const Vector3d origin(12.0, -8.0, 45.0);
  const Vector3d direction = Vector3d(0.03, -0.05, 1.0).normalized();
  std::string text = "x_mm,y_mm,z_mm,qw,qx,qy,qz,range_mm\n";
  for (int i = 0; i < 120; ++i) {
    const Isometry3d T =
        pose(Vector3d(3.0, 0.0, 0.0) + wave(i, turn), Vector3d(0.0, 0.0, 250.0) + wave(2 * i + 1, 60.0));
    const Vector3d foot = T * origin;
    const double range = -foot.z() / (T.linear() * direction).z(); // down to z = 0
    const Eigen::Quaterniond q(T.linear());
    std::array<char, 300> line{};
    std::snprintf(line.data(), line.size(), "%.12g,%.12g,%.12g,%.15g,%.15g,%.15g,%.15g,%.12g\n", T.translation().x(),
                  T.translation().y(), T.translation().z(), q.w(), q.x(), q.y(), q.z(), range);
    text += line.data();
  }
  folder.write("plane.csv", text);
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
  folder.write("short.csv", "x_mm,y_mm\n1,2\n");
  run = run_bregma(folder, "calibrate beam short.csv");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: short.csv: no column \"z_mm\" in its header\n");
}

TEST(CalibrateRange, FitsAPowerLawAndNamesWhatItCannotRead) {
  const TemporaryFolder folder;
  std::string text = "reading,distance_mm\n";
  for (int mm = 100; mm <= 300; mm += 5) {
    std::array<char, 60> line{};
    std::snprintf(line.data(), line.size(), "%.12g,%d\n", std::pow(mm / 270.0, -1.0 / 1.2), mm);
    text += line.data();
  }
  folder.write("readings.csv", text);
  const auto json = run_bregma(folder, "calibrate range readings.csv --json").json();
  ASSERT_TRUE(json.is_object());
  EXPECT_EQ(json["verdict"], "accepted") << json["text"];
  EXPECT_NEAR(json["scale_mm"].get<double>(), 270.0, 1e-6);
  EXPECT_NEAR(json["exponent"].get<double>(), -1.2, 1e-9);
  folder.write("bad.csv", "reading,distance_mm\n1.2,here\n");
  const auto run = run_bregma(folder, "calibrate range bad.csv");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: bad.csv:2: distance_mm: no number\n");
}

} // namespace
