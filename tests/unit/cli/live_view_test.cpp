// The parts of a daemon's state that are shown as current.
#include <algorithm>
#include <cmath>
#include <tuple>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "clients/cli/live_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/prediction_view.hpp"
#include "clients/cli/wire_labels.hpp"
#include "idl/names.hpp"

namespace {

using namespace bregma;
using namespace bregma::cli;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kBoot_ns = 50'000'000 * kMs;            // this host's boot clock
constexpr std::int64_t kUtc_ns = 1'700'000'000'000'000'000;    // and its wall clock
constexpr std::int64_t kDaemon_ns = kUtc_ns + 3'600'000 * kMs; // the daemon's clock, an hour ahead
constexpr live::Now kNow{kBoot_ns, kUtc_ns};

live::Now after(std::int64_t ms) { return {kBoot_ns + ms * kMs, kUtc_ns + ms * kMs}; }

// Published 8 ms ago by a daemon on this host, of an exposure 12 ms ago.
live::Snapshot navigating() {
  live::Snapshot out;
  out.health.emplace();
  out.health->arrival = {kBoot_ns - 300 * kMs, 0};
  out.health->session = bregma_wire_SESSION_NAVIGATING;
  out.daemon_clock_ns = kDaemon_ns - kBoot_ns;
  live::Received<wire::NavigationState> state{};
  EXPECT_TRUE(wire::set_name(state.tool, "Probe"));
  EXPECT_TRUE(wire::set_name(state.trajectory, "Biopsy"));
  EXPECT_TRUE(wire::set_name(state.nearest_structure, "Heschl_L"));
  state.status = bregma_wire_POSE_LIVE;
  state.published_time_ns = kDaemon_ns - 8 * kMs;
  state.acquired_time_ns = kDaemon_ns - 12 * kMs;
  state.age_ns = 4 * kMs;
  state.valid_for_ns = 96 * kMs;
  state.arrival = {kBoot_ns - 7 * kMs, 1 * kMs};
  state.T_image_tip = {{1, 0, 0, 0}, {11.5, -22.25, 33.0}};
  state.tre_rms_mm = 0.71;
  state.tre_95.semi_axes_mm[0] = 1.43;
  state.acceleration_sigma_mm_s2 = wire::kUnknown;
  state.distance_to_target_mm = 27.5;
  state.lateral_deviation_mm = 0.62;
  state.remaining_depth_mm = 27.4;
  state.nearest_structure_mm = 6.3;
  state.nearest_structure_sigma_mm = 0.42;
  out.tools["Probe"] = state;
  out.registration = wire::RegistrationState{};
  out.registration->status = bregma_wire_REGISTRATION_ACCEPTED;
  out.registration->fre_mm = 0.55;
  return out;
}

bool has(const std::string &text, std::string_view what) { return text.find(what) != std::string::npos; }

TEST(LiveView, ALivePoseIsShownWithItsPresentAge) {
  const auto snapshot = navigating();
  const auto view = view_tool(snapshot.tools.at("Probe"), view_daemon(snapshot, kNow), kNow);
  EXPECT_TRUE(view.fresh);
  EXPECT_EQ(view.status, "live");
  EXPECT_NEAR(view.age_ms, 12.0, 1e-3) << "since exposure, not since publication";
  EXPECT_EQ(view.tip_mm[1], -22.25);
  const std::string table = watch_table(snapshot, {}, kNow);
  for (const char *shown : {"Probe", "live", "11.5 -22.2 33.0", "1.43", "27.5", "0.62", "Heschl_L 6.3"}) {
    EXPECT_TRUE(has(table, shown)) << shown << "\n" << table;
  }
}

std::size_t widest_line(const std::string &text) {
  std::size_t widest = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    widest = std::max(widest, end - begin);
    begin = end + 1;
  }
  return widest;
}

TEST(LiveView, TheTableFitsInto80Columns) {
  auto snapshot = navigating();
  snapshot.tools["Reference pointer"] = snapshot.tools["Probe"];
  const std::string table = watch_table(snapshot, {}, kNow);
  EXPECT_LE(widest_line(table), 80U) << table;
}

TEST(LiveView, TheTableStatesTheStepItsCountsAndWhyAPoseIsNotLive) {
  auto snapshot = navigating();
  snapshot.health->session = bregma_wire_SESSION_REGISTERING;
  snapshot.registration->fiducial_count = 5;
  snapshot.registration->surface_count = 43;
  snapshot.tools["Probe"].status = bregma_wire_POSE_NOT_CALIBRATED;
  const std::string table = watch_table(snapshot, {}, kNow);
  EXPECT_TRUE(has(table, "Session registering, 5 fiducials, 43 surface points")) << table;
  EXPECT_TRUE(has(table, "Not live: Probe: its tip is not known: calibrate it by a pivot")) << table;
  EXPECT_TRUE(has(watch_line(snapshot, {}, kNow), "registering, 5 fiducials, 43 surface points"));
}

TEST(LiveView, ALongLineContinuesIndentedAndLosesNothing) {
  const std::string text = "warning: disk session (raised, raised 3 s ago): the disk has not answered for 2 s\nnext";
  const std::string out = wrapped(text, 40);
  EXPECT_LE(widest_line(out), 40U) << out;
  EXPECT_EQ(out, "warning: disk session (raised, raised 3\n    s ago): the disk has not answered\n    for 2 s\nnext");
  EXPECT_EQ(widest_line(wrapped(std::string(100, 'x'), 40)), 40U) << "a word that does not fit is broken";
}

TEST(LiveView, NothingOfASilentDaemonIsShownAsCurrent) {
  const auto snapshot = navigating();
  const live::Now later = after(4'000);
  for (const auto &text :
       {watch_table(snapshot, {}, later), watch_line(snapshot, {}, later), watch_json(snapshot, {}, later).dump()}) {
    EXPECT_FALSE(has(text, "11.5")) << text;
    EXPECT_FALSE(has(text, "1.43")) << text;
    EXPECT_FALSE(has(text, "27.5")) << text;
    EXPECT_FALSE(has(text, "live,")) << text;
  }
  EXPECT_TRUE(has(watch_line(snapshot, {}, later), "SILENT for 4.3 s"));
  EXPECT_TRUE(has(status_text(snapshot, 0, later), "NOT CURRENT"));
  const auto json = watch_json(snapshot, {}, later);
  EXPECT_FALSE(json["daemon_alive"]);
  EXPECT_TRUE(json["session"].is_null());
  EXPECT_TRUE(json["tools"][0]["tip_mm"][0].is_null());
}

TEST(LiveView, APoseEndsWithItsTimeAndItsErrorGrowsUntilThen) {
  auto snapshot = navigating();
  auto &state = snapshot.tools["Probe"];
  std::fill_n(state.tre_95.semi_axes_mm, 3, 1.0);
  for (std::size_t i = 0; i < 3; ++i) {
    state.tre_95.axes[4 * i] = 1.0;
    state.velocity_covariance_mm2_s2[4 * i] = 400.0;
  }
  state.acceleration_sigma_mm_s2 = 1'000.0;
  const auto seen = [&](std::int64_t ms) {
    const live::Now now = after(ms);
    return view_tool(state, view_daemon(snapshot, now), now);
  };
  double last_95_mm = 1.0;
  for (std::int64_t ms = 0; ms < 88; ++ms) {
    const auto view = seen(ms);
    ASSERT_TRUE(view.fresh) << ms;
    EXPECT_NEAR(view.age_ms, 12.0 + static_cast<double>(ms), 1e-9);
    EXPECT_NEAR(view.remaining_ms, 88.0 - static_cast<double>(ms), 1e-9);
    EXPECT_GT(view.tre_95_mm, last_95_mm);
    last_95_mm = view.tre_95_mm;
  }
  EXPECT_GT(last_95_mm, 5.0) << "20 mm/s and 1 m/s^2 for 95 ms";
  for (const std::int64_t ms : {88, 89, 1'500}) {
    const auto view = seen(ms);
    EXPECT_FALSE(view.fresh) << ms;
    EXPECT_TRUE(std::isnan(view.tip_mm[0]) && std::isnan(view.tre_95_mm)) << ms;
    EXPECT_EQ(view.status, ms < 492 ? "too old" : "no data for 1.5 s");
  }
}

TEST(LiveView, APoseWhoseAgeIsNotKnownOrNegativeIsNotShown) {
  auto snapshot = navigating();
  const auto status = [&] { return view_tool(snapshot.tools["Probe"], view_daemon(snapshot, kNow), kNow).status; };
  auto &state = snapshot.tools["Probe"];
  state.arrival.transit_ns.reset();
  EXPECT_EQ(status(), "age not known");
  state.arrival.transit_ns = 1 * kMs;
  state.age_ns = -29'986 * kMs;
  EXPECT_EQ(status(), "age not known");
  state.age_ns = 4 * kMs;
  EXPECT_EQ(status(), "live");
  state.T_image_tip.translation_mm[0] = std::nan("");
  EXPECT_EQ(status(), "not usable");
}

TEST(LiveView, ImplausibleDataAreNotShownAndTheReasonIs) {
  auto snapshot = navigating();
  auto &state = snapshot.tools["Probe"];
  state.plausibility = bregma_wire_PLAUSIBILITY_INFLATED;
  state.plausibility_reason = bregma_wire_IMPLAUSIBLE_RESIDUAL;
  EXPECT_TRUE(has(watch_line(snapshot, {}, kNow), "Probe live (marker residual), tip 11.5"));
  state.plausibility = bregma_wire_PLAUSIBILITY_REFUSED;
  state.plausibility_reason = bregma_wire_IMPLAUSIBLE_FROZEN;
  EXPECT_EQ(view_tool(state, view_daemon(snapshot, kNow), kNow).status, "not usable (frozen)");
  EXPECT_FALSE(has(watch_line(snapshot, {}, kNow), "11.5"));
}

TEST(LiveView, ADaemonThatDdsHasLostIsSilentAtOnce) {
  auto snapshot = navigating();
  EXPECT_EQ(view_daemon(snapshot, kNow).presence, Presence::kAlive);
  snapshot.no_writer = true;
  EXPECT_EQ(view_daemon(snapshot, kNow).presence, Presence::kSilent);
  EXPECT_FALSE(watch_json(snapshot, {}, kNow)["tools"][0]["fresh"].get<bool>());
}

TEST(LiveView, FiguresOfEveryStatusButTwoAreDashes) {
  for (int status = 0; status <= bregma_wire_POSE_IMPLAUSIBLE; ++status) {
    auto snapshot = navigating();
    snapshot.tools["Probe"].status = static_cast<wire::PoseStatus>(status);
    const bool shown = status == bregma_wire_POSE_LIVE || status == bregma_wire_POSE_UNVERIFIED;
    EXPECT_EQ(has(watch_table(snapshot, {}, kNow), "11.5"), shown) << pose_label(static_cast<wire::PoseStatus>(status));
  }
}

live::Received<wire::DeformationState> indentation() {
  live::Received<wire::DeformationState> state{};
  EXPECT_TRUE(wire::set_name(state.point, "Deep"));
  state.time_ns = kDaemon_ns - 20 * kMs;
  state.arrival.boot_ns = kBoot_ns - 20 * kMs;
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
  const std::string table = watch_table(snapshot, {}, kNow);
  for (const char *shown : {"27.5", "27.9", "Deep: valid; predicted 0.50 mm from where it was imaged, +/- 0.11 mm",
                            "indentation, tip 0.083 N", "depth 3.7 mm"}) {
    EXPECT_TRUE(has(table, shown)) << shown << "\n" << table;
  }
  const auto json = status_json(snapshot, 0, kNow);
  EXPECT_NEAR(json["deformation"]["Deep"]["motion_mm"].get<double>(), 0.5, 1e-12);
  EXPECT_EQ(json["deformation"]["Deep"]["kind"], "target");
  snapshot.deformation["Deep"].kind = bregma_wire_FOLLOWED_LANDMARK;
  EXPECT_TRUE(has(watch_table(snapshot, {}, kNow), "Deep (landmark): valid; predicted 0.50 mm"));
  EXPECT_EQ(json["tools"][0]["distance_to_predicted_target_mm"], 27.9);
}

TEST(LiveView, AnInvalidOrOldPredictionHasNoFigures) {
  const auto daemon = view_daemon(navigating(), kNow);
  live::Received<wire::DeformationState> state = indentation();
  state.status = bregma_wire_DEFORMATION_INVALID;
  state.reason = bregma_wire_DEFORMATION_REASON_TOO_SLOW;
  const auto invalid = view_prediction(state, daemon, kNow);
  EXPECT_EQ(prediction_line(invalid), "Deep: invalid (too slow)");
  EXPECT_TRUE(prediction_json(invalid)["motion_mm"].is_null());
  const auto old = view_prediction(indentation(), daemon, after(500));
  EXPECT_FALSE(old.fresh);
  EXPECT_TRUE(std::isnan(old.motion_mm) && std::isnan(old.predicted_mm[0]));
  EXPECT_EQ(old.imaged_mm[0], 10.0) << "where it was imaged stays known";
  EXPECT_TRUE(has(prediction_line(old), "no data for")) << prediction_line(old);
  auto late = indentation();
  late.time_ns = kDaemon_ns - 600 * kMs;
  EXPECT_EQ(view_prediction(late, daemon, kNow).status, "no data for 600 ms") << "received late, as by a late client";
  const auto silent = view_prediction(indentation(), view_daemon({}, kNow), kNow);
  EXPECT_EQ(prediction_line(silent), "Deep: daemon silent");
}

TEST(LiveView, FiducialConsistencyIsNeverCalledAccuracy) {
  const auto snapshot = navigating();
  for (const auto &text : {watch_table(snapshot, {}, kNow), status_text(snapshot, 0, kNow)}) {
    const auto at = text.find("0.55 mm");
    ASSERT_NE(at, std::string::npos) << text;
    EXPECT_TRUE(has(text.substr(at, 80), "not")) << text;
  }
  EXPECT_TRUE(status_json(snapshot, 0, kNow)["registration"].contains("fiducial_consistency_fre_mm"));
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
  const std::string text = status_text(snapshot, 7, kNow);
  EXPECT_TRUE(has(text, "bregmad on domain 7: navigating")) << text;
  EXPECT_TRUE(has(text, "Tracker rejected 3: not a rotation")) << text;
  EXPECT_TRUE(has(text, "Tracker rejected 2: duplicate")) << text;
  const auto device = status_json(snapshot, 7, kNow)["devices"][0];
  EXPECT_EQ(device["rejected"], 5);
  EXPECT_NEAR(device["age_ms"].get<double>(), 304.0, 1e-6) << "its age has grown since the daemon stated it";
}

TEST(LiveView, StatusStatesTheHoursOfRecordingThatAreLeft) {
  auto snapshot = navigating();
  EXPECT_FALSE(has(status_text(snapshot, 0, kNow), "hours of recording")) << "nothing is recorded";
  EXPECT_TRUE(status_json(snapshot, 0, kNow)["recorder"]["hours_left"].is_null());
  snapshot.health->recording_free_bytes = 43'200'000'000;
  snapshot.health->recording_bytes_per_s = 1.2e6;
  const std::string text = status_text(snapshot, 0, kNow);
  EXPECT_TRUE(has(text, "43.2 GB free: 10.0 hours of recording at 1.2 MB/s")) << text;
  const auto recorder = status_json(snapshot, 0, kNow)["recorder"];
  EXPECT_NEAR(recorder["hours_left"].get<double>(), 10.0, 1e-12);
  EXPECT_EQ(recorder["free_bytes"], 43'200'000'000);
}

TEST(LiveView, StatusShowsWhatTheDriversSay) {
  auto snapshot = navigating();
  live::Received<wire::DriverHealth> driver{};
  driver.arrival.boot_ns = kBoot_ns - 400 * kMs;
  driver.state = bregma_wire_DRIVER_WAITING;
  driver.published = 1200;
  driver.skipped = 7;
  driver.failures = 3;
  wire::set_text(driver.failure, "tcp://10.0.0.9:4000: Connection refused");
  snapshot.drivers["Force"] = driver;
  const std::string text = status_text(snapshot, 7, kNow);
  EXPECT_TRUE(has(text, "Force   waiting")) << text;
  EXPECT_TRUE(has(text, "Force, latest failure: tcp://10.0.0.9:4000: Connection refused\n")) << text;
  const auto json = status_json(snapshot, 7, kNow)["drivers"][0];
  EXPECT_EQ(json["device"], "Force");
  EXPECT_EQ(json["unreadable"], 7);
  EXPECT_EQ(status_json(snapshot, 7, after(5000))["drivers"][0]["state"], "silent");
}

TEST(LiveView, ErrorsOfOtherImagesAreStatedApart) {
  auto snapshot = navigating();
  EXPECT_TRUE(has(watch_line(snapshot, {}, kNow), "nearest Heschl_L 6.3 mm (1 sigma 0.42 mm)"));
  EXPECT_EQ(watch_json(snapshot, {}, kNow)["tools"][0]["nearest_structure_sigma_mm"], 0.42);
  snapshot.tools["Probe"].nearest_structure_sigma_mm = 0.0; // of a daemon that does not state it
  EXPECT_TRUE(has(watch_line(snapshot, {}, kNow), "nearest Heschl_L 6.3 mm"));
  EXPECT_FALSE(has(watch_line(snapshot, {}, kNow), "sigma"));
  EXPECT_TRUE(watch_json(snapshot, {}, kNow)["tools"][0]["nearest_structure_sigma_mm"].is_null());

  snapshot.accuracy = wire::AccuracyState{};
  snapshot.accuracy->target_count = 2;
  for (const auto &[index, name, image_mm] : {std::tuple{0, "Deep", 0.0}, {1, "Cyst", 0.37}}) {
    EXPECT_TRUE(wire::set_name(snapshot.accuracy->targets[index].target, name));
    snapshot.accuracy->targets[index].tre_rms_mm = 0.9;
    snapshot.accuracy->targets[index].image_rms_mm = image_mm;
  }
  const std::string text = status_text(snapshot, 0, kNow);
  EXPECT_TRUE(has(text, "Of it from image mm")) << text;
  EXPECT_TRUE(has(text, "0.37")) << text;
  EXPECT_EQ(status_json(snapshot, 0, kNow)["accuracy"]["targets"][1]["image_rms_mm"], 0.37);
}

TEST(LiveView, CountsBeyondTheWiresArraysAreNotFollowed) {
  auto snapshot = navigating();
  snapshot.health->device_count = 4'000'000'000U;
  snapshot.health->loop_count = 4'000'000'000U;
  snapshot.accuracy = wire::AccuracyState{};
  snapshot.accuracy->target_count = 4'000'000'000U;
  EXPECT_EQ(status_json(snapshot, 0, kNow)["devices"].size(), std::size_t{bregma_wire_MAX_DEVICES});
}

TEST(LiveView, ActiveAlarmsAreListedMostSevereFirst) {
  auto snapshot = navigating();
  const auto add = [&](const char *kind, wire::AlarmState state, wire::AlarmSeverity severity) {
    wire::Alarm alarm{};
    EXPECT_TRUE(wire::set_name(alarm.kind, kind));
    alarm.state = state;
    alarm.severity = severity;
    alarm.raised_time_ns = kDaemon_ns - 1'500 * kMs;
    wire::set_text(alarm.text, "moved\x1b[2J");
    snapshot.alarms[{kind, ""}] = alarm;
  };
  add("latency", bregma_wire_ALARM_RAISED, bregma_wire_SEVERITY_WARNING);
  add("visibility", bregma_wire_ALARM_CLEARED, bregma_wire_SEVERITY_CRITICAL);
  add("drift", bregma_wire_ALARM_ACKNOWLEDGED, bregma_wire_SEVERITY_CRITICAL);
  const auto alarms = standing_alarms(snapshot);
  ASSERT_EQ(alarms.size(), 2U);
  EXPECT_EQ(wire::view(alarms[0].kind), "drift");
  EXPECT_EQ(alarm_line(alarms[0], live::daemon_now_ns(snapshot, kBoot_ns)),
            "critical: drift (acknowledged, raised 1.5 s ago): moved?[2J")
      << "control characters do not reach the terminal";
}

TEST(LiveView, ValueThatTheWireDoesNotDefineIsInvalid) {
  EXPECT_EQ(pose_label(15), "not known here");
  EXPECT_EQ(pose_label(-1), "not known here");
  EXPECT_EQ(pose_label(0), "unknown");
  EXPECT_EQ(alarm_label(4), "not known here");
}

TEST(PlainText, NothingThatControlsATerminalIsPrinted) {
  EXPECT_EQ(printable("Stylus 3 \xC3\xA9\xE2\x82\xAC"), "Stylus 3 \xC3\xA9\xE2\x82\xAC") << "UTF-8 stays";
  EXPECT_EQ(printable("a\x1b[2Jb\nc\x7f"), "a?[2Jb?c?");
  EXPECT_EQ(printable("a\xC2\x9B"
                      "2Jb"),
            "a?2Jb")
      << "CSI as one character of C1";
  EXPECT_EQ(printable("a\x9B"
                      "b\xFF\xC3"),
            "a?b??")
      << "not UTF-8";
  EXPECT_EQ(json_text({{"name", "a\xC2\x9B"
                                "b\x1b\x7f"}}),
            "{\"name\":\"a\\u009bb\\u001b\\u007f\"}");
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
