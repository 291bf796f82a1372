// One device in virtual time: live, stale, lost and reconnected; one writer at a time; health figures.
#include <limits>

#include <gtest/gtest.h>

#include "server/inputs/input_guard.hpp"
#include "tests/unit/server/inputs/samples.hpp"

namespace bregma::inputs {
namespace {

constexpr std::uint64_t kWriter = 1;
constexpr std::uint64_t kOtherWriter = 2;

class DeviceMonitorTest : public testing::Test {
protected:
  // Frames first to last - 1, each arriving 1 ms after its exposure.
  void send(std::uint64_t first, std::uint64_t last, std::uint64_t writer = kWriter) {
    for (std::uint64_t i = first; i < last; ++i) {
      verdict = guard.check(tracker_frame(i), writer, at(i));
    }
  }
  static std::int64_t at(std::uint64_t i) { return kStart_ns + static_cast<std::int64_t>(i) * kPeriod_ns + kMs; }
  [[nodiscard]] wire::DeviceHealth health(std::int64_t now_ns) const { return guard.health(now_ns).devices[0]; }
  [[nodiscard]] const DeviceMonitor &device() const { return guard.devices()[0]; }

  std::vector<std::string> names{"Tracker"};
  InputGuard<wire::TrackerFrame> guard{names, DeviceOptions{}};
  Verdict verdict;
};

TEST_F(DeviceMonitorTest, ADeviceThatWasNeverSeenHasNoFigures) {
  const auto health_now = health(kStart_ns);
  EXPECT_EQ(health_now.status, bregma_wire_DEVICE_NEVER_SEEN);
  EXPECT_EQ(health_now.kind, bregma_wire_DEVICE_TRACKER);
  EXPECT_EQ(wire::text(health_now.device), "Tracker");
  EXPECT_TRUE(std::isnan(health_now.age_ms));
  EXPECT_EQ(health_now.connections, 0U);
}

TEST_F(DeviceMonitorTest, IsStaleBeyondTheLiveLimitAndLostAtTheDeadline) {
  send(0, 500);
  const std::int64_t exposed = device().acquired_time_ns();
  EXPECT_EQ(device().status(exposed + 100 * kMs), bregma_wire_DEVICE_LIVE);
  EXPECT_EQ(device().status(exposed + 100 * kMs + 1), bregma_wire_DEVICE_STALE);
  const std::int64_t deadline_ns = wire::qos::kTracker.deadline_ns;
  EXPECT_EQ(device().status(at(499) + deadline_ns), bregma_wire_DEVICE_STALE);
  EXPECT_EQ(device().status(at(499) + deadline_ns + 1), bregma_wire_DEVICE_LOST);
  EXPECT_EQ(health(at(499) + deadline_ns + 1).rate_hz, 0.0);
}

TEST_F(DeviceMonitorTest, ADeviceIsLostAtOnceWhenItsWriterDies) {
  send(0, 10);
  guard.set_writers_alive(1);
  EXPECT_EQ(device().status(at(9)), bregma_wire_DEVICE_LIVE);
  guard.set_writers_alive(0);
  EXPECT_EQ(device().status(at(9)), bregma_wire_DEVICE_LOST);
}

TEST_F(DeviceMonitorTest, ASilenceEndsWithAReconnectionAndCountsLostSamples) {
  send(0, 100);
  send(1'100, 1'101); // four seconds later, the frame count has continued
  EXPECT_TRUE(verdict.accepted);
  EXPECT_TRUE(verdict.reconnected);
  send(1'101, 1'110);
  EXPECT_FALSE(verdict.reconnected);
  EXPECT_EQ(health(at(1'109)).connections, 2U);
  EXPECT_EQ(health(at(1'109)).lost, 1'000U);
  EXPECT_EQ(device().status(at(1'109)), bregma_wire_DEVICE_LIVE);
}

TEST_F(DeviceMonitorTest, ARestartedDriverWithANewClockAndCountIsAcceptedAfterASilence) {
  send(0, 100);
  guard.set_writers_alive(0);
  for (std::uint64_t i = 0; i < 50; ++i) {
    auto frame = tracker_frame(i);                                          // restarts its frame count
    frame.device_time_ns = (static_cast<std::int64_t>(i) + 1) * kPeriod_ns; // its clock began at 1970
    const std::int64_t now_ns = at(150 + i);
    frame.sent_time_ns = now_ns;
    verdict = guard.check(frame, kOtherWriter, now_ns);
    EXPECT_TRUE(verdict.accepted) << i;
    EXPECT_EQ(verdict.reconnected, i == 0);
    EXPECT_NEAR(static_cast<double>(now_ns - verdict.acquired_time_ns), 0.0, 1e5);
  }
  const auto now = health(at(199));
  EXPECT_EQ(now.connections, 2U);
  EXPECT_EQ(now.lost, 0U);
  EXPECT_EQ(now.taken, 150U);
}

TEST_F(DeviceMonitorTest, ASecondDriverOfTheSameNameIsRejectedWhileTheFirstIsAlive) {
  for (std::uint64_t i = 0; i < 100; ++i) {
    EXPECT_TRUE(guard.check(tracker_frame(i), kWriter, at(i)).accepted);
    const auto other = guard.check(tracker_frame(i + 5), kOtherWriter, at(i) + kMs);
    EXPECT_FALSE(other.accepted);
    EXPECT_EQ(other.reason, bregma_wire_REJECT_DUPLICATE);
  }
  EXPECT_EQ(health(at(99)).connections, 1U);
  EXPECT_EQ(health(at(99)).rejected[bregma_wire_REJECT_DUPLICATE], 100U);
  EXPECT_EQ(health(at(99)).other_writer, 99U) << "the last one may be a driver that was restarted";
  EXPECT_EQ(health(at(99)).lost, 0U);
}

TEST_F(DeviceMonitorTest, AHiccupDoesNotHandTheDeviceToASecondWriterButItsLossDoes) {
  send(0, 100);
  std::uint64_t other_taken = 0;
  for (std::uint64_t i = 100; i < 200; ++i) { // the first is silent for 5 periods, again and again
    if (i % 10 < 5) {
      EXPECT_TRUE(guard.check(tracker_frame(i), kWriter, at(i)).accepted) << i;
    }
    other_taken += guard.check(tracker_frame(i), kOtherWriter, at(i) + kMs).accepted ? 1 : 0;
  }
  EXPECT_EQ(other_taken, 0U);
  EXPECT_GT(health(at(200)).other_writer, 90U);
  EXPECT_EQ(health(at(200)).takeovers, 0U);
  EXPECT_EQ(health(at(200)).lost, 45U) << "frames of the other writer are no frames of the device";

  send(200, 300, kOtherWriter); // the first has ended
  EXPECT_TRUE(verdict.accepted);
  EXPECT_EQ(health(at(300)).takeovers, 1U);
  EXPECT_EQ(health(at(300)).connections, 2U);
  send(300, 301); // and comes back: now it is the second
  EXPECT_FALSE(verdict.accepted);
}

TEST_F(DeviceMonitorTest, ADriverThatWasRestartedBeforeItsLossIsNoSecondWriter) {
  send(0, 100);
  send(110, 200, kOtherWriter); // refused until the first is lost
  EXPECT_TRUE(verdict.accepted);
  EXPECT_EQ(health(at(200)).takeovers, 0U);
  EXPECT_EQ(health(at(200)).other_writer, 0U);
}

TEST_F(DeviceMonitorTest, RejectedSamplesAreNotCountedAsLost) {
  std::uint64_t spoiled = 0;
  for (std::uint64_t i = 0; i < 400; ++i) {
    if (i % 20 == 7 || i % 50 == 33) {
      continue; // never arrives
    }
    auto frame = tracker_frame(i);
    if (i % 9 == 4) {
      frame.tools[0].T_tracker_tool.translation_mm[1] = wire::kUnknown;
      ++spoiled;
    }
    static_cast<void>(guard.check(frame, kWriter, at(i)));
  }
  const auto now = health(at(399));
  EXPECT_EQ(now.rejected[bregma_wire_REJECT_NOT_FINITE], spoiled);
  EXPECT_EQ(now.lost, 20U + 8U);
  EXPECT_EQ(now.taken + spoiled + now.lost, 400U);
  EXPECT_EQ(device().received(), now.taken + spoiled);
}

TEST_F(DeviceMonitorTest, AnImplausibleFrameNumberIsRejectedAndNotCountedAsALoss) {
  send(0, 10);
  auto frame = tracker_frame(10);
  frame.frame = ~std::uint64_t{0};
  EXPECT_EQ(guard.check(frame, kWriter, at(10)).reason, bregma_wire_REJECT_MALFORMED);
  send(11, 20);
  EXPECT_TRUE(verdict.accepted);
  EXPECT_EQ(health(at(19)).lost, 1U); // number 110 was never seen
}

TEST_F(DeviceMonitorTest, ARestartedFrameCountIsAcceptedAfterFiveSamples) {
  send(0, 100);
  int refused = 0;
  for (std::uint64_t i = 100; i < 120; ++i) {
    auto frame = tracker_frame(i);
    frame.frame = i - 100;
    refused += guard.check(frame, kWriter, at(i)).accepted ? 0 : 1;
  }
  EXPECT_EQ(refused, 4);
  EXPECT_EQ(health(at(119)).lost, 0U);
}

TEST_F(DeviceMonitorTest, LateRateAgeAndLatencyAreMeasured) {
  for (std::uint64_t i = 0; i < 1'000; ++i) {
    const std::int64_t held_up = i % 100 == 99 ? 5 * kMs : 0; // longer than a period
    static_cast<void>(guard.check(tracker_frame(i), kWriter, at(i) + held_up));
  }
  const auto now = health(at(999) + 5 * kMs);
  EXPECT_EQ(now.late, 10U);
  EXPECT_NEAR(now.rate_hz, 250.0, 2.0);
  EXPECT_NEAR(now.age_ms, 5.0, 0.1);
  EXPECT_NEAR(now.latency_p50_ms, 0.0, 0.05); // above the minimum, which is not stated here
  EXPECT_NEAR(now.latency_p99_ms, 0.0, 0.05);
  EXPECT_NEAR(now.clock_offset_ms, 1.0, 0.01);
}

TEST_F(DeviceMonitorTest, ASlowDeviceIsStaleBeforeItIsLost) {
  constexpr std::int64_t kSlow_ns = 90 * kMs;
  for (std::uint64_t i = 0; i < 20; ++i) {
    verdict = guard.check(tracker_frame(i, kSlow_ns), kWriter, kStart_ns + static_cast<std::int64_t>(i) * kSlow_ns);
  }
  const std::int64_t exposed = device().acquired_time_ns();
  EXPECT_EQ(device().status(exposed + 3 * kSlow_ns), bregma_wire_DEVICE_LIVE);
  EXPECT_EQ(device().status(exposed + 3 * kSlow_ns + 1), bregma_wire_DEVICE_LOST) << "200 ms without a sample";
}

// The live limit is three periods: a device that states a longer period than it keeps would be live for too long.
TEST_F(DeviceMonitorTest, AStatedPeriodThatTheNumbersContradictIsNotUsed) {
  for (std::uint64_t i = 0; i < 400; ++i) {
    auto frame = tracker_frame(i);
    frame.period_ns = 7 * kMs; // keeps 4 ms
    if (i % 10 == 3) {
      continue; // losses do not make it slower
    }
    verdict = guard.check(frame, kWriter, at(i));
    EXPECT_EQ(verdict.period_ns, i < 250 ? 7 * kMs : kPeriod_ns) << i;
  }
  EXPECT_NEAR(health(at(399)).stated_rate_hz, 1e3 / 7.0, 0.1);
  EXPECT_EQ(device().period_ns(), kPeriod_ns);
  send(400, 800);
  EXPECT_EQ(verdict.period_ns, kPeriod_ns);
}

// A link that was down for longer than DDS' lease: the reader sees another writer, of the same process.
TEST_F(DeviceMonitorTest, AReturningWriterWhoseNumbersGoOnKeepsItsCountOfLosses) {
  send(0, 1'000);
  guard.set_writers_alive(0);
  send(4'000, 5'000, kOtherWriter); // 12 s later
  const auto now = health(at(4'999));
  EXPECT_EQ(now.taken, 2'000U);
  EXPECT_EQ(now.lost, 3'000U);
  EXPECT_EQ(now.taken + now.lost, 5'000U) << "every number";
  EXPECT_EQ(now.connections, 2U);
}

TEST_F(DeviceMonitorTest, ANumberThatIsRejectedBeforeALowerOneIsAcceptedIsNotLost) {
  send(0, 10);
  wire::TrackerFrame damaged = tracker_frame(11);
  damaged.tools[0].marker_rms_mm = wire::kUnknown;
  EXPECT_FALSE(guard.check(damaged, kWriter, at(11)).accepted);
  EXPECT_TRUE(guard.check(tracker_frame(10), kWriter, at(11)).accepted);
  send(12, 20);
  EXPECT_EQ(health(at(19)).lost, 0U);
}

TEST_F(DeviceMonitorTest, ANumberThatIsOvertakenIsRejectedAndNotLost) {
  for (std::uint64_t i = 0; i < 400; i += 2) { // every second one is overtaken
    static_cast<void>(guard.check(tracker_frame(i + 1), kWriter, at(i + 1)));
    EXPECT_FALSE(guard.check(tracker_frame(i), kWriter, at(i + 1)).accepted);
    EXPECT_FALSE(guard.check(tracker_frame(i), kWriter, at(i + 1)).accepted) << "and again";
  }
  const auto now = health(at(399));
  EXPECT_EQ(now.taken, 200U);
  EXPECT_EQ(now.lost, 0U);
}

TEST_F(DeviceMonitorTest, NumbersThatAreRejectedForALongTimeAreNotLost) {
  send(0, 100);
  for (std::uint64_t i = 100; i < 400; ++i) { // more than a window of 64
    auto frame = tracker_frame(i);
    frame.tools[0].T_tracker_tool.translation_mm[1] = wire::kUnknown;
    static_cast<void>(guard.check(frame, kWriter, at(i)));
  }
  send(400, 500);
  EXPECT_EQ(health(at(499)).lost, 0U);
  EXPECT_EQ(health(at(499)).rejected[bregma_wire_REJECT_NOT_FINITE], 300U);
}

// A driver's clock may show any time (found by fuzzing).
TEST(StatedPeriod, TimesOfAnyClockAreCompared) {
  constexpr std::int64_t kFirst = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t kLast = std::numeric_limits<std::int64_t>::max();
  StatedPeriod period;
  EXPECT_EQ(period.check(0, kFirst, 4 * kMs), 4 * kMs);
  EXPECT_EQ(period.check(8, kLast, 4 * kMs), 4 * kMs) << "longer than stated";
  EXPECT_EQ(period.check(9, kFirst, kLast), kLast) << "begins anew";
  EXPECT_EQ(period.check(10'009, kFirst + 10'000 * kMs, 2 * kMs), kMs);
  EXPECT_EQ(period.check(10'010, kFirst + 10'001 * kMs, kMs + kMs / 5), kMs + kMs / 5) << "within the tolerance";
  EXPECT_EQ(period.check(10'011, kFirst + 10'002 * kMs, kLast), kMs);
}

TEST_F(DeviceMonitorTest, TheStatedLatencyIsPartOfTheAgeButDoesNotMakeItStale) {
  InputGuard<wire::TrackerFrame> slow(names, DeviceOptions{.clock = {.minimum_latency_ns = 20 * kMs}});
  for (std::uint64_t i = 0; i < 300; ++i) {
    verdict = slow.check(tracker_frame(i), kWriter, at(i));
  }
  EXPECT_EQ(at(299) - verdict.acquired_time_ns, 20 * kMs);
  EXPECT_NEAR(slow.health(at(299)).devices[0].age_ms, 20.0, 1e-3);
  EXPECT_EQ(slow.devices()[0].status(at(299) + 2 * kPeriod_ns), bregma_wire_DEVICE_LIVE);
}

} // namespace
} // namespace bregma::inputs
