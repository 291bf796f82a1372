#include "clients/gateway/encode.hpp"

#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "clients/gateway/encode_scanner.hpp"
#include "clients/gateway/layout.hpp"
#include "idl/names.hpp"

namespace bregma::gateway {
namespace {

constexpr std::int64_t kMs_ns = 1'000'000;
constexpr std::int64_t kArrival_ns = 5'000 * kMs_ns;

// Published 2 ms before its arrival at 5,000 ms, exposed 10 ms before that, valid for 90 ms.
live::Received<wire::NavigationState> state_of(wire::PoseStatus status) {
  live::Received<wire::NavigationState> out{};
  (void)wire::set_name(out.tool, "Probe");
  out.status = status;
  out.published_time_ns = 1'000'000 * kMs_ns;
  out.acquired_time_ns = out.published_time_ns - 10 * kMs_ns;
  out.age_ns = 10 * kMs_ns;
  out.valid_for_ns = 90 * kMs_ns;
  out.T_image_tip = {{std::sqrt(0.5), 0, 0, std::sqrt(0.5)}, {1, 2, 3}};
  out.tre_rms_mm = 0.7;
  out.acceleration_sigma_mm_s2 = wire::kUnknown;
  out.distance_to_target_mm = 12.0;
  out.arrival = {kArrival_ns, 2 * kMs_ns};
  return out;
}

live::Snapshot snapshot_with(const live::Received<wire::NavigationState> &state) {
  live::Snapshot out;
  out.health.emplace();
  out.health->session = bregma_wire_SESSION_NAVIGATING;
  out.health->arrival = {kArrival_ns, 0};
  out.tools["Probe"] = state;
  out.daemon_clock_ns = 1'000'000 * kMs_ns - kArrival_ns;
  return out;
}

TEST(ToolRecord, TimesAreThoseOfTheGatewaysClock) {
  const Tool tool = tool_record(state_of(bregma_wire_POSE_LIVE), true, kArrival_ns);
  EXPECT_EQ(tool.published_ms, 4998.0);
  EXPECT_EQ(tool.acquired_ms, 4988.0);
  EXPECT_EQ(tool.valid_until_ms, 5088.0);
  EXPECT_EQ(tool.status, bregma_wire_POSE_LIVE);
  EXPECT_EQ(tool.tip_mm[2], 3.0);
  const double quarter_turn[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1};
  for (int i = 0; i < 9; ++i) {
    EXPECT_NEAR(tool.rotation[i], quarter_turn[i], 1e-12) << i;
  }
  EXPECT_TRUE(std::isnan(tool.distance_to_target_mm)) << "without a plan there is no target";
}

void expect_blank(const Tool &tool) {
  EXPECT_NE(tool.status, bregma_wire_POSE_LIVE);
  EXPECT_NE(tool.status, bregma_wire_POSE_UNVERIFIED);
  EXPECT_TRUE(std::isnan(tool.valid_until_ms));
  for (const double value :
       {tool.tip_mm[0], tool.rotation[0], tool.covariance[0], tool.tre_rms_mm, tool.tre_95_semi_axes_mm[0],
        tool.nearest_structure_mm, tool.nearest_structure_sigma_mm, tool.distance_to_target_mm}) {
    EXPECT_TRUE(std::isnan(value));
  }
}

TEST(ToolRecord, ThePoseEndsWithItsTimeWithTheDaemonAndWithItsStatus) {
  const auto live = state_of(bregma_wire_POSE_LIVE);
  EXPECT_EQ(tool_record(live, true, kArrival_ns + 88 * kMs_ns - 1).status, bregma_wire_POSE_LIVE);
  expect_blank(tool_record(live, true, kArrival_ns + 88 * kMs_ns));
  expect_blank(tool_record(live, false, kArrival_ns));
  for (int status = 0; status < 20; ++status) {
    if (status != bregma_wire_POSE_LIVE && status != bregma_wire_POSE_UNVERIFIED) {
      expect_blank(tool_record(state_of(status), true, kArrival_ns));
    }
  }
  auto unknown = live;
  unknown.arrival.transit_ns.reset();
  expect_blank(tool_record(unknown, true, kArrival_ns));
  EXPECT_TRUE(std::isnan(tool_record(unknown, true, kArrival_ns).acquired_ms));
  auto nan = live;
  nan.T_image_tip.translation_mm[1] = wire::kUnknown;
  expect_blank(tool_record(nan, true, kArrival_ns));
}

TEST(ToolRecord, ThePlanIsStatedWithoutAPoseToo) {
  auto hidden = state_of(bregma_wire_POSE_TOOL_HIDDEN);
  (void)wire::set_name(hidden.trajectory, "Frontal");
  const Tool tool = tool_record(hidden, true, kArrival_ns);
  expect_blank(tool);
  EXPECT_STREQ(tool.trajectory, "Frontal") << "a page would draw another plan while the tool is hidden";
}

TEST(EncoderTest, AnUnchangedSnapshotIsNoNewsUntilThePoseIsOver) {
  RecordStore store;
  Encoder encoder(store);
  const auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  EXPECT_TRUE(encoder.encode(snapshot, {kArrival_ns, 0}));
  EXPECT_FALSE(encoder.encode(snapshot, {kArrival_ns + 50 * kMs_ns, 0}));
  EXPECT_TRUE(encoder.encode(snapshot, {kArrival_ns + 90 * kMs_ns, 0}));
}

TEST(EncoderTest, JitterOfTheDaemonsClockIsNoNews) {
  RecordStore store;
  Encoder encoder(store);
  auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  wire::Alarm alarm{};
  (void)wire::set_name(alarm.kind, "drift");
  alarm.state = bregma_wire_ALARM_RAISED;
  alarm.raised_time_ns = 999'000 * kMs_ns;
  snapshot.alarms[{"drift", ""}] = alarm;
  (void)encoder.encode(snapshot, {kArrival_ns, 0});
  *snapshot.daemon_clock_ns += 30'000;
  EXPECT_FALSE(encoder.encode(snapshot, {kArrival_ns + kMs_ns, 0}));
}

TEST(EncoderTest, AStateWhoseTransitIsNotKnownIsNoRecentOne) {
  RecordStore store;
  Encoder encoder(store);
  auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  snapshot.tools.begin()->second.arrival.transit_ns.reset();
  EXPECT_TRUE(encoder.encode(snapshot, {kArrival_ns, 0}));
  int seen = 0;
  const auto frame = frame_json(store.next({})->bytes); // outlives the loop
  for (const auto &record : frame["records"]) {
    if (record["kind"] == "link") {
      EXPECT_TRUE(record["last_state_ms"].is_null());
      ++seen;
    }
    if (record["kind"] == "tool") {
      EXPECT_TRUE(record["published_ms"].is_null());
      ++seen;
    }
  }
  EXPECT_EQ(seen, 2);
}

TEST(EncoderTest, TheWorkingVolumeIsThatOfTheTrackerOrIsNotStated) {
  RecordStore store;
  Encoder encoder(store);
  auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  snapshot.health->device_count = 2;
  wire::DeviceHealth &tracker = snapshot.health->devices[0];
  (void)wire::set_name(tracker.device, "Camera");
  tracker.volume_near_mm = 1000.0;
  tracker.volume_far_mm = 3000.0;
  tracker.volume_half_width_rad = 0.5;
  tracker.volume_half_height_rad = 0.25;
  (void)wire::set_name(snapshot.health->devices[1].device, "Force");
  (void)encoder.encode(snapshot, {kArrival_ns, 0});
  int seen = 0;
  const auto frame = frame_json(store.next({})->bytes); // outlives the loop
  for (const auto &record : frame["records"]) {
    if (record["kind"] == "device" && record["device"] == "Camera") {
      EXPECT_EQ(record["volume_near_mm"], 1000.0);
      EXPECT_EQ(record["volume_far_mm"], 3000.0);
      EXPECT_EQ(record["volume_half_width_rad"], 0.5);
      EXPECT_EQ(record["volume_half_height_rad"], 0.25);
      ++seen;
    } else if (record["kind"] == "device") {
      EXPECT_TRUE(record["volume_far_mm"].is_null());
      EXPECT_TRUE(record["volume_near_mm"].is_null());
      ++seen;
    }
  }
  EXPECT_EQ(seen, 2);
}

TEST(EncoderTest, ASliceHasItsPixelsAndATipOnlyWhileThatIsLive) {
  RecordStore store;
  Encoder encoder(store);
  auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  live::Slice slice;
  (void)wire::set_name(slice.said.device, "MR");
  slice.said.published_time_ns = 1'000'000 * kMs_ns;
  slice.said.slice.columns = 2;
  slice.said.slice.rows = 2;
  slice.said.slice.T_scanner_slice = {{1, 0, 0, 0}, {4, 5, 6}};
  slice.said.tip_pixel[0] = 1.5;
  slice.pixels = {1, 2, 3, 65535};
  const auto encoded = [&](wire::PoseStatus tip, std::size_t pixels) {
    slice.said.tip_status = tip;
    slice.pixels.resize(pixels, 7);
    snapshot.slices["MR"] = slice;
    ++snapshot.slices_revision;
    (void)encoder.encode(snapshot, {kArrival_ns, 0});
    nlohmann::json out;
    store.each(RecordKind::kSlice, [&](std::span<const std::byte> record) { out = record_json(record); });
    return out;
  };
  const auto live = encoded(bregma_wire_POSE_LIVE, 4);
  EXPECT_EQ(live["pixels"], nlohmann::json::parse("[1, 2, 3, 65535]"));
  EXPECT_EQ(live["translation_mm"], nlohmann::json::parse("[4.0, 5.0, 6.0]"));
  EXPECT_TRUE(live["image_rotation"][0].is_null()) << "the scanner is not registered to the image";
  EXPECT_EQ(live["tip_pixel"][0], 1.5);
  EXPECT_EQ(live["published_ms"], 5000.0);
  const auto hidden = encoded(bregma_wire_POSE_STALE, 4);
  EXPECT_TRUE(hidden["tip_pixel"][0].is_null());
  EXPECT_TRUE(encoded(bregma_wire_POSE_LIVE, 3).is_null()) << "pixels are missing";
}

live::Received<wire::RobotTool> robot_of(wire::PoseStatus base, wire::PoseStatus scanner) {
  live::Received<wire::RobotTool> out{};
  (void)wire::set_name(out.device, "Arm");
  out.status = base;
  out.scanner_status = scanner;
  out.published_time_ns = 1'000'000 * kMs_ns;
  out.valid_for_ns = 90 * kMs_ns;
  out.T_base_tip = {{1, 0, 0, 0}, {1, 2, 3}};
  out.T_scanner_tip = {{1, 0, 0, 0}, {4, 5, 6}};
  out.scanner_error_95_mm = 0.7;
  out.arrival = {kArrival_ns, 2 * kMs_ns};
  return out;
}

TEST(RobotToolRecord, BothPosesEndWithTheirTimeWithTheDaemonAndWithTheirStatus) {
  const auto live = robot_of(bregma_wire_POSE_LIVE, bregma_wire_POSE_LIVE);
  RobotTool tool = robot_tool_record(live, true, kArrival_ns + 88 * kMs_ns - 1);
  EXPECT_EQ(tool.valid_until_ms, 5088.0);
  EXPECT_EQ(tool.tip_mm[2], 3.0);
  EXPECT_EQ(tool.scanner_tip_mm[2], 6.0);
  EXPECT_EQ(tool.scanner_error_95_mm, 0.7);
  const auto expect_over = [](const RobotTool &over) {
    EXPECT_EQ(over.status, bregma_wire_POSE_STALE);
    EXPECT_EQ(over.scanner_status, bregma_wire_POSE_STALE);
    for (const double value : {over.valid_until_ms, over.tip_mm[0], over.rotation[0], over.covariance[0],
                               over.scanner_tip_mm[0], over.scanner_covariance[0], over.scanner_error_95_mm}) {
      EXPECT_TRUE(std::isnan(value));
    }
  };
  expect_over(robot_tool_record(live, true, kArrival_ns + 88 * kMs_ns));
  expect_over(robot_tool_record(live, false, kArrival_ns));
  auto unknown = live;
  unknown.arrival.transit_ns.reset();
  expect_over(robot_tool_record(unknown, true, kArrival_ns));
  tool = robot_tool_record(robot_of(bregma_wire_POSE_LIVE, bregma_wire_POSE_NOT_REGISTERED), true, kArrival_ns);
  EXPECT_EQ(tool.tip_mm[0], 1.0);
  EXPECT_EQ(tool.scanner_status, bregma_wire_POSE_NOT_REGISTERED);
  EXPECT_TRUE(std::isnan(tool.scanner_tip_mm[0]));
  tool = robot_tool_record(robot_of(bregma_wire_POSE_STALE, bregma_wire_POSE_LIVE), true, kArrival_ns);
  EXPECT_TRUE(std::isnan(tool.tip_mm[0]) && std::isnan(tool.scanner_tip_mm[0]));
}

TEST(EncoderTest, AScannersPoseIsThatOfAValidRegistrationOfALivingDaemon) {
  RecordStore store;
  Encoder encoder(store);
  auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  wire::ScannerRegistration &scanner = snapshot.scanners["MR"];
  (void)wire::set_name(scanner.device, "MR");
  scanner.validity = bregma_wire_SCANNER_VALID;
  scanner.accepted_T_base_scanner = {{1, 0, 0, 0}, {7, 8, 9}};
  wire::set_text(scanner.next, "accept");
  scanner.coil_count = 2;
  (void)wire::set_name(scanner.coils[0].coil, "t1");
  (void)wire::set_name(scanner.coils[1].coil, "t2");
  snapshot.robot_tools["Arm"] = robot_of(bregma_wire_POSE_LIVE, bregma_wire_POSE_LIVE);
  const auto encoded = [&](std::int64_t now_ns) {
    (void)encoder.encode(snapshot, {now_ns, 0});
    nlohmann::json out;
    store.each(RecordKind::kScanner, [&](std::span<const std::byte> record) { out = record_json(record); });
    return out;
  };
  EXPECT_EQ(encoded(kArrival_ns)["accepted_translation_mm"], nlohmann::json::parse("[7.0, 8.0, 9.0]"));
  std::vector<std::string> coils, arms;
  store.each(RecordKind::kScannerCoil,
             [&](std::span<const std::byte> record) { coils.push_back(record_json(record)["coil"]); });
  store.each(RecordKind::kRobotTool,
             [&](std::span<const std::byte> record) { arms.push_back(record_json(record)["device"]); });
  EXPECT_EQ(coils, (std::vector<std::string>{"t1", "t2"}));
  EXPECT_EQ(arms, std::vector<std::string>{"Arm"});
  scanner.validity = bregma_wire_SCANNER_TABLE_MOVED;
  EXPECT_TRUE(encoded(kArrival_ns)["accepted_translation_mm"][0].is_null());
  scanner.validity = bregma_wire_SCANNER_VALID;
  const auto silent = encoded(kArrival_ns + live::kDaemonSilent_ns + kMs_ns);
  EXPECT_TRUE(silent["accepted_translation_mm"][0].is_null());
  EXPECT_EQ(silent["validity"], 0);
  EXPECT_EQ(silent["next"], "");
}

TEST(EncoderTest, WhatIsGoneEnds) {
  RecordStore store;
  Encoder encoder(store);
  auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  wire::CapturedPoint point{};
  (void)wire::set_name(point.tool, "Pointer");
  snapshot.captures["Pointer"] = {point, point};
  snapshot.captures_revision = 1;
  (void)encoder.encode(snapshot, {kArrival_ns, 0});
  const auto first = store.next({});
  snapshot.tools.clear();
  snapshot.captures["Pointer"].pop_back();
  snapshot.captures_revision = 2;
  EXPECT_TRUE(encoder.encode(snapshot, {kArrival_ns + kMs_ns, 0}));
  const auto records = frame_json(store.next({.after = first->up_to})->bytes)["records"];
  ASSERT_EQ(records.size(), 2U);
  EXPECT_EQ(records[0], nlohmann::json::parse(R"({"kind": "tool", "ended": true, "tool": "Probe"})"));
  EXPECT_EQ(records[1],
            nlohmann::json::parse(R"({"kind": "capture", "ended": true, "tool": "Pointer", "ordinal": 1.0})"));
}

TEST(EncoderTest, ASilentDaemonIsNamedAndItsSessionIsNotCurrent) {
  RecordStore store;
  Encoder encoder(store);
  const auto snapshot = snapshot_with(state_of(bregma_wire_POSE_LIVE));
  (void)encoder.encode(snapshot, {kArrival_ns, 0});
  const auto first = store.next({});
  (void)encoder.encode(snapshot, {kArrival_ns + live::kDaemonSilent_ns, 0});
  const auto records = frame_json(store.next({.after = first->up_to})->bytes)["records"];
  bool seen = false;
  for (const auto &record : records) {
    if (record["kind"] == "link") {
      EXPECT_EQ(record["presence"], 1);
      EXPECT_EQ(record["text"], "bregmad is silent");
      seen = true;
    } else if (record["kind"] == "session") {
      EXPECT_EQ(record["session"], bregma_wire_SESSION_UNKNOWN);
    }
  }
  EXPECT_TRUE(seen);
}

} // namespace
} // namespace bregma::gateway
