// The transit compared with a simulated truth: the same host, synchronised hosts, a step of one clock, and hosts
// without a time service. Hours of virtual time.
#include <cmath>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "server/inputs/driver_transit.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/support/virtual_link.hpp"
#include "tests/unit/server/inputs/samples.hpp"

namespace bregma::inputs {
namespace {

using test::kDaemonBoot;
using test::kOtherBoot;
using test::VirtualLink;

constexpr std::int64_t kSample_ns = 16 * kMs;

// Samples over a path with a shortest transit of 0.2 ms, exponential jitter and what the test adds.
class TransitTest : public testing::Test {
protected:
  // Sends for the given time. added_ns: delay at the time since the start.
  template <class Added> void send(std::int64_t duration_ns, Added &&added_ns) {
    std::exponential_distribution<double> jitter(1.0 / 3e5);
    for (const std::int64_t end_ns = now_ns + duration_ns; now_ns < end_ns; now_ns += kSample_ns) {
      true_ns = 200'000 + std::llround(jitter(random)) + added_ns(now_ns - kStart_ns);
      const std::int64_t arrival_ns = now_ns + true_ns;
      transit = clock.observe(link.write_time(now_ns), arrival_ns, host);
      const bool taken =
          transit.verdict == base::TimeVerdict::kInStep || transit.verdict == base::TimeVerdict::kResynced;
      refused += taken ? 0 : 1;
      if (taken) {
        const std::int64_t shown_ns = arrival_ns - transit.written_ns;
        too_small_ns = std::max(too_small_ns, true_ns - shown_ns);
        too_large_ns = std::max(too_large_ns, shown_ns - true_ns);
        // The bounds are those of a uniform distribution: sqrt(3) sigma.
        beyond_ns =
            std::max<std::int64_t>(beyond_ns, std::abs(shown_ns - true_ns) -
                                                  std::llround(std::sqrt(3.0) * static_cast<double>(transit.sigma_ns)));
      }
    }
  }
  void send(std::int64_t duration_ns) {
    send(duration_ns, [](std::int64_t) { return std::int64_t{0}; });
  }
  void on_another_host(std::int64_t error_ns) {
    link.boot_id = kOtherBoot;
    link.boot_lead_ns = 987'654 * kSecond;
    link.drift_ppm = 40.0;
    link.wall_error_ns = host.wall_error_ns = error_ns;
  }

  std::mt19937_64 random{11};
  VirtualLink link{kStart_ns};
  HostClock host{.boot_id = kDaemonBoot,
                 .utc_minus_boot_ns = kStart_ns - VirtualLink::kBootAtStart_ns,
                 .wall_minus_boot_ns = kStart_ns - VirtualLink::kBootAtStart_ns};
  DriverTransit clock;
  Transit transit;
  std::int64_t now_ns = kStart_ns;
  std::int64_t true_ns = 0;
  std::int64_t too_small_ns = 0, too_large_ns = 0, beyond_ns = 0;
  int refused = 0;
};

TEST_F(TransitTest, IsExactOnOneHostWhateverTheDelayDoesAndTheWallClocksDo) {
  send(600 * kSecond, [](std::int64_t t) { return t > 60 * kSecond ? 500 * kMs + t / 100 : 0; });
  link.wall_lead_ns = -3'600 * kSecond;
  host.wall_minus_boot_ns += 3'600 * kSecond;
  send(60 * kSecond);
  EXPECT_EQ(transit.source, bregma_wire_TRANSIT_SAME_HOST);
  EXPECT_EQ(too_small_ns, 0);
  EXPECT_EQ(too_large_ns, 0);
  EXPECT_EQ(transit.sigma_ns, 0);
  EXPECT_EQ(refused, 0);
}

TEST_F(TransitTest, ASampleThatWasWrittenDuringALongStepHasArrivedAtOnce) {
  const Transit during = clock.observe(link.write_time(now_ns + 20 * kMs), now_ns, host);
  EXPECT_EQ(during.verdict, base::TimeVerdict::kInStep);
  EXPECT_EQ(during.written_ns, now_ns);
}

TEST_F(TransitTest, ASampleOfThisBootFromTheFutureIsRefused) {
  const Transit early = clock.observe(link.write_time(now_ns + 101 * kMs), now_ns, host);
  EXPECT_EQ(early.verdict, base::TimeVerdict::kInFuture);
}

TEST_F(TransitTest, BetweenSynchronisedHostsStepsAndRampsOfTheDelayAreSeenForAnHour) {
  for (const std::int64_t step_ms : {20, 100, 500}) {
    SCOPED_TRACE("step of " + std::to_string(step_ms) + " ms");
    clock.reset();
    now_ns = kStart_ns;
    on_another_host(kMs);
    send(3'600 * kSecond, [&](std::int64_t t) { return t > 30 * kSecond ? step_ms * kMs : 0; });
    EXPECT_EQ(transit.source, bregma_wire_TRANSIT_SYNCHRONISED);
    EXPECT_LE(too_small_ns, 2 * kMs);
    EXPECT_LE(beyond_ns, 0);
    EXPECT_EQ(refused, 0);
  }
  for (const std::int64_t ms_per_s : {1, 3, 10}) {
    SCOPED_TRACE("ramp of " + std::to_string(ms_per_s) + " ms/s");
    clock.reset();
    now_ns = kStart_ns;
    send(3'600 * kSecond, [&](std::int64_t t) { return ms_per_s * t / 1'000; });
    EXPECT_EQ(transit.source, bregma_wire_TRANSIT_SYNCHRONISED);
    EXPECT_LE(too_small_ns, 2 * kMs);
    EXPECT_LE(beyond_ns, 0);
    EXPECT_EQ(refused, 0);
  }
}

TEST_F(TransitTest, ADelayThatExistedFromTheBeginningIsSeenBetweenSynchronisedHosts) {
  on_another_host(kMs);
  send(60 * kSecond, [](std::int64_t) { return 20 * kMs; });
  EXPECT_LE(too_small_ns, 2 * kMs);
  EXPECT_LE(too_large_ns, 2 * kMs);
}

TEST_F(TransitTest, AStepOfOneWallClockLeavesTheOffsetBeforeItWithAGrowingUncertainty) {
  for (const bool ours : {true, false}) {
    for (const std::int64_t step_ms : {-3'600'000, -5'000, -100, 50, 3'600'000}) {
      SCOPED_TRACE(std::string(ours ? "daemon " : "driver ") + std::to_string(step_ms) + " ms");
      clock.reset();
      now_ns = kStart_ns;
      too_small_ns = too_large_ns = 0;
      on_another_host(kMs);
      link.wall_lead_ns = 0;
      host.wall_minus_boot_ns = host.utc_minus_boot_ns;
      send(60 * kSecond);
      const std::int64_t before_ns = transit.sigma_ns;
      (ours ? host.wall_minus_boot_ns : link.wall_lead_ns) += step_ms * kMs;
      send(60 * kSecond);
      EXPECT_EQ(transit.source, bregma_wire_TRANSIT_HELD);
      EXPECT_GT(transit.sigma_ns, before_ns + 2 * kMs); // 100 ppm for a minute
      EXPECT_LE(too_small_ns, 5 * kMs);
      EXPECT_LE(too_large_ns, 10 * kMs);
      EXPECT_LE(beyond_ns, 0);
      // The time service corrects the clock.
      (ours ? host.wall_minus_boot_ns : link.wall_lead_ns) -= step_ms * kMs;
      send(kSecond);
      EXPECT_EQ(transit.source, bregma_wire_TRANSIT_SYNCHRONISED);
      EXPECT_EQ(refused, 0);
    }
  }
}

TEST_F(TransitTest, WithoutATimeServiceOnlyTheRiseOfTheDelayIsSeenAndTheUncertaintyGrows) {
  on_another_host(0);
  link.drift_ppm = -40.0; // faster here
  send(60 * kSecond);
  EXPECT_EQ(transit.source, bregma_wire_TRANSIT_ENVELOPE);
  const std::int64_t after_a_minute_ns = transit.sigma_ns;
  send(60 * kSecond, [](std::int64_t) { return 500 * kMs; });
  EXPECT_LE(too_small_ns, 10 * kMs);
  EXPECT_EQ(refused, 0);
  send(3'480 * kSecond, [](std::int64_t) { return 500 * kMs; });
  EXPECT_LE(too_small_ns, 500 * kMs) << "a rise that stays is lost at the rate of the drift";
  EXPECT_LE(beyond_ns, 0) << "and is covered by the uncertainty";
  EXPECT_GT(transit.sigma_ns, after_a_minute_ns + 100 * kMs);
}

TEST_F(TransitTest, ADriverThatStatesNoBootTimeIsFollowedByItsWallClock) {
  const auto write = [this] { return wire::WriteTime{.wall_ns = now_ns - 500 * kSecond}; };
  for (int i = 0; i < 5'000; ++i, now_ns += kSample_ns) {
    transit = clock.observe(write(), now_ns + (i < 4'000 ? kMs : 101 * kMs), host);
  }
  EXPECT_EQ(transit.source, bregma_wire_TRANSIT_ENVELOPE);
  const std::int64_t rise_ns = now_ns - kSample_ns + 101 * kMs - transit.written_ns;
  EXPECT_NEAR(static_cast<double>(rise_ns) * 1e-6, 100.0, 2.0) << "16 s later";
}

TEST_F(TransitTest, AnotherBootOfTheDriversHostBeginsAnew) {
  on_another_host(kMs);
  send(60 * kSecond);
  link.boot_id = wire::BootIdentity{9};
  link.boot_lead_ns = -3 * kSecond;
  send(10 * kSecond);
  EXPECT_EQ(refused, 0);
  EXPECT_LE(too_small_ns, 2 * kMs);
  EXPECT_EQ(transit.source, bregma_wire_TRANSIT_SYNCHRONISED);
}

TEST_F(TransitTest, AllocatesNothing) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "allocations are not counted under sanitizers";
  }
  on_another_host(kMs);
  const test::AllocationScope scope;
  send(60 * kSecond);
  EXPECT_EQ(scope.count(), 0U);
}

} // namespace
} // namespace bregma::inputs
