// The alarms of the monitoring pipeline over the whole life of a daemon.
#include "server/stages/monitoring/pipeline.hpp"

#include <set>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "tests/unit/casefile/sample_case.hpp"

namespace bregma::server {
namespace {

constexpr int kCases = 200;

class MonitoringTest : public ::testing::Test {
protected:
  // A case whose tools have names of their own.
  void load(int number) {
    const std::string suffix = std::to_string(number);
    casefile::Case a_case = tests::sample_case("/cases/sample");
    for (casefile::ToolModel &tool : a_case.tools) {
      tool.name += suffix;
    }
    loaded = std::make_unique<LoadedCase>(std::make_shared<const casefile::Case>(std::move(a_case)), 12.0, 100);
    pipeline.handle(CaseChanged{static_cast<std::uint64_t>(number) + 1, loaded.get()});
    RegistrationAccepted accepted{};
    accepted.T_image_reference = {{1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}};
    for (std::size_t i = 0; i < 6; ++i) {
      accepted.covariance[7 * i] = i < 3 ? 1e-6 : 0.04;
    }
    pipeline.handle(MonitoringMessage(accepted));
    pipeline.handle(MonitoringMessage(SessionChanged{bregma_wire_SESSION_NAVIGATING, true}));
  }
  // A touch of the only landmark; error_mm: of the displayed tip.
  void touch(double error_mm) {
    JudgedCheck check{};
    check.error_mm = {error_mm, 0.0, 0.0};
    check.touch_covariance_mm2 = {0.1, 0, 0, 0, 0.1, 0, 0, 0, 0.1};
    pipeline.handle(MonitoringMessage(check));
  }
  void run(double milliseconds) {
    for (double passed = 0.0; passed < milliseconds; passed += 100.0) {
      now_ns += 100'000'000;
      pipeline.step({tracking, trackers, sensors, registration, recorder}, now_ns);
      AlarmCondition condition;
      while (events.try_pop(condition)) {
        (condition.active ? raised : cleared).insert(wire::text(condition.kind) + " " + wire::text(condition.subject));
      }
    }
  }

  AlarmEvents events;
  MonitoringPipeline pipeline{MonitoringParameters{}, events};
  std::unique_ptr<LoadedCase> loaded;
  TrackingView tracking{};
  inputs::StreamHealth trackers{};
  inputs::StreamHealth sensors{};
  wire::RegistrationState registration{};
  recording::RecorderStatus recorder{};
  std::int64_t now_ns = 0;
  std::set<std::string> raised;
  std::set<std::string> cleared;
};

TEST_F(MonitoringTest, EveryAlarmIsStillRaisedInTheTwoHundredthCaseOfADaemonsLife) {
  for (int number = 0; number < kCases; ++number) {
    const auto previous = std::move(loaded); // until the pipeline has taken the next
    raised.clear();
    cleared.clear();
    load(number);
    const std::string suffix = std::to_string(number);
    tracking = {};
    tracking.tool_count = 1;
    ASSERT_TRUE(wire::set_name(tracking.tools[0].tool, "Probe" + suffix));
    tracking.tools[0].status = bregma_wire_POSE_TOOL_HIDDEN;
    tracking.tools[0].planned = true;
    touch(0.1);
    touch(8.0); // the reference was bumped
    recorder.dropped += 1;
    run(1'000.0);
    EXPECT_TRUE(raised.contains("drift Reference" + suffix)) << number;
    EXPECT_TRUE(raised.contains("tool_hidden Probe" + suffix)) << number;
    EXPECT_TRUE(raised.contains("reference_hidden Reference" + suffix)) << number;
    EXPECT_TRUE(raised.contains("record_loss ")) << number;
    run(2'000.0);
    EXPECT_TRUE(cleared.contains("record_loss ")) << number;
    pipeline.handle(CaseChanged{static_cast<std::uint64_t>(number) + 1, nullptr});
    run(100.0);
    for (const char *kind : {"drift Reference", "tool_hidden Probe", "reference_hidden Reference"}) {
      EXPECT_TRUE(cleared.contains(kind + suffix)) << number;
    }
    if (HasFailure()) {
      break;
    }
  }
}

TEST_F(MonitoringTest, LessThanAnHourOfRecordingIsAnAlarm) {
  run(500.0);
  EXPECT_TRUE(raised.empty()) << "nothing is recorded";
  recorder.space = {.free_bytes = 3'700'000'000, .bytes_per_s = 1e6};
  run(500.0);
  EXPECT_TRUE(raised.empty()) << "62 minutes";
  recorder.space.bytes_per_s = 2e6;
  run(500.0);
  EXPECT_TRUE(raised.contains("recording_space "));
  recorder.space.free_bytes *= 10;
  run(2'000.0);
  EXPECT_TRUE(cleared.contains("recording_space "));
}

TEST_F(MonitoringTest, TwoWritersOfOneDeviceAreACriticalAlarmThatStatesWhichIsUsed) {
  trackers.device_count = 1;
  wire::DeviceHealth &tracker = trackers.devices[0];
  ASSERT_TRUE(wire::set_name(tracker.device, "Tracker"));
  tracker.kind = bregma_wire_DEVICE_TRACKER;
  tracker.status = bregma_wire_DEVICE_LIVE;
  run(1'000.0);
  EXPECT_TRUE(raised.empty());
  tracker.other_writer = 12;
  run(100.0);
  EXPECT_TRUE(raised.contains("other_writer Tracker"));
  run(2'000.0);
  EXPECT_TRUE(cleared.contains("other_writer Tracker"));
  raised.clear();
  tracker.takeovers = 1;
  run(100.0);
  EXPECT_TRUE(raised.contains("other_writer Tracker"));
}

} // namespace
} // namespace bregma::server
