// Steps of wall clocks and delays of the network during a navigation in virtual time, compared with the truth: nothing
// old is shown as live, and a step costs nothing. tests/unit/server/inputs/age_test.cpp has the hours.
#include <algorithm>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "server/session/messages.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1'000 * kMs;
constexpr std::int64_t kLiveLimit_ns = 100 * kMs;

// Live states of the probe, with their true age.
struct Watched {
  explicit Watched(VirtualOperation &operation) {
    operation.observe([this](const wire::NavigationState &state, const wire::SimulatedTruth *truth) {
      if (wire::view(state.tool) != "Probe" || state.status != bregma_wire_POSE_LIVE) {
        return;
      }
      ASSERT_NE(truth, nullptr);
      began_ns = began_ns == 0 ? state.published_time_ns : began_ns;
      oldest_ns = std::max<std::int64_t>(oldest_ns, state.published_time_ns - truth->time_ns);
      if (last_ns > 0) {
        longest_gap_ns = std::max<std::int64_t>(longest_gap_ns, state.published_time_ns - last_ns);
      }
      last_ns = state.published_time_ns;
    });
  }
  std::int64_t began_ns = 0; // the first live state
  std::int64_t last_ns = 0;
  std::int64_t oldest_ns = 0;
  std::int64_t longest_gap_ns = 0;
};

std::vector<wire::Alarm> raised(const VirtualOperation &operation, std::string_view kind) {
  std::vector<wire::Alarm> out;
  std::copy_if(operation.alarms().begin(), operation.alarms().end(), std::back_inserter(out), [&](const auto &alarm) {
    return wire::view(alarm.kind) == kind && alarm.state == bregma_wire_ALARM_RAISED;
  });
  return out;
}

TEST(ClockStep, OfAnyWallClockDuringANavigationCostsNothingAndRaisesAnAlarm) {
  constexpr std::int64_t kEvery_ns = 3 * kSecond;
  constexpr std::int64_t kSteps_ms[] = {-3'600'000, -5'000, -100, 50, 3'600'000};
  const CaseFolder folder;
  VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps), kSeed);
  Watched probe(operation);
  std::int64_t next_ns = 0;
  std::vector<std::int64_t> daemon_steps_ns;
  std::size_t count = 0;
  operation.before_advance([&](std::int64_t utc_ns) {
    if (probe.began_ns == 0 || utc_ns < next_ns || count == 3 * std::size(kSteps_ms)) {
      return;
    }
    next_ns = utc_ns + kEvery_ns;
    const std::int64_t step_ns = kSteps_ms[count / 3] * kMs;
    if (count % 3 != 1) { // the daemon's, the driver's, all
      operation.loops().step_wall_clock(step_ns);
      daemon_steps_ns.push_back(utc_ns);
    }
    operation.link().wall_lead_ns += count % 3 != 0 ? step_ns : 0;
    ++count;
  });
  ASSERT_TRUE(operation.run()) << operation.failure();
  ASSERT_EQ(count, 3 * std::size(kSteps_ms));
  EXPECT_LE(probe.oldest_ns, kLiveLimit_ns);
  EXPECT_LT(probe.longest_gap_ns, 500 * kMs);
  const auto alarms = raised(operation, server::alarm::kWallClock);
  ASSERT_EQ(alarms.size(), daemon_steps_ns.size());
  for (std::size_t i = 0; i < alarms.size(); ++i) {
    EXPECT_LT(alarms[i].raised_time_ns - daemon_steps_ns[i], kSecond);
  }
  EXPECT_NE(std::string(alarms[0].text).find("-3600000 ms"), std::string::npos) << alarms[0].text;
  EXPECT_EQ(operation.health().clock_steps, daemon_steps_ns.size());
  EXPECT_EQ(operation.health().clock_step_ns, 3'600'000 * kMs);
  EXPECT_EQ(operation.health().wall_time_ns - operation.health().time_ns, -10'100 * kMs)
      << "-5 s, -0.1 s and +0.05 s, twice each";
}

TEST(ClockStep, WhileTheTrackerIsSilentLeavesNoOldPoseLive) {
  const CaseFolder folder;
  for (const std::int64_t step_ms : {-3'600'000, -5'000, -100, 50, 3'600'000}) {
    SCOPED_TRACE(std::to_string(step_ms) + " ms");
    VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps + R"(
[[faults]]
kind = "tracker_silent"
step = "follow_trajectory"
after_s = 2.0
duration_s = 3.0
)"),
                               kSeed);
    Watched probe(operation);
    bool stepped = false;
    operation.before_advance([&](std::int64_t utc_ns) {
      if (!stepped && probe.last_ns > 0 && utc_ns - probe.last_ns > 30 * kMs) { // it has just become silent
        stepped = true;
        operation.loops().step_wall_clock(step_ms * kMs);
        operation.link().wall_lead_ns += step_ms * kMs;
      }
    });
    ASSERT_TRUE(operation.run()) << operation.failure();
    EXPECT_TRUE(stepped);
    EXPECT_LE(probe.oldest_ns, kLiveLimit_ns);
    EXPECT_LT(probe.longest_gap_ns, 3'500 * kMs) << "live again within 0.5 s";
    EXPECT_FALSE(raised(operation, server::alarm::kTrackerLost).empty());
  }
}

TEST(ClockStep, ADelayOfTheNetworkIsInTheAgeOfAPose) {
  const CaseFolder folder;
  for (const bool other_host : {false, true}) {
    SCOPED_TRACE(other_host ? "synchronised hosts" : "one host");
    VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps + kNavigateSteps), kSeed);
    Watched probe(operation);
    VirtualLink &link = operation.link();
    if (other_host) {
      link.boot_id = kOtherBoot;
      link.boot_lead_ns = 4'711 * kSecond;
      link.drift_ppm = 25.0;
      link.wall_error_ns = kMs;
      operation.loops().set_wall_error(kMs);
    }
    link.delay_ns = [&probe](std::int64_t utc_ns) -> std::int64_t {
      const std::int64_t since_s = probe.began_ns == 0 ? 0 : (utc_ns - probe.began_ns) / kSecond;
      constexpr std::int64_t kDelays_ms[] = {0, 20, 100, 0, 500, 0, 40, 0}; // for 5 s each
      if (since_s < 40) {
        return kDelays_ms[since_s / 5] * kMs;
      }
      return since_s < 55 ? (utc_ns - probe.began_ns - 40 * kSecond) / 100 : 0; // 10 ms/s
    };
    ASSERT_TRUE(operation.run()) << operation.failure();
    EXPECT_LE(probe.oldest_ns, kLiveLimit_ns + (other_host ? 2 * kMs : 0));
    EXPECT_GT(probe.last_ns, probe.began_ns + 35 * kSecond);
    EXPECT_LT(probe.longest_gap_ns, 12 * kSecond) << "live again after the delay of 500 ms";
  }
}

} // namespace
} // namespace bregma::test
