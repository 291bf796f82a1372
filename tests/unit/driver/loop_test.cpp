// The loop of a driver with a device that fails in all ways: retries, their times, and counts.
#include <algorithm>
#include <stdexcept>

#include <gtest/gtest.h>

#include "tests/unit/driver/fakes.hpp"

namespace bregma::driver::test {
namespace {

class Loop : public testing::Test {
protected:
  Ending run(const LoopOptions &options = {}) {
    Io io(bus, host, status, {.device = "Range"});
    DriverLoop loop(
        device, io, status,
        [this](LogLevel level, const std::string &text) {
          log.push_back({level, text});
        },
        options);
    return loop.run();
  }
  [[nodiscard]] bool logged(LogLevel level, const std::string &part) const {
    return std::any_of(log.begin(), log.end(), [&](const LogLine &line) {
      return line.level == level && line.text.find(part) != std::string::npos;
    });
  }

  FakeBus bus;
  FakeHost host;
  FakeDevice device;
  Status status;
  std::vector<LogLine> log;
};

TEST_F(Loop, EndsWhenTheDeviceHasFinished) {
  EXPECT_EQ(run(), Ending::kDone);
  EXPECT_EQ(device.connects, 1);
  EXPECT_EQ(device.disconnects, 1);
  EXPECT_EQ(status.values().state, State::kStopped);
  EXPECT_EQ(status.values().connections, 1U);
  EXPECT_EQ(status.values().failures, 0U);
}

TEST_F(Loop, ConnectsAgainAfterFailuresAndCountsThem) {
  device.on_connect = [this](Io &) -> Outcome<void> {
    return device.connects < 4 ? retry_later("tcp://10.0.0.9:1: Connection refused") : Outcome<void>();
  };
  EXPECT_EQ(run(), Ending::kDone);
  EXPECT_EQ(device.connects, 4);
  EXPECT_EQ(device.disconnects, 4); // also after a failed attempt
  EXPECT_EQ(status.values().failures, 3U);
  EXPECT_EQ(status.values().failure, "tcp://10.0.0.9:1: Connection refused");
  EXPECT_TRUE(logged(LogLevel::kWarning, "Connection refused; next attempt in 0."));
  EXPECT_TRUE(logged(LogLevel::kInfo, "connected"));
}

TEST_F(Loop, ALostConnectionIsReopened) {
  device.on_read = [this](Io &) -> Outcome<Progress> {
    return device.connects == 1 ? Outcome<Progress>(retry_later("closed by the device")) : Progress::kFinished;
  };
  EXPECT_EQ(run(), Ending::kDone);
  EXPECT_EQ(status.values().connections, 2U);
  EXPECT_TRUE(logged(LogLevel::kInfo, "connected again"));
}

TEST_F(Loop, WaitsLongerAfterEachFailureUpToTheLimit) {
  device.on_connect = [this](Io &) -> Outcome<void> {
    return device.connects < 9 ? retry_later("no answer") : Outcome<void>();
  };
  EXPECT_EQ(run({.backoff = {.first_ns = kSecond, .max_ns = 10 * kSecond}}), Ending::kDone);
  ASSERT_EQ(host.waits_ns.size(), 8U);
  const double nominal_s[] = {1, 2, 4, 8, 10, 10, 10, 10};
  for (std::size_t i = 0; i < 8; ++i) {
    const double waited_s = static_cast<double>(host.waits_ns[i]) * 1e-9;
    EXPECT_LE(waited_s, nominal_s[i]) << i;
    EXPECT_GE(waited_s, 0.8 * nominal_s[i]) << i; // the jitter
  }
}

TEST_F(Loop, ALastingConnectionResetsTheDelay) {
  device.on_read = [this](Io &) -> Outcome<Progress> {
    host.now += device.connects == 3 ? 11 * kSecond : kSecond;
    return device.connects == 4 ? Outcome<Progress>(Progress::kFinished) : retry_later("gone");
  };
  EXPECT_EQ(run({.backoff = {.first_ns = kSecond, .max_ns = 10 * kSecond, .jitter = 0.0}}), Ending::kDone);
  EXPECT_EQ(host.waits_ns, (std::vector<std::int64_t>{kSecond, 2 * kSecond, kSecond}));
}

TEST_F(Loop, AnExceptionOfADeviceIsATemporaryFailure) {
  device.on_connect = [this](Io &) -> Outcome<void> {
    if (device.connects == 1) {
      throw std::runtime_error("the vendor's library is not ready");
    }
    return {};
  };
  device.on_read = [this](Io &) -> Outcome<Progress> {
    if (device.connects == 2) {
      throw std::out_of_range("a field is missing");
    }
    return Progress::kFinished;
  };
  EXPECT_EQ(run(), Ending::kDone);
  EXPECT_EQ(status.values().failures, 2U);
  EXPECT_TRUE(logged(LogLevel::kWarning, "the vendor's library is not ready"));
  EXPECT_TRUE(logged(LogLevel::kWarning, "a field is missing"));
}

TEST_F(Loop, APermanentFailureEndsIt) {
  device.on_connect = [](Io &) -> Outcome<void> { return give_up("this tracker has no license"); };
  EXPECT_EQ(run(), Ending::kFailed);
  EXPECT_EQ(device.connects, 1);
  EXPECT_TRUE(host.waits_ns.empty());
  EXPECT_TRUE(logged(LogLevel::kError, "this tracker has no license"));
}

TEST_F(Loop, ASilentConnectionCountsAsLost) {
  device.on_read = [this](Io &io) -> Outcome<Progress> {
    host.now += 200 * kMs;
    if (device.connects == 2) {
      wire::RangeSample sample{};
      sample.device_time_ns = host.now;
      EXPECT_TRUE(io.publish(sample));
      return bus.written.size() == 30 ? Progress::kFinished : Progress::kContinue;
    }
    return Progress::kContinue; // no bytes arrived
  };
  EXPECT_EQ(run({.silence_ns = 2 * kSecond}), Ending::kDone);
  EXPECT_EQ(status.values().connections, 2U);
  EXPECT_EQ(status.values().failures, 1U);
  EXPECT_TRUE(logged(LogLevel::kWarning, "no sample for 2.2 s"));
}

TEST_F(Loop, StopsWhileItWaitsForTheNextAttempt) {
  host.stop_ns = kStart_ns + 3 * kSecond;
  device.on_connect = [](Io &) -> Outcome<void> { return retry_later("no answer"); };
  EXPECT_EQ(run({.backoff = {.first_ns = 60 * kSecond, .max_ns = 60 * kSecond}}), Ending::kDone);
  EXPECT_EQ(device.connects, 1);
  EXPECT_EQ(status.values().state, State::kStopped);
}

TEST_F(Loop, AFailureThatTheStopCausedIsNotReported) {
  device.on_connect = [this](Io &) -> Outcome<void> {
    host.now = host.stop_ns;
    return retry_later("interrupted");
  };
  EXPECT_EQ(run(), Ending::kDone);
  EXPECT_EQ(device.disconnects, 1);
  EXPECT_EQ(status.values().failures, 0U);
}

TEST(Backoff, DiffersBetweenDriversAndIsReproducibleWithItsSeed) {
  const BackoffOptions options{.first_ns = kSecond, .max_ns = 10 * kSecond};
  Backoff one(options, 1);
  Backoff same(options, 1);
  Backoff other(options, 2);
  const std::int64_t delay_ns = one.next_ns();
  EXPECT_EQ(delay_ns, same.next_ns());
  EXPECT_NE(delay_ns, other.next_ns());
}

TEST(Backoff, HundredsOfFailuresStayBelowTheLargestLimit) {
  const std::int64_t largest = std::numeric_limits<std::int64_t>::max() / 2;
  Backoff backoff({.first_ns = kSecond, .max_ns = largest, .jitter = 0.0}, 1);
  for (int i = 0; i < 500; ++i) {
    const std::int64_t delay_ns = backoff.next_ns();
    ASSERT_GT(delay_ns, 0);
    ASSERT_LE(delay_ns, largest);
  }
}

} // namespace
} // namespace bregma::driver::test
