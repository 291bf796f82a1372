// The figures of `bregma report` for session files with known results.
#include <cmath>
#include <fstream>

#include "casefile/markups.hpp"
#include "casefile/mesh_file.hpp"
#include "clients/cli/report/judgement.hpp"
#include "clients/cli/report/path_analysis.hpp"
#include "clients/cli/report/session_analysis.hpp"
#include "clients/cli/report/summary.hpp"
#include "clients/cli/report/tip_analysis.hpp"
#include "idl/commands.hpp"
#include "tests/unit/cli/report_session_maker.hpp"

#include <nlohmann/json.hpp>

namespace {

using namespace bregma;
using cli::report::analyse;
using cli::report::SessionAnalysis;
using test::kMs;
using test::kStart_ns;

class Report : public testing::Test {
protected:
  using Fill = std::function<void(casefile::SessionWriter &)>;

  base::Result<SessionAnalysis> analysed(const Fill &fill) {
    {
      auto writer = casefile::SessionWriter::create(file_);
      EXPECT_TRUE(writer.has_value()) << writer.error().message;
      fill(*writer);
    }
    const auto reader = casefile::SessionReader::open(file_);
    EXPECT_TRUE(reader.has_value()) << reader.error().message;
    return analyse(*reader);
  }

  test::TemporaryFolder folder_;
  std::filesystem::path file_ = folder_ / "run.db";
};

TEST(Distribution, PercentilesAreOfTheNearestRank) {
  std::vector<double> values{std::nan("")};
  for (int i = 1000; i >= 1; --i) {
    values.push_back(i);
  }
  const auto spread = cli::report::distribution_of(values);
  EXPECT_EQ(spread.count(), 1000U) << "unknown values are not counted";
  EXPECT_EQ(spread.percentile(0.5), 500.0);
  EXPECT_EQ(spread.percentile(0.99), 990.0);
  EXPECT_EQ(spread.percentile(0.999), 999.0);
  EXPECT_EQ(spread.max(), 1000.0);
  EXPECT_TRUE(std::isnan(cli::report::Distribution{}.percentile(0.5)));
}

TEST_F(Report, LatencyRateAndErrorsMatchTheRecordedSamples) {
  test::RunPlan plan;
  // 60 of the 100 frames at the target have an error of 0.5 mm, inside the region of 1 mm; 40 have 1.5 mm, outside.
  plan.error_mm = [](int k) { return k >= 160 ? 1.5 : 0.5; };
  const auto session = analysed([&](auto &writer) { test::write_run(writer, plan); });
  ASSERT_TRUE(session.has_value()) << session.error().message;

  EXPECT_EQ(session->tracker_frames, 200U);
  EXPECT_EQ(session->sent_to_published_ms.count(), 200U);
  EXPECT_NEAR(session->sent_to_published_ms.percentile(0.5), 1.00, 1e-9);
  EXPECT_NEAR(session->sent_to_published_ms.percentile(0.99), 1.98, 1e-9);
  EXPECT_NEAR(session->sent_to_published_ms.max(), 2.00, 1e-9);
  EXPECT_NEAR(session->exposure_to_published_ms.percentile(0.5), 3.00, 1e-9);
  EXPECT_NEAR(session->navigation_rate_hz, 1000.0 / 4.01, 1e-6) << "each state comes 0.01 ms later than the last";

  ASSERT_TRUE(session->has_truth);
  EXPECT_EQ(session->seed, 20260901U);
  ASSERT_TRUE(session->at_target.has_value());
  const auto &target = *session->at_target;
  EXPECT_EQ(target.tool, "Probe");
  EXPECT_EQ(target.trajectory, "Biopsy");
  EXPECT_EQ(target.samples, 100U);
  EXPECT_NEAR(target.true_error_mm.percentile(0.5), 0.5, 1e-9);
  EXPECT_NEAR(target.true_error_mm.max(), 1.5, 1e-9);
  EXPECT_NEAR(target.predicted_rms_mm, 0.9, 1e-12);
  EXPECT_NEAR(target.shown_distance_mm, 0.7, 1e-12);
  EXPECT_NEAR(target.inside_share, 0.60, 1e-12);
  EXPECT_EQ(target.inside, std::optional(true));
  EXPECT_NEAR(target.registration_error_mm, 0.4, 1e-9);

  ASSERT_EQ(session->approaches.size(), 1U);
  EXPECT_EQ(session->approaches[0].structure, "Precentral_L");
  EXPECT_NEAR(session->approaches[0].shown_mm, 12.0 - 0.04 * 199, 1e-9);
  EXPECT_NEAR(session->approaches[0].true_at_least_mm, 12.0 - 0.04 * 199 - 1.5, 1e-9);
}

TEST_F(Report, ThePathIsComparedWithThePlanOfTheCase) {
  const auto run = [](auto &writer) { test::write_run(writer, {}); };
  const auto without = analysed(run);
  ASSERT_TRUE(without.has_value());
  ASSERT_TRUE(without->at_target.has_value());
  EXPECT_NEAR(without->at_target->lateral_mm, 0.4, 1e-12);
  EXPECT_EQ(without->path.size(), 200U);
  EXPECT_TRUE(without->plans.empty());
  EXPECT_FALSE(without->path_summary.has_value()) << "where the entry is, is not known";

  const auto with_plan = [&](double length_mm, const char *name) {
    file_ = folder_ / name;
    const casefile::Trajectory plan[] = {{"Biopsy", {20.0, 5.0, -3.0 + length_mm}, {20.0, 5.0, -3.0}}};
    EXPECT_TRUE(casefile::write_trajectories(folder_ / "paths.mrk.json", plan));
    std::ifstream file(folder_ / "paths.mrk.json", std::ios::binary);
    const std::string body{std::istreambuf_iterator<char>(file), {}};
    return analysed([&](auto &writer) {
      const std::string toml = "id = \"a\"\ntrajectories = \"paths.mrk.json\"\n";
      ASSERT_TRUE(writer.attach("case.toml", std::as_bytes(std::span(toml))));
      ASSERT_TRUE(writer.attach("paths.mrk.json", std::as_bytes(std::span(body))));
      test::write_run(writer, {});
    });
  };
  const auto long_plan = with_plan(60.0, "long.db");
  ASSERT_TRUE(long_plan.has_value()) << long_plan.error().message;
  ASSERT_EQ(long_plan->plans.size(), 1U);
  ASSERT_TRUE(long_plan->path_summary.has_value());
  EXPECT_NEAR(long_plan->path_summary->largest_lateral_mm, 1.6, 1e-12);
  EXPECT_NEAR(long_plan->path_summary->remaining_depth_mm, 40.0, 1e-12);
  const auto short_plan = with_plan(30.0, "short.db");
  ASSERT_TRUE(short_plan->path_summary.has_value());
  EXPECT_NEAR(short_plan->path_summary->largest_lateral_mm, 0.4, 1e-12) << "40 mm before the target is outside";
  const auto json = cli::report::summary_json(*long_plan, {});
  EXPECT_NEAR(json["path"]["max_lateral_deviation_mm"].get<double>(), 1.6, 1e-12);
}

TEST(AcrossPlan, HasTwoDirectionsThatAreNamedByTheirAnatomy) {
  const casefile::Trajectory plan{"P", {40.0, 30.0, 80.0}, {10.0, 25.0, 5.0}};
  const auto sides = cli::report::across(plan);
  const Eigen::Vector3d along = (plan.target_mm - plan.entry_mm).normalized();
  for (const auto &side : sides.directions) {
    EXPECT_NEAR(side.dot(along), 0.0, 1e-12);
    EXPECT_NEAR(side.norm(), 1.0, 1e-12);
  }
  EXPECT_NEAR(sides.directions[0].dot(sides.directions[1]), 0.0, 1e-12);
  EXPECT_EQ(sides.names[0], "anterior");
  EXPECT_EQ(sides.names[1], "right");
  EXPECT_GT(sides.directions[1].x(), 0.9);
}

TEST_F(Report, PivotCalibrationsAreReportedWithTheirResults) {
  const auto session = analysed([](auto &writer) {
    test::write_run(writer, {});
    std::uint64_t id = 100;
    for (const bool good : {false, true}) {
      wire::Command command{};
      (void)wire::set_name(command.client, "tester");
      command.id = ++id;
      ASSERT_EQ(wire::fill_command(command, bregma_wire_COMMAND_FINISH_PIVOT, {"Stylus"}), "");
      test::put(writer, kStart_ns, command);
      wire::CommandReply reply{};
      (void)wire::set_name(reply.client, "tester");
      reply.id = id;
      reply.result = good ? bregma_wire_COMMAND_DONE : bregma_wire_COMMAND_REFUSED;
      reply.value_mm = 0.21;
      wire::set_text(reply.text, good ? "Stylus: tip known to 0.05 mm" : "turned too little");
      test::put(writer, kStart_ns + 10 * kMs, reply);
    }
  });
  ASSERT_TRUE(session.has_value()) << session.error().message;
  ASSERT_EQ(session->pivots.size(), 2U);
  EXPECT_EQ(session->pivots[0].tool, "Stylus");
  EXPECT_FALSE(session->pivots[0].accepted);
  EXPECT_TRUE(std::isnan(session->pivots[0].rms_mm));
  EXPECT_TRUE(session->pivots[1].accepted);
  EXPECT_NEAR(session->pivots[1].rms_mm, 0.21, 1e-12);
  const std::string text = cli::report::summary_text(*session, {});
  EXPECT_NE(text.find("Pivot of Stylus  refused: turned too little\n"), std::string::npos) << text;
  EXPECT_NE(text.find("Pivot of Stylus  Stylus: tip known to 0.05 mm\n"), std::string::npos) << text;
}

TEST_F(Report, TheErrorIsComparedAlongTheAxesOfTheEllipsoid) {
  // 0.5 mm along x is inside if the long axis is along x, and outside if the short one is.
  const auto inside_share = [&](const wire::Ellipsoid &region, const char *name) {
    file_ = folder_ / name;
    const auto session = analysed([&](auto &writer) {
      test::RunPlan plan;
      plan.frames = 0;
      test::write_run(writer, plan);
      wire::NavigationState state{};
      (void)wire::set_name(state.tool, "Probe");
      (void)wire::set_name(state.trajectory, "Biopsy");
      state.frame = 1;
      state.acquired_time_ns = kStart_ns + kMs;
      state.published_time_ns = kStart_ns + 2 * kMs;
      state.status = bregma_wire_POSE_LIVE;
      state.session = bregma_wire_SESSION_NAVIGATING;
      state.T_image_tip = {{1, 0, 0, 0}, {0.5, 0, 0}};
      state.tre_95 = region;
      test::put(writer, state.published_time_ns, state);
      wire::SimulatedTruth truth{};
      truth.frame = 1;
      truth.time_ns = state.acquired_time_ns;
      truth.tool_count = 1;
      truth.T_image_reference = {{1, 0, 0, 0}, {0, 0, 0}};
      (void)wire::set_name(truth.tools[0].tool, "Probe");
      truth.tools[0].T_image_tip = {{1, 0, 0, 0}, {0, 0, 0}};
      test::put(writer, kStart_ns, truth);
    });
    EXPECT_TRUE(session && session->at_target);
    return session->at_target->inside_share;
  };
  EXPECT_EQ(inside_share({{0.6, 0.4, 0.4}, {1, 0, 0, 0, 1, 0, 0, 0, 1}}, "long.db"), 1.0);
  EXPECT_EQ(inside_share({{0.6, 0.4, 0.4}, {0, 1, 0, -1, 0, 0, 0, 0, 1}}, "short.db"), 0.0);
}

TEST_F(Report, WithoutTruthTrueErrorsAreNotKnownAndNeverZero) {
  test::RunPlan plan;
  plan.truth = false;
  const auto session = analysed([&](auto &writer) { test::write_run(writer, plan); });
  ASSERT_TRUE(session.has_value());
  EXPECT_FALSE(session->has_truth);
  EXPECT_FALSE(session->seed.has_value());
  ASSERT_TRUE(session->at_target.has_value());
  EXPECT_EQ(session->at_target->true_error_mm.count(), 0U);
  EXPECT_TRUE(std::isnan(session->at_target->inside_share));
  EXPECT_FALSE(session->at_target->inside.has_value());
  EXPECT_TRUE(std::isnan(session->at_target->registration_error_mm));
  EXPECT_TRUE(std::isnan(session->approaches.at(0).true_at_least_mm));

  const auto json = summary_json(*session, {});
  EXPECT_TRUE(json["at_target"]["true_error_mm"]["p50"].is_null());
  EXPECT_TRUE(json["at_target"]["inside_95"].is_null());
  EXPECT_NE(summary_text(*session, {}).find("true error of the shown tip  not known"), std::string::npos);

  casefile::RunLimits limits;
  limits.max_tip_error_at_target_mm = 100.0;
  limits.require_inside_95 = true;
  limits.min_clearance_mm = 0.0;
  for (const auto &one : judge(*session, limits)) {
    EXPECT_FALSE(one.holds) << one.name << " holds although the file does not say";
    EXPECT_EQ(value_text(one), "not known");
  }
}

TEST_F(Report, TruthOfAnEarlierTrackerIsNotUsedForItsSuccessor) {
  // After a restart the frame numbers start at 1 again: equal numbers at different times.
  const auto session = analysed([&](auto &writer) {
    test::RunPlan plan;
    test::write_run(writer, plan);
    wire::SimulatedTruth old{};
    old.frame = 150;
    old.time_ns = kStart_ns - 60'000 * kMs;
    old.tool_count = 1;
    old.T_image_reference = {{1, 0, 0, 0}, {0, 0, 0}};
    (void)wire::set_name(old.tools[0].tool, "Probe");
    old.tools[0].T_image_tip = {{1, 0, 0, 0}, {500, 0, 0}};
    test::put(writer, kStart_ns, old);
  });
  ASSERT_TRUE(session.has_value());
  EXPECT_NEAR(session->at_target->true_error_mm.max(), 0.5, 1e-9);
}

TEST_F(Report, ChecksVerificationStatesAndAlarmsAreReported) {
  const auto session = analysed([&](auto &writer) {
    const auto at = [](std::int64_t s) { return kStart_ns + s * 1000 * kMs; };
    test::put_command(writer, at(1), 1, bregma_wire_COMMAND_START_REGISTRATION, bregma_wire_SESSION_REGISTERING);
    test::put_command(writer, at(2), 2, bregma_wire_COMMAND_ACCEPT_REGISTRATION, bregma_wire_SESSION_REGISTERED, 0.6);
    test::put_command(writer, at(3), 3, bregma_wire_COMMAND_CHECK_TOUCH, bregma_wire_SESSION_REGISTERED, 1.25,
                      "Nasion");
    wire::AccuracyState accuracy{};
    accuracy.check_count = 1;
    accuracy.last_check_mm = 1.25;
    accuracy.last_check_limit_mm = 2.5;
    test::put(writer, at(3) + kMs, accuracy);
    test::put_command(writer, at(4), 4, bregma_wire_COMMAND_CONFIRM_VERIFICATION, bregma_wire_SESSION_VERIFIED);
    test::put_command(writer, at(5), 5, bregma_wire_COMMAND_START_NAVIGATION, bregma_wire_SESSION_NAVIGATING);
    const auto alarm = [&](int second, const char *kind, wire::AlarmState state) {
      wire::Alarm out{};
      (void)wire::set_name(out.kind, kind);
      out.state = state;
      out.severity = bregma_wire_SEVERITY_CRITICAL;
      test::put(writer, at(second), out);
    };
    alarm(6, "drift", bregma_wire_ALARM_RAISED);
    alarm(7, "drift", bregma_wire_ALARM_ACKNOWLEDGED);
    alarm(8, "drift", bregma_wire_ALARM_CLEARED);
    alarm(9, "tracker_lost", bregma_wire_ALARM_RAISED);
    alarm(10, "tracker_lost", bregma_wire_ALARM_CLEARED);
    alarm(11, "disk", bregma_wire_ALARM_RAISED);
  });
  ASSERT_TRUE(session.has_value()) << session.error().message;
  ASSERT_EQ(session->checks.size(), 1U);
  EXPECT_EQ(session->checks[0].landmark, "Nasion");
  EXPECT_EQ(session->checks[0].tool, "Stylus");
  EXPECT_EQ(session->checks[0].distance_mm, 1.25);
  EXPECT_EQ(session->checks[0].limit_mm, 2.5);
  EXPECT_TRUE(session->verified_before_navigation);
  EXPECT_EQ(session->critical_alarms, 3U);
  EXPECT_EQ(session->unacknowledged_critical, 2U) << "one was not acknowledged before it cleared, one is still raised";
  std::string states;
  for (const auto &span : session->states) {
    states += span.state + " ";
    EXPECT_LE(span.from_ns, span.to_ns);
  }
  EXPECT_EQ(states, "registering registered verified navigating ");
  EXPECT_EQ(session->states.back().to_ns, session->end_ns);
}

TEST_F(Report, DevicesAreCountedFromTheFirstRecordOfALongRunningDaemon) {
  const auto health = [](std::int64_t up_s, std::uint64_t taken, std::uint64_t lost, std::uint64_t rejected) {
    wire::SystemHealth out{};
    out.time_ns = kStart_ns + up_s * 1000 * kMs;
    out.started_time_ns = kStart_ns;
    out.device_count = 1;
    (void)wire::set_name(out.devices[0].device, "Tracker");
    out.devices[0].kind = bregma_wire_DEVICE_TRACKER;
    out.devices[0].status = bregma_wire_DEVICE_LIVE;
    out.devices[0].rate_hz = 250.0;
    out.devices[0].taken = taken;
    out.devices[0].lost = lost;
    out.devices[0].rejected[bregma_wire_REJECT_DUPLICATE] = rejected;
    return out;
  };
  const auto two = [&](std::int64_t up_s) {
    return analysed([&](auto &writer) {
      test::put(writer, kStart_ns, health(up_s, 1000, 10, 3));
      test::put(writer, kStart_ns + kMs, health(up_s + 1, 1500, 12, 7));
    });
  };
  const auto late = two(3600);
  ASSERT_TRUE(late.has_value() && late->devices.size() == 1);
  EXPECT_EQ(late->devices[0].taken, 500U);
  EXPECT_EQ(late->devices[0].lost, 2U);
  EXPECT_EQ(late->devices[0].rejected.at("duplicate"), 4U);
  EXPECT_EQ(late->rejected_in_all(), 4U);

  file_ = folder_ / "fresh.db";
  const auto fresh = two(1);
  ASSERT_TRUE(fresh.has_value());
  EXPECT_EQ(fresh->devices[0].taken, 1500U) << "a daemon that has just started: all counts belong to this session";

  casefile::RunLimits limits;
  limits.max_rejected = 6;
  limits.max_lost_samples_percent = 1.0;
  const auto judged = judge(*fresh, limits);
  ASSERT_EQ(judged.size(), 2U);
  EXPECT_EQ(judged[0].name, "max_lost_samples_percent");
  EXPECT_NEAR(judged[0].value, 100.0 * 12 / 1512, 1e-9);
  EXPECT_TRUE(judged[0].holds);
  EXPECT_EQ(judged[1].value, 7.0);
  EXPECT_FALSE(judged[1].holds);
  EXPECT_FALSE(all_hold(judged));
}

TEST_F(Report, TracedPointsAreMeasuredAgainstTheScalpByTheAcceptedRegistration) {
  surface::TriangleMesh cube; // edge of 100 mm, centred at the origin
  for (int i = 0; i < 8; ++i) {
    cube.vertices_mm.emplace_back((i & 1) != 0 ? 50 : -50, (i & 2) != 0 ? 50 : -50, (i & 4) != 0 ? 50 : -50);
  }
  for (const auto &t : {Eigen::Vector3i{0, 2, 1},
                        {1, 2, 3},
                        {4, 5, 6},
                        {5, 7, 6},
                        {0, 1, 4},
                        {1, 5, 4},
                        {2, 6, 3},
                        {3, 6, 7},
                        {0, 4, 2},
                        {2, 4, 6},
                        {1, 3, 5},
                        {3, 7, 5}}) {
    cube.triangles.push_back(t);
  }
  const auto ply = folder_ / "scalp.ply";
  ASSERT_TRUE(casefile::write_mesh(ply, cube).has_value());
  std::ifstream in(ply, std::ios::binary);
  const std::string body((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());

  const auto session = analysed([&](auto &writer) {
    ASSERT_TRUE(writer.attach("scalp.ply", std::as_bytes(std::span(body))).has_value());
    const auto point = [&](std::int64_t time_ns, wire::CaptureKind kind, double z) {
      wire::CapturedPoint out{};
      out.kind = kind;
      out.position_mm[0] = -10.0; // the registration shifts by 10 along x
      out.position_mm[2] = z;
      test::put(writer, time_ns, out);
    };
    point(kStart_ns, bregma_wire_CAPTURE_SURFACE, 70.0); // from a registration that was restarted
    test::put_command(writer, kStart_ns + kMs, 1, bregma_wire_COMMAND_START_REGISTRATION,
                      bregma_wire_SESSION_REGISTERING);
    point(kStart_ns + 2 * kMs, bregma_wire_CAPTURE_SURFACE, 50.5);
    point(kStart_ns + 3 * kMs, bregma_wire_CAPTURE_SURFACE, 49.7);
    point(kStart_ns + 3 * kMs, bregma_wire_CAPTURE_FIDUCIAL_TOUCH, 60.0);
    test::put(writer, kStart_ns + 4 * kMs, test::accepted_registration(0.0));
    point(kStart_ns + 5 * kMs, bregma_wire_CAPTURE_SURFACE, 80.0); // after acceptance
  });
  ASSERT_TRUE(session.has_value()) << session.error().message;
  ASSERT_EQ(session->trace.size(), 2U);
  EXPECT_NEAR(session->trace[0].residual_mm, 0.5, 1e-5);
  EXPECT_NEAR(session->trace[1].residual_mm, -0.3, 1e-5);
  EXPECT_NEAR((session->trace[1].on_scalp_mm - Eigen::Vector3d(0, 0, 50)).norm(), 0.0, 1e-5);
}

// The tip indents by 4 mm, ruptures the surface at 0.11 N and continues to 20 mm. Near the target the answers are
// invalid.
TEST_F(Report, TheInsertionIsReportedForTheTargetThatMovesMost) {
  const auto put_states = [](auto &writer) {
    for (int k = 0; k <= 100; ++k) {
      for (const char *target : {"Near", "Far", "Landmark"}) {
        wire::DeformationState state{};
        (void)wire::set_name(state.point, target);
        state.time_ns = kStart_ns + std::int64_t{16} * k * kMs;
        state.elements = 20'000;
        state.ruptures = k > 20 ? 3 : 2; // two ruptures occurred before this recording
        state.rupture_force_N = k > 20 ? 0.11 : 0.07;
        state.phase = k == 0    ? bregma_wire_PROBE_OUTSIDE
                      : k <= 20 ? bregma_wire_PROBE_INDENTATION
                                : bregma_wire_PROBE_PENETRATION;
        state.depth_mm = 0.2 * k;
        state.status = k > 90 ? bregma_wire_DEFORMATION_INVALID : bregma_wire_DEFORMATION_VALID;
        state.reason = k > 90 ? bregma_wire_DEFORMATION_REASON_TOO_SLOW : bregma_wire_DEFORMATION_REASON_NONE;
        state.kind = target[0] == 'L' ? bregma_wire_FOLLOWED_LANDMARK : bregma_wire_FOLLOWED_TARGET;
        const double moved_mm = (target[0] == 'F' ? 0.002 : target[0] == 'N' ? 0.01 : 0.02) * k;
        state.displaced_mm[2] = k > 90 ? std::nan("") : moved_mm;
        test::put(writer, state.time_ns, state);
      }
    }
  };
  const auto session = analysed([&](auto &writer) {
    test::write_run(writer, {});
    put_states(writer);
  });
  ASSERT_TRUE(session.has_value()) << session.error().message;
  ASSERT_TRUE(session->insertion.has_value());
  const auto &insertion = *session->insertion;
  EXPECT_EQ(insertion.target, "Near");
  EXPECT_EQ(insertion.samples.size(), 100U) << "there are no samples outside the tissue";
  EXPECT_EQ(insertion.ruptures, 1U);
  EXPECT_EQ(insertion.rupture_force_N, 0.11);
  EXPECT_NEAR(insertion.rupture_depth_mm, 4.0, 1e-12);
  EXPECT_NEAR(insertion.largest_motion_mm, 0.9, 1e-12) << "invalid answers are not counted";
  EXPECT_EQ(insertion.states, (std::map<std::string, std::size_t>{{"invalid", 10}, {"valid", 90}}));
  EXPECT_EQ(insertion.reasons, (std::map<std::string, std::size_t>{{"too slow", 10}}));
  ASSERT_EQ(insertion.landmarks.size(), 1U);
  EXPECT_EQ(insertion.landmarks[0].landmark, "Landmark");
  EXPECT_NEAR(insertion.landmarks[0].largest_motion_mm, 1.8, 1e-12);
  const auto json = cli::report::summary_json(*session, {});
  EXPECT_EQ(json["insertion"]["rupture_force_N"], 0.11);
  EXPECT_EQ(json["insertion"]["landmarks"][0]["landmark"], "Landmark");
  EXPECT_NE(cli::report::summary_text(*session, {})
                .find("1 rupture, the first at a modelled 0.110 N after an indentation of 4.0 mm"),
            std::string::npos);

  std::filesystem::remove(file_);
  const auto without = analysed([](auto &writer) { test::write_run(writer, {}); });
  ASSERT_TRUE(without.has_value());
  EXPECT_FALSE(without->insertion);
  EXPECT_TRUE(cli::report::summary_json(*without, {})["insertion"].is_null());
}

TEST_F(Report, WhereTheProbeStandsStillIsMarked) {
  const auto session = analysed([](auto &writer) {
    test::write_run(writer, {});
    for (int k = 0; k < 400; ++k) { // 2.4 s in, 1.6 s still, 2.4 s out
      wire::DeformationState state{};
      (void)wire::set_name(state.point, "Deep");
      state.kind = bregma_wire_FOLLOWED_TARGET;
      state.time_ns = kStart_ns + std::int64_t{16} * k * kMs;
      state.phase = bregma_wire_PROBE_PENETRATION;
      state.status = bregma_wire_DEFORMATION_VALID;
      state.reason = bregma_wire_DEFORMATION_REASON_NONE;
      state.depth_mm = k < 150 ? 0.2 * k : k < 250 ? 30.0 + 0.1 * std::sin(k) : 30.0 - 0.2 * (k - 250);
      test::put(writer, state.time_ns, state);
    }
  });
  ASSERT_TRUE(session.has_value() && session->insertion.has_value());
  const auto &samples = session->insertion->samples;
  ASSERT_EQ(samples.size(), 400U);
  for (int k = 0; k < 400; ++k) {
    const bool still = samples[static_cast<std::size_t>(k)].still;
    if (k < 145 || k > 255) {
      EXPECT_FALSE(still) << k;
    } else if (k >= 150 && k < 250) {
      EXPECT_TRUE(still) << k;
    }
  }
}

TEST_F(Report, AnEmptySessionIsAnErrorSentence) {
  const auto session = analysed([](auto &) {});
  ASSERT_FALSE(session.has_value());
  EXPECT_NE(session.error().message.find("holds no records"), std::string::npos) << session.error().message;
}

TEST_F(Report, LimitsHoldExactlyUpToTheirValue) {
  test::RunPlan plan;
  const auto session = analysed([&](auto &writer) { test::write_run(writer, plan); });
  ASSERT_TRUE(session.has_value());
  casefile::RunLimits limits;
  EXPECT_TRUE(judge(*session, limits).empty()) << "limits that are not given are not checked";
  limits.max_fre_mm = 0.61;
  limits.min_fiducials = 8;
  limits.min_surface_samples = 301;
  const auto judged = judge(*session, limits);
  ASSERT_EQ(judged.size(), 3U);
  EXPECT_TRUE(judged[0].holds);
  EXPECT_TRUE(judged[1].holds);
  EXPECT_FALSE(judged[2].holds);
  EXPECT_EQ(limit_text(judged[2]), "at least 301");
}

// A tool that is carried past the head crosses the depths of the path as well, far to its side.
TEST(PathSummary, IsOfThePassThatCameNearestToTheTarget) {
  SessionAnalysis session;
  session.plans = {{"Path", {0, 0, 50}, {0, 0, 0}}};
  const auto add = [&](double depth_mm, double lateral_mm) {
    cli::report::PathSample sample;
    sample.time_ns = static_cast<std::int64_t>(session.path.size());
    sample.trajectory = "Path";
    sample.remaining_depth_mm = depth_mm;
    sample.lateral_mm = lateral_mm;
    session.path.push_back(sample);
  };
  add(60.0, 1.0);
  add(40.0, 0.5);
  add(1.0, 0.2);
  add(-0.1, 0.3); // beyond the target
  add(0.1, 0.2);
  add(30.0, 0.9); // withdrawn
  add(70.0, 2.0);
  add(20.0, 369.0); // past the head
  add(-60.0, 300.0);
  cli::report::summarise_path(session);
  ASSERT_TRUE(session.path_summary);
  EXPECT_EQ(session.path_summary->largest_lateral_mm, 0.9);
  EXPECT_EQ(session.path_summary->remaining_depth_mm, 30.0);
  SessionAnalysis outside; // a guide that stays before the skin
  outside.plans = session.plans;
  std::swap(session, outside);
  add(45.0, 130.0);
  add(110.0, 0.1);
  cli::report::summarise_path(session);
  EXPECT_FALSE(session.path_summary);
}

} // namespace
