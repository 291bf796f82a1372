// Input check of streams in virtual time: faulty samples are rejected, counted per reason, and affect no other device.
#include <array>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

#include "server/inputs/input_guard.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/unit/server/inputs/samples.hpp"

namespace bregma::inputs {
namespace {

const std::vector<std::string> kTrackers{"Tracker", "Second"};

std::int64_t at(std::uint64_t i) { return kStart_ns + static_cast<std::int64_t>(i) * kPeriod_ns + kMs; }

std::uint64_t rejected(const wire::DeviceHealth &health) {
  return std::accumulate(std::begin(health.rejected), std::end(health.rejected), std::uint64_t{0});
}

wire::TrackerFrame second_frame(std::uint64_t i) {
  auto frame = tracker_frame(i);
  name(frame.device, "Second");
  return frame;
}

template <class Sample> Sample good(std::uint64_t i);
template <> wire::TrackerFrame good(std::uint64_t i) { return tracker_frame(i); }
template <> wire::RobotState good(std::uint64_t i) { return robot_state(i); }
template <> wire::RobotMotionState good(std::uint64_t i) { return robot_motion(i); }
template <> wire::RangeSample good(std::uint64_t i) { return range_sample(i); }
template <> wire::ForceSample good(std::uint64_t i) { return force_sample(i); }

template <class Sample> class EveryStream : public testing::Test {};
using Streams =
    testing::Types<wire::TrackerFrame, wire::RobotState, wire::RobotMotionState, wire::RangeSample, wire::ForceSample>;
TYPED_TEST_SUITE(EveryStream, Streams);

TYPED_TEST(EveryStream, HeaderRulesHold) {
  const std::string device = wire::text(good<TypeParam>(0).device);
  InputGuard<TypeParam> guard(std::vector<std::string>{device}, {});
  for (std::uint64_t i = 0; i < 300; ++i) {
    ASSERT_TRUE(guard.check(good<TypeParam>(i), 1, at(i)).accepted);
  }
  const auto reason = [&](auto spoil) {
    TypeParam sample = good<TypeParam>(300);
    spoil(sample);
    const auto verdict = guard.check(sample, 1, at(300));
    return verdict.accepted ? std::string("accepted") : std::string(describe(verdict.reason));
  };
  EXPECT_EQ(reason([](auto &s) { name(s.device, "Stranger"); }), "unknown device");
  EXPECT_EQ(reason([](auto &s) { s.device_time_ns = 0; }), "malformed");
  EXPECT_EQ(reason([](auto &s) { s.device_time_ns = std::numeric_limits<std::int64_t>::min(); }), "malformed");
  EXPECT_EQ(reason([](auto &s) { s.device_time_ns = std::numeric_limits<std::int64_t>::max(); }), "malformed");
  EXPECT_EQ(reason([](auto &s) { s.sent_time_ns = -1; }), "malformed");
  EXPECT_EQ(reason([](auto &s) { s.period_ns = 0; }), "malformed");
  EXPECT_EQ(reason([](auto &s) { s.period_ns = -kPeriod_ns; }), "malformed");
  EXPECT_EQ(reason([](auto &s) { s.sent_time_ns += 200 * kMs; }), "time in the future");
  EXPECT_EQ(reason([](auto &s) { s.device_time_ns += 50 * kMs; }), "time in the future");
  EXPECT_EQ(reason([](auto &s) { s.device_time_ns -= 50 * kMs; }), "time backwards");
  EXPECT_EQ(reason([](auto &s) { s.frame -= 1; }), "duplicate");
  EXPECT_EQ(reason([](auto &s) { s.device_time_ns -= 3 * kMs; }), "duplicate"); // a quarter of a period after the last
  EXPECT_EQ(reason([](auto &s) { s.frame += 1'000'000; }), "malformed");
  EXPECT_TRUE(guard.check(good<TypeParam>(301), 1, at(301)).accepted);

  const auto health = guard.health(at(301));
  EXPECT_EQ(health.devices[0].taken, 301U);
  EXPECT_EQ(rejected(health.devices[0]), 12U);
  EXPECT_EQ(health.unknown_device_samples, 1U);
  EXPECT_EQ(health.devices[0].lost, 0U); // number 300 arrived and was rejected
}

TYPED_TEST(EveryStream, ChecksWithoutAllocation) {
  if (!test::AllocationScope::available()) {
    GTEST_SKIP() << "allocations are not counted under sanitizers";
  }
  const std::string device = wire::text(good<TypeParam>(0).device);
  InputGuard<TypeParam> guard(std::vector<std::string>{device}, {});
  const auto first = good<TypeParam>(0);
  const test::AllocationScope scope;
  for (std::uint64_t i = 0; i < 3'000; ++i) {
    auto sample = first;
    sample.frame += i;
    sample.device_time_ns += static_cast<std::int64_t>(i) * kPeriod_ns;
    sample.sent_time_ns = sample.device_time_ns;
    static_cast<void>(guard.check(sample, 1, at(i)));
    static_cast<void>(guard.check(sample, 2, at(i)));
  }
  static_cast<void>(guard.health(at(3'000)));
  EXPECT_EQ(scope.count(), 0U);
}

TEST(InputGuard, ConfigurationErrorsNameTheProblem) {
  const auto message = [](const std::vector<std::string> &names) {
    try {
      const InputGuard<wire::TrackerFrame> guard(names, {});
    } catch (const std::invalid_argument &error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(message({"An optical tracker with a name too long"}),
            "device name 'An optical tracker with a name too long': must have 1 to 31 bytes");
  EXPECT_EQ(message({""}), "device name '': must have 1 to 31 bytes");
  EXPECT_EQ(message(std::vector<std::string>(33, "T")), "more than 32 devices for topic TrackerFrame");
}

TEST(InputGuard, ToolsAreThoseOfTheCase) {
  InputGuard<wire::TrackerFrame> guard(kTrackers, {});
  EXPECT_TRUE(guard.check(tracker_frame(0), 1, at(0)).accepted);
  guard.set_tools(*known_tools(std::vector<std::string>{"Reference", "Probe"}));
  EXPECT_EQ(guard.health(at(0)).unknown_tools.entries()[0].last_ns, 0);
  EXPECT_TRUE(guard.check(tracker_frame(1), 1, at(1)).accepted) << "the other tools of the frame are used";
  const UnknownNames::Entry unknown = guard.health(at(1)).unknown_tools.entries()[0];
  EXPECT_EQ(wire::view(unknown.name), "Stylus");
  EXPECT_EQ(unknown.last_ns, at(1));
}

TEST(InputGuard, NamesTheDevicesThatAreNotConfiguredAndKeepsTheNewest) {
  InputGuard<wire::TrackerFrame> guard(kTrackers, {});
  for (std::uint64_t i = 0; i < 1000; ++i) {
    auto frame = tracker_frame(i);
    name(frame.device, "Flood " + std::to_string(i));
    EXPECT_FALSE(guard.check(frame, 1, at(i)).accepted);
    name(frame.device, "Stranger");
    EXPECT_FALSE(guard.check(frame, 1, at(i)).accepted);
  }
  std::size_t found = 0;
  const StreamHealth health = guard.health(at(1000));
  for (const UnknownNames::Entry &entry : health.unknown_devices.entries()) {
    found += wire::view(entry.name) == "Stranger" && entry.last_ns == at(999) ? 1 : 0;
    EXPECT_GE(entry.last_ns, at(990)) << wire::view(entry.name);
  }
  EXPECT_EQ(found, 1U);
  EXPECT_EQ(guard.unknown_device_samples(), 2000U);
}

// Ten copies of every frame, or ten frames per period: samples of the device are accepted, and all of its neighbour's.
enum class Flood { kCopies, kDense, kAhead };

class FloodedInputGuard : public testing::TestWithParam<Flood> {};

TEST_P(FloodedInputGuard, CountsAllSamplesAndDoesNotAffectOtherDevices) {
  InputGuard<wire::TrackerFrame> guard(kTrackers, {});
  std::uint64_t sent = 0;
  std::int64_t age_ns = 0;
  for (std::uint64_t i = 0; i < 2'000; ++i) {
    const bool flooding = i >= 500 && i < 1'000;
    for (std::uint64_t k = 0; k < (flooding ? 10U : 1U); ++k) {
      const std::int64_t ahead = static_cast<std::int64_t>(k) * kPeriod_ns;
      auto frame = tracker_frame(i);
      std::int64_t now_ns = at(i);
      if (flooding && GetParam() != Flood::kCopies) {
        now_ns += ahead / 10;
        frame.frame += std::uint64_t{9} * (i - 500) + k;
        frame.device_time_ns += GetParam() == Flood::kDense ? ahead / 10 : ahead;
      } else if (!flooding && i >= 1'000 && GetParam() != Flood::kCopies) {
        frame.frame += 4'500;
      }
      frame.sent_time_ns = now_ns;
      static_cast<void>(guard.check(frame, 1, now_ns));
      ++sent;
    }
    ASSERT_TRUE(guard.check(second_frame(i), 2, at(i)).accepted);
    age_ns = at(i) - guard.devices()[0].acquired_time_ns();
  }
  const auto health = guard.health(at(2'000));
  EXPECT_EQ(health.devices[0].taken + rejected(health.devices[0]), sent);
  EXPECT_GT(rejected(health.devices[0]), 3'900U);
  EXPECT_GE(health.devices[0].taken, 1'900U);
  // All samples of a stream that runs ahead are rejected, so the device is lost meanwhile.
  EXPECT_EQ(health.devices[0].connections, GetParam() == Flood::kAhead ? 2U : 1U);
  EXPECT_LT(age_ns, 3 * kPeriod_ns); // after the flood it is live again
  EXPECT_EQ(health.devices[1].taken, 2'000U);
  EXPECT_EQ(rejected(health.devices[1]), 0U);
  EXPECT_EQ(health.devices[1].late, 0U);
}

INSTANTIATE_TEST_SUITE_P(Kinds, FloodedInputGuard, testing::Values(Flood::kCopies, Flood::kDense, Flood::kAhead));

TEST(InputGuard, ADeviceRecoversAfterAClockJump) {
  for (const std::int64_t by_ns : {10'000 * kMs, -10'000 * kMs, 40 * kMs, -40 * kMs}) {
    SCOPED_TRACE(by_ns);
    InputGuard<wire::TrackerFrame> guard(kTrackers, {});
    std::uint64_t refused = 0;
    std::int64_t last_acquired = 0;
    for (std::uint64_t i = 0; i < 1'000; ++i) {
      auto frame = tracker_frame(i);
      frame.device_time_ns += i >= 500 ? by_ns : 0;
      const auto verdict = guard.check(frame, 1, at(i));
      refused += verdict.accepted ? 0 : 1;
      if (verdict.accepted) {
        EXPECT_GT(verdict.acquired_time_ns, last_acquired); // accepted times increase
        last_acquired = verdict.acquired_time_ns;
      }
    }
    EXPECT_GE(refused, 48U);
    EXPECT_LE(refused, 52U); // 200 ms
    EXPECT_EQ(guard.devices()[0].resyncs(), 1U);
    EXPECT_EQ(guard.health(at(999)).devices[0].lost, 0U);
    EXPECT_EQ(guard.devices()[0].status(at(999)), bregma_wire_DEVICE_LIVE);
  }
}

// For arbitrary samples in arbitrary order: every sample is accepted or rejected, and no invalid one is accepted.
TEST(InputGuard, EverySampleOfRandomTrafficIsCounted) {
  constexpr unsigned kSeed = 23;
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  std::mt19937_64 random(kSeed);
  const auto any = [&](std::uint64_t below) {
    return std::uniform_int_distribution<std::uint64_t>(0, below - 1)(random);
  };
  InputGuard<wire::TrackerFrame> guard(kTrackers, {});
  constexpr std::uint64_t kSamples = 50'000;
  std::int64_t last_acquired = 0;
  for (std::uint64_t i = 0; i < kSamples; ++i) {
    auto frame = tracker_frame(i);
    auto *bytes = reinterpret_cast<unsigned char *>(&frame);
    if (any(3) == 0) { // flips random bits
      for (int flips = 0; flips < 3; ++flips) {
        bytes[any(sizeof frame)] ^= static_cast<unsigned char>(1U << any(8));
      }
    }
    const auto verdict = guard.check(frame, any(500) == 0 ? 2 : 1, at(i));
    if (verdict.accepted && verdict.device == 0) {
      EXPECT_GT(verdict.acquired_time_ns, last_acquired);
      EXPECT_LE(verdict.acquired_time_ns, at(i) + 10 * kMs);
      last_acquired = verdict.acquired_time_ns;
      EXPECT_LE(frame.tool_count, 8U);
    }
  }
  const auto health = guard.health(at(kSamples));
  EXPECT_EQ(health.devices[0].taken + rejected(health.devices[0]) + health.devices[1].taken +
                rejected(health.devices[1]) + health.unknown_device_samples,
            kSamples);
  EXPECT_GT(health.devices[0].taken, kSamples / 2);
}

TEST(InputGuard, HealthIsAppendedToTheSystemHealth) {
  InputGuard<wire::TrackerFrame> trackers(kTrackers, {});
  InputGuard<wire::RangeSample> ranges(std::vector<std::string>{"Range"}, {});
  static_cast<void>(ranges.check(range_sample(0), 1, at(0)));
  static_cast<void>(trackers.check(stamped<wire::TrackerFrame>("Stranger", 0), 1, at(0)));
  wire::SystemHealth health{};
  add_to(health, trackers.health(at(0)));
  add_to(health, ranges.health(at(0)));
  ASSERT_EQ(health.device_count, 3U);
  EXPECT_EQ(wire::text(health.devices[1].device), "Second");
  EXPECT_EQ(health.devices[2].kind, bregma_wire_DEVICE_RANGE);
  EXPECT_EQ(health.devices[2].taken, 1U);
  EXPECT_EQ(health.unknown_device_samples, 1U);
}

} // namespace
} // namespace bregma::inputs
