// The device clock compared with a simulated truth: offset, drift, jitter, delayed samples, jumps.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>

#include <gtest/gtest.h>

#include "base/device_clock.hpp"
#include "tests/support/allocation_counter.hpp"

namespace bregma::base {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart_ns = 1'700'000'000'000 * kMs;

// A device with its own clock, and a path with a minimum latency, exponential jitter and occasional delays.
struct Device {
  double drift_ppm = 0.0;
  std::int64_t offset_ns = -987'654 * kMs; // device minus host
  std::int64_t period_ns = 4 * kMs;
  std::int64_t latency_ns = 4 * kMs;
  double jitter_ms = 0.5;
  double held_up = 0.02; // fraction of samples that are 5 to 60 ms late

  [[nodiscard]] std::int64_t device_time(std::int64_t host_ns) const {
    return host_ns + offset_ns + std::llround(drift_ppm * 1e-6 * static_cast<double>(host_ns - kStart_ns));
  }
};

struct Outcome {
  std::int64_t worst_error_ns = 0; // error of the mapped time of exposure, after 3 s
  int refused = 0;
  double drift_ppm = 0.0;
};

Outcome run(const Device &device, DeviceClock &clock, int samples, unsigned seed) {
  std::mt19937 random(seed);
  std::exponential_distribution<double> jitter_ms(1.0 / device.jitter_ms);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  Outcome out;
  std::int64_t last_arrival = 0;
  for (int i = 0; i < samples; ++i) {
    const std::int64_t exposed = kStart_ns + i * device.period_ns;
    const double held_up_ms = uniform(random) < device.held_up ? 5.0 + 55.0 * uniform(random) : 0.0;
    std::int64_t arrival = exposed + device.latency_ns + std::llround((jitter_ms(random) + held_up_ms) * 1e6);
    arrival = std::max(arrival, last_arrival); // a queue preserves the order
    last_arrival = arrival;
    const auto verdict = clock.observe(device.device_time(exposed), arrival, device.period_ns);
    out.refused += verdict == TimeVerdict::kInStep ? 0 : 1;
    if (i * device.period_ns > 3'000 * kMs) {
      const std::int64_t error = clock.to_host_ns(device.device_time(exposed)) - exposed;
      out.worst_error_ns = std::max<std::int64_t>(out.worst_error_ns, std::abs(error));
    }
  }
  out.drift_ppm = clock.drift_ppm();
  return out;
}

TEST(DeviceClock, EstimatesTheExposureWithOffsetDriftJitterAndDelays) {
  for (const double drift_ppm : {0.0, 50.0, -50.0, 100.0}) {
    for (unsigned seed = 1; seed <= 5; ++seed) {
      SCOPED_TRACE("drift " + std::to_string(drift_ppm) + " seed " + std::to_string(seed));
      DeviceClock clock({.minimum_latency_ns = 4 * kMs});
      const auto outcome = run({.drift_ppm = drift_ppm}, clock, 15'000, seed); // a minute at 250 Hz
      EXPECT_EQ(outcome.refused, 0);
      EXPECT_LT(outcome.worst_error_ns, 300'000);
      EXPECT_NEAR(outcome.drift_ppm, -drift_ppm, 10.0);
      EXPECT_EQ(clock.resyncs(), 0U);
    }
  }
}

TEST(DeviceClock, IsAccurateFrom20To1000Hz) {
  for (const std::int64_t period_ns : {50 * kMs, 10 * kMs, 1 * kMs}) {
    for (unsigned seed = 1; seed <= 3; ++seed) {
      SCOPED_TRACE("period " + std::to_string(period_ns) + " seed " + std::to_string(seed));
      DeviceClock clock({.minimum_latency_ns = 4 * kMs});
      const Device device{.drift_ppm = 50.0, .period_ns = period_ns};
      const auto outcome = run(device, clock, static_cast<int>(30'000 * kMs / period_ns), seed);
      EXPECT_EQ(outcome.refused, 0);
      // Ten samples per block at 20 Hz leave more jitter in the lowest point.
      EXPECT_LT(outcome.worst_error_ns, period_ns > 20 * kMs ? 600'000 : 300'000);
    }
  }
}

TEST(DeviceClock, TheErrorEqualsTheUnstatedMinimumLatency) {
  DeviceClock clock; // minimum latency not stated, but 4 ms: exposures appear 4 ms later
  const auto outcome = run({.drift_ppm = 50.0}, clock, 5'000, 3);
  EXPECT_NEAR(static_cast<double>(outcome.worst_error_ns), 4e6, 0.3e6);
}

TEST(DeviceClock, ADelayedFirstSampleHasNoLastingEffect) {
  DeviceClock clock;
  const auto at = [](std::int64_t i) { return kStart_ns + i * 4 * kMs; };
  EXPECT_EQ(clock.observe(at(0), at(0) + 200 * kMs, 4 * kMs), TimeVerdict::kInStep);
  for (int i = 1; i < 10; ++i) {
    EXPECT_EQ(clock.observe(at(i), at(i) + kMs, 4 * kMs), TimeVerdict::kInStep);
  }
  EXPECT_EQ(clock.to_host_ns(at(9)), at(9) + kMs);
}

// Runs a settled device to sample 500, then its clock jumps.
struct Jump {
  int refused = 0;
  bool resynced = false;
  std::int64_t error_ns = 0;
};

Jump jump(std::int64_t by_ns, int samples = 500) {
  DeviceClock clock;
  const auto at = [](std::int64_t i) { return kStart_ns + i * 4 * kMs; };
  for (int i = 0; i < 500; ++i) {
    EXPECT_EQ(clock.observe(at(i), at(i) + kMs, 4 * kMs), TimeVerdict::kInStep);
  }
  Jump out;
  for (int i = 500; i < 500 + samples; ++i) {
    const auto verdict = clock.observe(at(i) + by_ns, at(i) + kMs + std::int64_t{i % 3} * kMs / 10, 4 * kMs);
    out.refused += verdict == TimeVerdict::kInStep || verdict == TimeVerdict::kResynced ? 0 : 1;
    out.resynced = out.resynced || verdict == TimeVerdict::kResynced;
    out.error_ns = clock.to_host_ns(at(i) + by_ns) - (at(i) + kMs);
  }
  EXPECT_EQ(clock.resyncs(), out.resynced ? 1U : 0U);
  return out;
}

TEST(DeviceClock, SamplesAfterAClockJumpAreRejectedUntilTheNewTimeBaseIsConfirmed) {
  for (const std::int64_t by_ns : {5'000 * kMs, -5'000 * kMs, 60 * kMs, -60 * kMs, -10 * kMs, -3'600'000 * kMs}) {
    SCOPED_TRACE(by_ns);
    const Jump outcome = jump(by_ns);
    EXPECT_TRUE(outcome.resynced);
    EXPECT_GE(outcome.refused, 48);
    EXPECT_LE(outcome.refused, 52); // 200 ms of 4 ms
    EXPECT_NEAR(static_cast<double>(outcome.error_ns), 0.0, 0.3e6);
  }
}

TEST(DeviceClock, AnOldSampleAmongValidOnesHasNoEffect) {
  DeviceClock clock;
  int refused = 0;
  for (int i = 0; i < 2'000; ++i) {
    const std::int64_t device = kStart_ns + std::int64_t{4} * i * kMs;
    refused += clock.observe(device, device + kMs, 4 * kMs) == TimeVerdict::kInStep ? 0 : 1;
    refused += clock.observe(device - 100 * kMs, device + kMs, 4 * kMs) == TimeVerdict::kBackwards ? 0 : 1;
  }
  EXPECT_EQ(refused, 0);
  EXPECT_EQ(clock.resyncs(), 0U);
}

TEST(DeviceClock, AFloodWithFutureTimesIsNotAcceptedAsANewTimeBase) {
  DeviceClock clock;
  std::int64_t device = kStart_ns;
  for (int i = 0; i < 500; ++i, device += 4 * kMs) {
    EXPECT_EQ(clock.observe(device, device + kMs, 4 * kMs), TimeVerdict::kInStep);
  }
  // Ten samples per period, each with the next period's time: the time runs ten times too fast.
  std::int64_t arrival = device + kMs;
  int in_step = 0;
  for (int i = 0; i < 5'000; ++i, device += 4 * kMs, arrival += 400'000) {
    in_step += clock.observe(device, arrival, 4 * kMs) == TimeVerdict::kInStep ? 1 : 0;
  }
  EXPECT_LE(in_step, 40); // samples that the tolerance accepts until the line reaches its limit
  EXPECT_EQ(clock.resyncs(), 0U);
}

TEST(DeviceClock, OldAndTooFrequentSamplesHaveDifferentVerdicts) {
  DeviceClock clock;
  EXPECT_EQ(clock.observe(kStart_ns, kStart_ns, 4 * kMs), TimeVerdict::kInStep);
  EXPECT_EQ(clock.observe(kStart_ns + kMs, kStart_ns + kMs, 4 * kMs), TimeVerdict::kTooSoon);
  EXPECT_EQ(clock.observe(kStart_ns - kMs, kStart_ns + 2 * kMs, 4 * kMs), TimeVerdict::kBackwards);
  EXPECT_EQ(clock.observe(kStart_ns + 4 * kMs, kStart_ns + 4 * kMs, 4 * kMs), TimeVerdict::kInStep);
}

TEST(DeviceClock, AllocatesNothing) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "allocations are not counted under sanitizers";
  }
  DeviceClock clock;
  const test::AllocationScope scope;
  for (int i = 0; i < 20'000; ++i) {
    const std::int64_t device = kStart_ns + std::int64_t{4} * i * kMs;
    static_cast<void>(clock.observe(device, device + std::int64_t{i % 7} * kMs / 10, 4 * kMs));
  }
  EXPECT_EQ(scope.count(), 0U);
}

} // namespace
} // namespace bregma::base
