// The age of a sample compared with the truth, for an hour of virtual time: delays of the network that rise by a step
// or a ramp, and steps of every host's wall clock. The device's own clock has an offset and a drift.
#include <cmath>
#include <cstdio>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "server/inputs/input_guard.hpp"
#include "tests/support/virtual_link.hpp"
#include "tests/unit/server/inputs/samples.hpp"

namespace bregma::inputs {
namespace {

using test::VirtualLink;

constexpr std::int64_t kFrame_ns = 16'666'667;
constexpr std::int64_t kBeforeWrite_ns = 4 * kMs; // exposure to the driver's write, as configured
constexpr std::int64_t kLiveLimit_ns = 100 * kMs;
constexpr std::int64_t kHostError_ns = 500'000; // stated by each time service

struct Hosts {
  const char *name;
  bool same;
};

class AgeTest : public testing::TestWithParam<Hosts> {
protected:
  AgeTest() {
    link.wall_error_ns = host.wall_error_ns = kHostError_ns;
    if (!GetParam().same) {
      link.boot_id = test::kOtherBoot;
      link.boot_lead_ns = 55 * kSecond;
      link.drift_ppm = -30.0;
    }
  }

  void TearDown() override {
    std::printf("%s: the age is at most %.2f ms too small and %.2f ms too large\n", GetParam().name,
                static_cast<double>(too_small_ns) * 1e-6, static_cast<double>(too_large_ns) * 1e-6);
  }

  // One frame after the other until the given time. delay_ns(t): of the network, t since the start.
  template <class Delay> void run_until(std::int64_t end_ns, Delay &&delay_ns) {
    std::exponential_distribution<double> jitter(1.0 / 3e5);
    for (; at_ns < end_ns; at_ns += kFrame_ns, ++number) {
      const std::int64_t written_ns = at_ns + kBeforeWrite_ns + std::llround(jitter(random));
      const std::int64_t arrival_ns = std::max(written_ns + 100'000 + delay_ns(at_ns - kStart_ns), arrived_ns);
      arrived_ns = arrival_ns; // a network that keeps the order
      auto frame = tracker_frame(number, kFrame_ns);
      const double device_ns = static_cast<double>(at_ns - kStart_ns) * (1.0 + 50e-6);
      frame.device_time_ns = 86'400 * kSecond + std::llround(device_ns);
      const wire::WriteTime write = link.write_time(written_ns);
      frame.sent_time_ns = write.wall_ns;
      frame.sent_boot_ns = write.boot_ns;
      frame.sent_clock_error_ns = write.wall_error_ns;
      std::copy(write.boot_id.begin(), write.boot_id.end(), frame.boot_id);
      guard.set_host(host);
      judge(guard.check(frame, 1, arrival_ns), arrival_ns);
    }
  }
  void judge(const Verdict &verdict, std::int64_t arrival_ns) {
    if (!verdict.accepted) {
      ++rejected;
      return;
    }
    const std::int64_t true_age_ns = arrival_ns - at_ns;
    const std::int64_t shown_age_ns = arrival_ns - verdict.acquired_time_ns;
    too_small_ns = std::max(too_small_ns, true_age_ns - shown_age_ns);
    too_large_ns = std::max(too_large_ns, shown_age_ns - true_age_ns);
    old_but_live += true_age_ns > kLiveLimit_ns + 5 * kMs && shown_age_ns <= kLiveLimit_ns ? 1 : 0;
    if (shown_age_ns <= kLiveLimit_ns) {
      longest_gap_ns = std::max(longest_gap_ns, arrival_ns - live_ns);
      live_ns = arrival_ns;
    }
  }

  std::mt19937_64 random{5};
  VirtualLink link{kStart_ns};
  HostClock host{.boot_id = test::kDaemonBoot,
                 .utc_minus_boot_ns = kStart_ns - VirtualLink::kBootAtStart_ns,
                 .wall_minus_boot_ns = kStart_ns - VirtualLink::kBootAtStart_ns};
  InputGuard<wire::TrackerFrame> guard{std::vector<std::string>{"Tracker"},
                                       DeviceOptions{.clock = {.minimum_latency_ns = kBeforeWrite_ns}}};
  std::uint64_t number = 0;
  std::int64_t at_ns = kStart_ns;
  std::int64_t arrived_ns = kStart_ns;
  std::int64_t live_ns = kStart_ns;
  std::int64_t too_small_ns = 0, too_large_ns = 0, longest_gap_ns = 0;
  int old_but_live = 0;
  int rejected = 0;
};

TEST_P(AgeTest, AStepOfTheDelayIsInTheAgeAfterAnHourToo) {
  for (const std::int64_t step_ms : {20, 100, 500}) {
    SCOPED_TRACE("step of " + std::to_string(step_ms) + " ms");
    const std::int64_t began_ns = at_ns;
    run_until(began_ns + 3'600 * kSecond,
              [&](std::int64_t t) { return t + kStart_ns > began_ns + 60 * kSecond ? step_ms * kMs : 0; });
    EXPECT_LT(too_small_ns, 5 * kMs);
    EXPECT_LT(too_large_ns, 5 * kMs);
    EXPECT_EQ(old_but_live, 0);
    EXPECT_LT(rejected, 30) << "at the end of a step the samples come earlier at once";
    rejected = 0;
  }
}

TEST_P(AgeTest, ASlowRampOfTheDelayIsInTheAgeAfterAnHourToo) {
  run_until(kStart_ns + 3'600 * kSecond, [](std::int64_t t) { return t / 1'000; }); // 1 ms/s
  EXPECT_LT(too_small_ns, 5 * kMs);
  EXPECT_EQ(old_but_live, 0);
  EXPECT_EQ(rejected, 0);
}

TEST_P(AgeTest, AFastRampOfTheDelayIsInTheAgeAfterAnHourToo) {
  run_until(kStart_ns + 3'600 * kSecond, [](std::int64_t t) { return t / 100; }); // 10 ms/s
  EXPECT_LT(too_small_ns, 5 * kMs);
  EXPECT_EQ(old_but_live, 0);
  EXPECT_EQ(rejected, 0);
}

TEST_P(AgeTest, AStepOfAnyWallClockCostsNothing) {
  for (const std::int64_t step_ms : {-3'600'000, -5'000, -100, 50, 3'600'000}) {
    for (const int whose : {1, 2, 3}) { // the daemon's, the driver's, both
      SCOPED_TRACE(std::to_string(step_ms) + " ms, " + std::to_string(whose));
      run_until(at_ns + 10 * kSecond, [](std::int64_t) { return 0; });
      host.wall_minus_boot_ns += (whose & 1) != 0 ? step_ms * kMs : 0;
      link.wall_lead_ns += (whose & 2) != 0 ? step_ms * kMs : 0;
      run_until(at_ns + 10 * kSecond, [](std::int64_t) { return 0; });
      host.wall_minus_boot_ns -= (whose & 1) != 0 ? step_ms * kMs : 0;
      link.wall_lead_ns -= (whose & 2) != 0 ? step_ms * kMs : 0;
    }
  }
  EXPECT_LT(too_small_ns, 5 * kMs);
  EXPECT_LT(too_large_ns, 5 * kMs);
  EXPECT_EQ(rejected, 0);
  EXPECT_LT(longest_gap_ns, 50 * kMs);
}

INSTANTIATE_TEST_SUITE_P(Hosts, AgeTest, testing::Values(Hosts{"one", true}, Hosts{"synchronised", false}),
                         [](const auto &one) { return std::string(one.param.name); });

} // namespace
} // namespace bregma::inputs
