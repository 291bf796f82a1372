// What a camera beside the simulated arm sees: the line that states it, and the simulated tracker.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "base/checked_line.hpp"
#include "base/parameters.hpp"
#include "casefile/case.hpp"
#include "drivers/frame/settings.hpp"
#include "drivers/frame/system_host.hpp"
#include "drivers/sim/arm/carried_sensor.hpp"
#include "drivers/sim/arm/moving_head.hpp"
#include "drivers/sim/arm/scene_line.hpp"
#include "drivers/sim/tracker/tracker_beside_arm.hpp"
#include "idl/names.hpp"
#include "tests/support/tcp_device.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/robot/arms.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim {
namespace {

constexpr const char *kBody = "Stylus"; // of the case: any tool may be at the flange

Scene scene_of(const casefile::Case &a_case) {
  robot::JointAngles joints;
  joints << 0.0, 1.019, -0.431, 0.0, -0.588, 0.0; // the flange looks down
  Scene out;
  out.time_us = 12'345'678;
  out.T_base_flange = bregma::test::mz07f().forward(joints);
  const Head head(a_case.scalp.mesh, 0.0, 15.0, 1);
  out.T_base_image = lying_head(head, out.T_base_flange * Vector3d(0.0, 0.0, 200.0), 0.3);
  return out;
}

TEST(SceneLine, IsReadAsItWasWrittenAndDamagedOnesAreRefused) {
  const Scene scene = scene_of(test::make_case());
  const std::string line = line_of(scene);
  ASSERT_TRUE(line.ends_with("\r\n"));
  const std::string_view body = std::string_view(line).substr(0, line.size() - 2);
  const auto read = parse_scene(body);
  ASSERT_TRUE(read) << read.error();
  EXPECT_EQ(read->time_us, scene.time_us);
  EXPECT_LT((read->T_base_flange.matrix() - scene.T_base_flange.matrix()).norm(), 1e-12);
  EXPECT_LT((read->T_base_image.matrix() - scene.T_base_image.matrix()).norm(), 1e-12);
  EXPECT_LT(line.size(), kMaxSceneLine);

  EXPECT_EQ(parse_scene("").error(), "is damaged");
  EXPECT_EQ(parse_scene(body.substr(0, body.size() - 1)).error(), "is damaged");
  const auto problem = [](const std::string &text) {
    const std::string checked = base::checked_line(text);
    return std::string(parse_scene(std::string_view(checked).substr(0, checked.size() - 2)).error());
  };
  EXPECT_EQ(problem("scene,1,0,0,0,1,0,0,0"), "is no scene");
  EXPECT_EQ(problem("alive,1,0,0,0,1,0,0,0,0,0,0,1,0,0,0"), "is no scene");
  EXPECT_EQ(problem("scene,-1,0,0,0,1,0,0,0,0,0,0,1,0,0,0"), "has no time");
  EXPECT_EQ(problem("scene,1,0,0,0,1,0,0,0,0,0,0,2,0,0,0"), "has a value that is no pose");
  EXPECT_EQ(problem("scene,1,0,nan,0,1,0,0,0,0,0,0,1,0,0,0"), "has a value that is no pose");
}

TEST(MovingHead, MovesSmoothlyToADisplacementFromItsRest) {
  const BaseImage resting(geometry::rotation_exp(Vector3d(0.1, 0.2, 0.3)), Vector3d(400.0, 10.0, 90.0));
  const Vector3d middle(3.0, -20.0, 40.0);
  MovingHead head(resting, middle);
  EXPECT_LT((head.at(0).matrix() - resting.matrix()).norm(), 1e-12);
  geometry::Vector6d to;
  to << 0.0, 0.0, 0.1, 4.0, 0.0, 0.0;
  head.move(to, 2.0, 1'000'000'000);
  EXPECT_LT((head.at(1'000'000'000).matrix() - resting.matrix()).norm(), 1e-12);
  EXPECT_NEAR((head.at(2'000'000'000) * middle - resting * middle).x(), 2.0, 1e-9);
  EXPECT_NEAR((head.at(9'000'000'000) * middle - resting * middle).x(), 4.0, 1e-9);
  EXPECT_NEAR(geometry::angle_between(head.at(9'000'000'000).rotation(), resting.rotation()), 0.1, 1e-9);
  head.move(geometry::Vector6d::Zero(), 0.0, 9'000'000'000); // back, at once
  EXPECT_LT((head.at(9'000'000'001).matrix() - resting.matrix()).norm(), 1e-9);
}

TEST(TrackerBesideArm, SeesTheReferenceOnAHeadThatMovesAndTheBodyOnTheFlange) {
  const casefile::Case a_case = test::make_case();
  Scene scene = scene_of(a_case);
  TrackerBesideArm tracker(a_case, kBody, {}, 3);
  const auto pose_of = [&](const wire::TrackerFrame &frame, std::string_view name) {
    for (std::uint32_t i = 0; i < frame.tool_count; ++i) {
      if (wire::view(frame.tools[i].tool) == name) {
        EXPECT_EQ(frame.tools[i].status, bregma_wire_TOOL_VISIBLE) << name;
        return wire::from_wire<frame::Tracker, frame::Tool>(frame.tools[i].T_tracker_tool);
      }
    }
    ADD_FAILURE() << name;
    return T_TrackerTool();
  };
  const wire::TrackerFrame first = tracker.measure(scene);
  ASSERT_EQ(first.tool_count, 2U);
  const auto T_base_tracker = *tracker.T_base_tracker();
  const auto body_error_mm = [&](const wire::TrackerFrame &frame) {
    const Vector3d there = T_base_tracker * pose_of(frame, kBody).translation();
    return (there - scene.T_base_flange * tracker.T_flange_body().translation()).norm();
  };
  EXPECT_LT(body_error_mm(first), 1.0); // of one frame

  const auto reference = pose_of(first, a_case.reference()->name);
  scene.T_base_image = {scene.T_base_image.rotation(), scene.T_base_image.translation() + Vector3d(5.0, 0.0, 0.0)};
  scene.time_us += 16'000;
  const wire::TrackerFrame second = tracker.measure(scene);
  EXPECT_EQ(second.frame, first.frame + 1);
  EXPECT_NEAR(static_cast<double>(second.device_time_ns - first.device_time_ns), 16e6, 0.5e6);
  const Vector3d way = T_base_tracker.rotation() *
                       Vector3d(pose_of(second, a_case.reference()->name).translation() - reference.translation());
  EXPECT_LT((way - Vector3d(5.0, 0.0, 0.0)).norm(), 1.5);
  EXPECT_LT(body_error_mm(second), 1.0) << "the arm has not moved";
  EXPECT_THROW(TrackerBesideArm(a_case, "Nobody", {}, 3), std::invalid_argument);
}

class FrameBus final : public driver::Bus {
public:
  bool write(std::string_view topic, const void *sample) override {
    if (topic == wire::Topic<wire::TrackerFrame>::kName) {
      frames.push_back(*static_cast<const wire::TrackerFrame *>(sample));
    }
    return true;
  }
  void take(std::string_view /*topic*/, const std::function<void(const void *)> & /*visit*/) override {}
  [[nodiscard]] std::uint32_t matched(std::string_view /*topic*/) const override { return 1; }

  std::vector<wire::TrackerFrame> frames;
};

TEST(TrackerDevice, PublishesAFramePerSceneOfItsSocketAndSkipsWhatIsDamaged) {
  const bregma::test::TemporaryFolder folder;
  casefile::Case a_case = test::make_case();
  a_case.folder = folder.path();
  a_case.image = folder.path() / "image.nii.gz";
  std::ofstream(a_case.image) << "only its name matters\n";
  ASSERT_TRUE(casefile::save_case(a_case));
  bregma::test::TcpDevice arm;
  TrackerDevice tracker;
  base::ParameterSet parameters("bregma-sim-tracker");
  tracker.declare(parameters);
  ASSERT_TRUE(parameters.set_from_string("address=" + arm.address()));
  ASSERT_TRUE(parameters.set_from_string("case=" + folder.path().string()));
  const auto nobody = tracker.prepare({});
  ASSERT_FALSE(nobody);
  EXPECT_EQ(nobody.error().message, "case ellipsoid has no tool Marker");
  ASSERT_TRUE(parameters.set_from_string("body=Stylus"));
  ASSERT_TRUE(tracker.prepare({}));

  FrameBus bus;
  driver::SystemHost host;
  driver::Status status;
  driver::Io io(bus, host, status, {.device = "Tracker", .map_device_time = false}); // as fast as the bytes arrive
  ASSERT_TRUE(tracker.connect(io));
  ASSERT_TRUE(arm.accept());
  Scene scene = scene_of(a_case);
  for (std::size_t sent = 1; sent <= 5; ++sent) {
    scene.time_us += 16'000;
    ASSERT_TRUE(arm.send("$scene,damaged\r\n" + line_of(scene)));
    for (int i = 0; i < 100 && bus.frames.size() < sent; ++i) {
      ASSERT_TRUE(tracker.read(io));
    }
    ASSERT_EQ(bus.frames.size(), sent);
  }
  EXPECT_EQ(status.values().skipped, 5U);
  EXPECT_EQ(wire::view(bus.frames.back().device), "Tracker");
  EXPECT_EQ(bus.frames.back().period_ns, 16'000'000);
  EXPECT_EQ(bus.frames.back().tools[1].status, bregma_wire_TOOL_VISIBLE);
  arm.hang_up();
  driver::Outcome<driver::Progress> lost = driver::Progress::kContinue;
  for (int i = 0; i < 100 && lost; ++i) {
    lost = tracker.read(io);
  }
  EXPECT_FALSE(lost) << "the loop connects again";
  tracker.disconnect();
}

} // namespace
} // namespace bregma::sim
