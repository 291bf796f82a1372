#include "server/stages/robot_tool/stage.hpp"

#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "casefile/robot_tools.hpp"
#include "server/stages/host.hpp"
#include "server/stages/sensors/stage.hpp"
#include "server/stages/wire_values.hpp"
#include "tests/support/memory_topics.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::server {
namespace {

constexpr std::int64_t kNow_ns = 1'800'000'000'000'000'000;
constexpr std::int64_t kMs_ns = 1'000'000;

std::string write_tools(const test::TemporaryFolder &folder, const std::string &text) {
  const auto file = folder.path() / "tools.toml";
  std::ofstream(file) << text;
  return file.string();
}

constexpr const char *kGuide = "[[tools]]\nname = \"Guide\"\ntip_mm = [0, 0, 100]\naxis = [0, 1, 0]\nsigma_mm = 0.1\n";

RobotView arm(const char *tool = "") {
  RobotView out;
  (void)wire::set_name(out.device, "Robot");
  (void)wire::set_name(out.tool, tool);
  out.frame = 7;
  out.acquired_ns = kNow_ns - 10 * kMs_ns;
  out.period_ns = 2 * kMs_ns;
  out.mode = bregma_wire_ROBOT_ENABLED;
  // A quarter turn about x: the flange's z points along -y of the base.
  const double h = std::sqrt(0.5);
  out.T_base_flange = {{h, h, 0.0, 0.0}, {10.0, 20.0, 30.0}};
  out.velocity_known = true;
  return out;
}

std::vector<RobotToolCalibration> guide() {
  RobotToolCalibration tool;
  (void)wire::set_name(tool.name, "Guide");
  tool.T_flange_tip.pose = {Eigen::Quaterniond::Identity(), Vector3d(0, 0, 100)};
  return {tool};
}

TEST(RobotTool, ComposesFlangeAndCalibration) {
  const auto out =
      tool_pose(arm("Guide"), guide(), {}, {}, {.flange_sigma_mm = 0.2, .flange_sigma_rad = 0.001}, kNow_ns);
  ASSERT_EQ(out.status, bregma_wire_POSE_LIVE);
  EXPECT_NEAR(out.T_base_tip.translation_mm[0], 10.0, 1e-9);
  EXPECT_NEAR(out.T_base_tip.translation_mm[1], -80.0, 1e-9);
  EXPECT_NEAR(out.T_base_tip.translation_mm[2], 30.0, 1e-9);
  EXPECT_EQ(out.age_ns, 10 * kMs_ns);
  EXPECT_EQ(out.valid_for_ns, 90 * kMs_ns);
  // At the tip the rotation's error acts on a lever of 100 mm, along the flange's x and z axes of the base.
  const Matrix3d P =
      uncertainty::tre_covariance(RowMajor<6>::Map(out.covariance), Vector3d::Map(out.T_base_tip.translation_mm));
  EXPECT_NEAR(P(0, 0), 0.2 * 0.2 + 0.1 * 0.1, 1e-9);
  EXPECT_NEAR(P(1, 1), 0.2 * 0.2, 1e-9);
  EXPECT_NEAR(P(2, 2), 0.2 * 0.2 + 0.1 * 0.1, 1e-9);
  EXPECT_EQ(out.scanner_status, bregma_wire_POSE_NOT_REGISTERED);
  EXPECT_TRUE(std::isnan(out.T_scanner_tip.translation_mm[0]));
}

// 10 ms after its frame, the flange that turns about the base's z at 1 rad/s may be 0.01 rad on: at the tip, 80 mm off
// the axis in y and 10 mm in x.
TEST(RobotTool, TheWaySinceTheFrameIsInTheCovariance) {
  RobotView moving = arm("Guide");
  moving.velocity_per_s[2] = 1.0;
  const auto position = [](const wire::RobotTool &tool) {
    return uncertainty::tre_covariance(RowMajor<6>::Map(tool.covariance),
                                       Vector3d::Map(tool.T_base_tip.translation_mm));
  };
  const Matrix3d still = position(tool_pose(arm("Guide"), guide(), {}, {}, {}, kNow_ns));
  const Matrix3d moved = position(tool_pose(moving, guide(), {}, {}, {}, kNow_ns));
  EXPECT_NEAR(moved(0, 0) - still(0, 0), 0.8 * 0.8, 1e-9);
  EXPECT_NEAR(moved(1, 1) - still(1, 1), 0.1 * 0.1, 1e-9);
  EXPECT_NEAR(moved(2, 2) - still(2, 2), 0.0, 1e-9);
}

TEST(RobotTool, WithoutAVelocityNoPoseIsShown) {
  RobotView first = arm("Guide");
  first.velocity_known = false;
  EXPECT_EQ(tool_pose(first, guide(), {}, {}, {}, kNow_ns).status, bregma_wire_POSE_LOST);
}

TEST(RobotTool, ARegistrationOfTheScannerPlacesTheTipInIt) {
  ScannerPoseView scanner;
  scanner.valid = true;
  (void)wire::set_name(scanner.scanner, "Scanner");
  scanner.T_base_scanner = {{1, 0, 0, 0}, {1, 2, 3}};
  for (std::size_t i = 3; i < 6; ++i) {
    scanner.covariance[7 * i] = 0.25;
  }
  const auto out = tool_pose(arm("Guide"), guide(), {}, scanner, {}, kNow_ns);
  ASSERT_EQ(out.scanner_status, bregma_wire_POSE_LIVE);
  EXPECT_NEAR(out.T_scanner_tip.translation_mm[0], 9.0, 1e-9);
  EXPECT_NEAR(out.T_scanner_tip.translation_mm[1], -82.0, 1e-9);
  EXPECT_NEAR(out.T_scanner_tip.translation_mm[2], 27.0, 1e-9);
  EXPECT_GT(out.scanner_error_95_mm, 2.79 * 0.5); // of the registration alone
  EXPECT_LT(out.scanner_error_95_mm, 2.8 * std::sqrt(0.25 + 0.04 + 0.01) + 1e-6);
}

TEST(RobotTool, APoseThatIsNotLiveIsNotANumber) {
  const auto expect_none = [](const wire::RobotTool &out, wire::PoseStatus status) {
    EXPECT_EQ(out.status, status);
    EXPECT_EQ(out.valid_for_ns, 0);
    EXPECT_TRUE(std::isnan(out.T_base_tip.rotation_wxyz[0]) && std::isnan(out.T_base_tip.translation_mm[2]));
    EXPECT_TRUE(std::isnan(out.covariance[0]) && std::isnan(out.T_scanner_tip.translation_mm[0]));
  };
  expect_none(tool_pose(arm("Guide"), guide(), {}, {}, {}, kNow_ns + 100 * kMs_ns), bregma_wire_POSE_STALE);
  expect_none(tool_pose(arm("Other"), guide(), {}, {}, {}, kNow_ns), bregma_wire_POSE_NOT_CALIBRATED);
  expect_none(tool_pose(arm(), guide(), {}, {}, {}, kNow_ns), bregma_wire_POSE_NOT_CALIBRATED);
  RobotView gone = arm("Guide");
  gone.lost = true;
  expect_none(tool_pose(gone, guide(), {}, {}, {}, kNow_ns), bregma_wire_POSE_LOST);
  expect_none(tool_pose(RobotView{}, guide(), {}, {}, {}, kNow_ns), bregma_wire_POSE_LOST);
}

TEST(RobotTool, TheStatedCovarianceOfTheArmIsUsed) {
  RobotView robot = arm("Guide");
  robot.covariance[wire::upper_index(3, 3)] = 4.0F;
  robot.covariance[wire::upper_index(4, 4)] = 1.0F;
  robot.covariance[wire::upper_index(5, 5)] = 1.0F;
  const auto out = tool_pose(robot, guide(), {}, {}, {}, kNow_ns);
  EXPECT_NEAR(out.covariance[3 * 6 + 3], 4.0, 1e-9);
}

TEST(RobotToolFile, RefusesWhatIsNoTool) {
  const test::TemporaryFolder folder;
  const auto error = [&](const std::string &text) {
    const auto read = casefile::read_robot_equipment(write_tools(folder, text));
    return read ? std::string() : read.error().message;
  };
  EXPECT_EQ(error(kGuide), "");
  EXPECT_NE(error("").find("at least one is needed"), std::string::npos);
  EXPECT_NE(error(std::string(kGuide) + kGuide).find("name = \"Guide\": appears twice"), std::string::npos);
  EXPECT_NE(
      error("[[tools]]\nname = \"G\"\ntip_mm = [0, 0, 1]\naxis = [0, 0, 0]\nsigma_mm = 0.1\n").find("has no length"),
      std::string::npos);
  EXPECT_NE(error("[[tools]]\nname = \"G\"\ntip_mm = [0, 0, 1]\n").find("sigma_mm"), std::string::npos);
}

TEST(RobotToolFile, AToolThatIsConfiguredMustBeInTheFile) {
  const test::TemporaryFolder folder;
  test::MemoryTopics topics;
  Host host;
  const StageContext context{topics.link(RobotToolStage::kName), host};
  EXPECT_NO_THROW(RobotToolStage({.tools = write_tools(folder, kGuide), .tool = "Guide"}, context));
  EXPECT_THROW(RobotToolStage({.tools = write_tools(folder, kGuide), .tool = "Drill"}, context), std::invalid_argument);
  EXPECT_THROW(RobotToolStage({.tools = "/nowhere.toml", .tool = ""}, context), std::invalid_argument);
}

// From the sample of an arm to the published pose, by both stages.
TEST(RobotToolStage, PublishesThePoseOfTheSampledArm) {
  const test::TemporaryFolder folder;
  test::MemoryTopics topics;
  Host host;
  SensorStage sensors({}, {topics.link(SensorStage::kName), host});
  RobotToolStage stage({.tools = write_tools(folder, kGuide), .tool = "Guide"},
                       {topics.link(RobotToolStage::kName), host});
  runtime::LatestValue<ScannerPoseView> scanner;
  stage.connect(sensors.robots, scanner);
  std::vector<wire::RobotTool> seen;
  topics.observe<wire::RobotTool>([&](const wire::RobotTool &sample) { seen.push_back(sample); });

  Moment now{.utc_ns = kNow_ns, .monotonic_ns = kNow_ns, .boot_ns = kNow_ns};
  wire::RobotState sample{};
  (void)wire::set_name(sample.device, "Robot");
  sample.frame = 1;
  sample.device_time_ns = sample.sent_time_ns = kNow_ns;
  sample.period_ns = 2 * kMs_ns;
  sample.mode = bregma_wire_ROBOT_ENABLED;
  sample.T_base_flange = {{1, 0, 0, 0}, {1, 2, 3}};
  topics.put(sample);
  sensors.step(now);
  stage.step(now);
  topics.deliver();
  ASSERT_EQ(seen.size(), 1U);
  EXPECT_EQ(seen.back().status, bregma_wire_POSE_LOST) << "of one frame the velocity is not known";

  now.utc_ns += sample.period_ns;
  now.monotonic_ns += sample.period_ns;
  now.boot_ns += sample.period_ns;
  sample.frame = 2;
  sample.device_time_ns = sample.sent_time_ns = now.utc_ns;
  sample.T_base_flange.translation_mm[0] = 1.1;
  topics.put(sample);
  sensors.step(now);
  stage.step(now);
  topics.deliver();
  ASSERT_EQ(seen.size(), 2U);
  EXPECT_EQ(seen.back().status, bregma_wire_POSE_LIVE);

  EXPECT_EQ(wire::view(seen.back().tool), "Guide");
  EXPECT_NEAR(seen.back().T_base_tip.translation_mm[2], 103.0, 1e-9);
  // z of the tip's frame is the axis of the tool, y of the flange.
  const auto &q = seen.back().T_base_tip.rotation_wxyz;
  const Vector3d axis = Eigen::Quaterniond(q[0], q[1], q[2], q[3]) * Vector3d::UnitZ();
  EXPECT_NEAR((axis - Vector3d::UnitY()).norm(), 0.0, 1e-9);

  now.utc_ns += 2000 * kMs_ns; // silence
  now.monotonic_ns += 2000 * kMs_ns;
  sensors.step(now);
  stage.step(now);
  topics.deliver();
  EXPECT_EQ(seen.back().status, bregma_wire_POSE_LOST);
  EXPECT_TRUE(std::isnan(seen.back().T_base_tip.translation_mm[0]));
}

} // namespace
} // namespace bregma::server
