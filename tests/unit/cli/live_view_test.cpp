// The parts of a daemon's state that are shown as current.
#include <cmath>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "clients/cli/live_view.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/prediction_view.hpp"
#include "clients/cli/wire_labels.hpp"

namespace {

using namespace bregma;
using namespace bregma::cli;

constexpr std::int64_t kNow_ns = 1'700'000'000'000'000'000;
constexpr std::int64_t kMs = 1'000'000;

Snapshot navigating() {
  Snapshot out;
  out.health = wire::SystemHealth{};
  out.health->time_ns = kNow_ns - 300 * kMs;
  out.health->session = bregma_wire_SESSION_NAVIGATING;
  wire::NavigationState state{};
  EXPECT_TRUE(wire::set_name(state.tool, "Probe"));
  EXPECT_TRUE(wire::set_name(state.trajectory, "Biopsy"));
  EXPECT_TRUE(wire::set_name(state.nearest_structure, "Heschl_L"));
  state.status = bregma_wire_POSE_LIVE;
  state.acquired_time_ns = kNow_ns - 12 * kMs;
  state.published_time_ns = kNow_ns - 8 * kMs;
  state.T_image_tip = {{1, 0, 0, 0}, {11.5, -22.25, 33.0}};
  state.tre_rms_mm = 0.71;
  state.tre_95.semi_axes_mm[0] = 1.43;
  state.distance_to_target_mm = 27.5;
  state.lateral_deviation_mm = 0.62;
  state.remaining_depth_mm = 27.4;
  state.nearest_structure_mm = 6.3;
  out.tools["Probe"] = state;
  out.registration = wire::RegistrationState{};
  out.registration->status = bregma_wire_REGISTRATION_ACCEPTED;
  out.registration->fre_mm = 0.55;
  return out;
}

bool has(const std::string &text, std::string_view what) { return text.find(what) != std::string::npos; }

TEST(LiveView, ALivePoseIsShownWithItsPresentAge) {
  const auto snapshot = navigating();
  const auto view = view_tool(snapshot.tools.at("Probe"), view_daemon(snapshot, kNow_ns), kNow_ns);
  EXPECT_TRUE(view.fresh);
  EXPECT_EQ(view.status, "live");
  EXPECT_NEAR(view.age_ms, 12.0, 1e-3) << "since exposure, not since publication";
  EXPECT_EQ(view.tip_mm[1], -22.25);
  const std::string table = watch_table(snapshot, {}, kNow_ns);
  for (const char *shown : {"Probe", "live", "11.5 -22.2 33.0", "1.43", "27.5", "0.62", "Heschl_L 6.3"}) {
    EXPECT_TRUE(has(table, shown)) << shown << "\n" << table;
  }
}

TEST(LiveView, NothingOfASilentDaemonIsShownAsCurrent) {
  const auto snapshot = navigating();
  const std::int64_t later_ns = kNow_ns + 4'000 * kMs;
  for (const auto &text : {watch_table(snapshot, {}, later_ns), watch_line(snapshot, {}, later_ns),
                           watch_json(snapshot, {}, later_ns).dump()}) {
    EXPECT_FALSE(has(text, "11.5")) << text;
    EXPECT_FALSE(has(text, "1.43")) << text;
    EXPECT_FALSE(has(text, "27.5")) << text;
    EXPECT_FALSE(has(text, "live,")) << text;
  }
  EXPECT_TRUE(has(watch_line(snapshot, {}, later_ns), "SILENT for 4.3 s"));
  EXPECT_TRUE(has(status_text(snapshot, 0, later_ns), "NOT CURRENT"));
  const auto json = watch_json(snapshot, {}, later_ns);
  EXPECT_FALSE(json["daemon_alive"]);
  EXPECT_TRUE(json["session"].is_null());
  EXPECT_TRUE(json["tools"][0]["tip_mm"][0].is_null());
}

TEST(LiveView, AToolWithoutSamplesIsOldEvenWhenTheDaemonIsAlive) {
  auto snapshot = navigating();
  snapshot.tools["Probe"].published_time_ns = kNow_ns - kToolSilent_ns;
  const auto view = view_tool(snapshot.tools["Probe"], view_daemon(snapshot, kNow_ns), kNow_ns);
  EXPECT_FALSE(view.fresh);
  EXPECT_EQ(view.status, "no data for 500 ms");
  EXPECT_TRUE(std::isnan(view.tip_mm[0]));
  EXPECT_TRUE(std::isnan(view.tre_95_mm));
}

TEST(LiveView, FiguresOfEveryStatusButTwoAreDashes) {
  for (int status = 0; status <= bregma_wire_POSE_IMPLAUSIBLE; ++status) {
    auto snapshot = navigating();
    snapshot.tools["Probe"].status = static_cast<wire::PoseStatus>(status);
    const bool shown = status == bregma_wire_POSE_LIVE || status == bregma_wire_POSE_UNVERIFIED;
    EXPECT_EQ(has(watch_table(snapshot, {}, kNow_ns), "11.5"), shown)
        << pose_label(static_cast<wire::PoseStatus>(status));
  }
}

wire::DeformationState indentation() {
  wire::DeformationState state{};
  EXPECT_TRUE(wire::set_name(state.point, "Deep"));
  state.time_ns = kNow_ns - 20 * kMs;
  state.kind = bregma_wire_FOLLOWED_TARGET;
  state.status = bregma_wire_DEFORMATION_VALID;
  state.reason = bregma_wire_DEFORMATION_REASON_NONE;
  state.phase = bregma_wire_PROBE_INDENTATION;
  state.imaged_mm[0] = 10.0;
  state.displaced_mm[0] = 10.3;
  state.displaced_mm[1] = 0.4;
  state.error_bound_mm = 0.11;
  state.tip_force_N = 0.083;
  state.depth_mm = 3.7;
  return state;
}

TEST(LiveView, ThePredictedAndTheImagedTargetAreBothShown) {
  auto snapshot = navigating();
  snapshot.tools["Probe"].distance_to_predicted_target_mm = 27.9;
  snapshot.deformation["Deep"] = indentation();
  const std::string table = watch_table(snapshot, {}, kNow_ns);
  for (const char *shown : {"27.5", "27.9", "Deep: valid; predicted 0.50 mm from where it was imaged, +/- 0.11 mm",
                            "indentation, tip 0.083 N", "depth 3.7 mm"}) {
    EXPECT_TRUE(has(table, shown)) << shown << "\n" << table;
  }
  const auto json = status_json(snapshot, 0, kNow_ns);
  EXPECT_NEAR(json["deformation"]["Deep"]["motion_mm"].get<double>(), 0.5, 1e-12);
  EXPECT_EQ(json["deformation"]["Deep"]["kind"], "target");
  snapshot.deformation["Deep"].kind = bregma_wire_FOLLOWED_LANDMARK;
  EXPECT_TRUE(has(watch_table(snapshot, {}, kNow_ns), "Deep (landmark): valid; predicted 0.50 mm"));
  EXPECT_EQ(json["tools"][0]["distance_to_predicted_target_mm"], 27.9);
}

TEST(LiveView, AnInvalidOrOldPredictionHasNoFigures) {
  const auto daemon = view_daemon(navigating(), kNow_ns);
  wire::DeformationState state = indentation();
  state.status = bregma_wire_DEFORMATION_INVALID;
  state.reason = bregma_wire_DEFORMATION_REASON_TOO_SLOW;
  const auto invalid = view_prediction(state, daemon, kNow_ns);
  EXPECT_EQ(prediction_line(invalid), "Deep: invalid (too slow)");
  EXPECT_TRUE(prediction_json(invalid)["motion_mm"].is_null());
  const auto old = view_prediction(indentation(), daemon, kNow_ns + kToolSilent_ns);
  EXPECT_FALSE(old.fresh);
  EXPECT_TRUE(std::isnan(old.motion_mm) && std::isnan(old.predicted_mm[0]));
  EXPECT_EQ(old.imaged_mm[0], 10.0) << "where it was imaged stays known";
  EXPECT_TRUE(has(prediction_line(old), "no data for")) << prediction_line(old);
  const auto silent = view_prediction(indentation(), view_daemon({}, kNow_ns), kNow_ns);
  EXPECT_EQ(prediction_line(silent), "Deep: daemon silent");
}

TEST(LiveView, FiducialConsistencyIsNeverCalledAccuracy) {
  const auto snapshot = navigating();
  for (const auto &text : {watch_table(snapshot, {}, kNow_ns), status_text(snapshot, 0, kNow_ns)}) {
    const auto at = text.find("0.55 mm");
    ASSERT_NE(at, std::string::npos) << text;
    EXPECT_TRUE(has(text.substr(at, 80), "not")) << text;
  }
  EXPECT_TRUE(status_json(snapshot, 0, kNow_ns)["registration"].contains("fiducial_consistency_fre_mm"));
}

TEST(LiveView, StatusCountsWhatWasRejectedByReason) {
  auto snapshot = navigating();
  auto &health = *snapshot.health;
  health.device_count = 1;
  ASSERT_TRUE(wire::set_name(health.devices[0].device, "Tracker"));
  health.devices[0].status = bregma_wire_DEVICE_LIVE;
  health.devices[0].age_ms = 4.0;
  health.devices[0].rejected[bregma_wire_REJECT_NOT_A_ROTATION] = 3;
  health.devices[0].rejected[bregma_wire_REJECT_DUPLICATE] = 2;
  const std::string text = status_text(snapshot, 7, kNow_ns);
  EXPECT_TRUE(has(text, "bregmad on domain 7: navigating")) << text;
  EXPECT_TRUE(has(text, "Tracker rejected 3: not a rotation")) << text;
  EXPECT_TRUE(has(text, "Tracker rejected 2: duplicate")) << text;
  const auto device = status_json(snapshot, 7, kNow_ns)["devices"][0];
  EXPECT_EQ(device["rejected"], 5);
  EXPECT_NEAR(device["age_ms"].get<double>(), 304.0, 1e-6) << "its age has grown since the daemon stated it";
}

TEST(LiveView, StatusShowsWhatTheDriversSay) {
  auto snapshot = navigating();
  wire::DriverHealth driver{};
  driver.time_ns = kNow_ns - 400 * kMs;
  driver.state = bregma_wire_DRIVER_WAITING;
  driver.published = 1200;
  driver.skipped = 7;
  driver.failures = 3;
  wire::set_text(driver.failure, "tcp://10.0.0.9:4000: Connection refused");
  snapshot.drivers["Force"] = driver;
  const std::string text = status_text(snapshot, 7, kNow_ns);
  EXPECT_TRUE(has(text, "Force   waiting")) << text;
  EXPECT_TRUE(has(text, "Force, latest failure: tcp://10.0.0.9:4000: Connection refused\n")) << text;
  const auto json = status_json(snapshot, 7, kNow_ns)["drivers"][0];
  EXPECT_EQ(json["device"], "Force");
  EXPECT_EQ(json["unreadable"], 7);
  EXPECT_EQ(status_json(snapshot, 7, kNow_ns + 5000 * kMs)["drivers"][0]["state"], "silent");
}

TEST(LiveView, CountsBeyondTheWiresArraysAreNotFollowed) {
  auto snapshot = navigating();
  snapshot.health->device_count = 4'000'000'000U;
  snapshot.health->loop_count = 4'000'000'000U;
  snapshot.accuracy = wire::AccuracyState{};
  snapshot.accuracy->target_count = 4'000'000'000U;
  EXPECT_EQ(status_json(snapshot, 0, kNow_ns)["devices"].size(), std::size_t{bregma_wire_MAX_DEVICES});
}

TEST(LiveView, ActiveAlarmsAreListedMostSevereFirst) {
  auto snapshot = navigating();
  const auto add = [&](const char *kind, wire::AlarmState state, wire::AlarmSeverity severity) {
    wire::Alarm alarm{};
    EXPECT_TRUE(wire::set_name(alarm.kind, kind));
    alarm.state = state;
    alarm.severity = severity;
    alarm.raised_time_ns = kNow_ns - 1'500 * kMs;
    wire::set_text(alarm.text, "moved\x1b[2J");
    snapshot.alarms[{kind, ""}] = alarm;
  };
  add("latency", bregma_wire_ALARM_RAISED, bregma_wire_SEVERITY_WARNING);
  add("visibility", bregma_wire_ALARM_CLEARED, bregma_wire_SEVERITY_CRITICAL);
  add("drift", bregma_wire_ALARM_ACKNOWLEDGED, bregma_wire_SEVERITY_CRITICAL);
  const auto alarms = standing_alarms(snapshot);
  ASSERT_EQ(alarms.size(), 2U);
  EXPECT_EQ(wire::view(alarms[0].kind), "drift");
  EXPECT_EQ(alarm_line(alarms[0], kNow_ns), "critical: drift (acknowledged, raised 1.5 s ago): moved?[2J")
      << "control characters do not reach the terminal";
}

TEST(LiveView, ValueThatTheWireDoesNotDefineIsInvalid) {
  EXPECT_EQ(pose_label(15), "not known here");
  EXPECT_EQ(pose_label(-1), "not known here");
  EXPECT_EQ(pose_label(0), "unknown");
  EXPECT_EQ(alarm_label(4), "not known here");
}

TEST(PlainText, DurationsAreSaidAsAPersonSaysThem) {
  EXPECT_EQ(duration_text(0.0123), "12 ms");
  EXPECT_EQ(duration_text(12.34), "12.3 s");
  EXPECT_EQ(duration_text(302.4), "5 min 2 s");
  EXPECT_EQ(duration_text(59.97), "1 min 0 s");
  EXPECT_EQ(duration_text(12'000), "3 h 20 min");
  EXPECT_EQ(duration_text(std::nan("")), "-");
}

} // namespace
