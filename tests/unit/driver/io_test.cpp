// Fields that the frame completes in a sample, and the mapping of a device's clock to the host's.
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "tests/unit/driver/fakes.hpp"

namespace bregma::driver::test {
namespace {

constexpr std::int64_t kPeriod_ns = 5 * kMs;
constexpr std::int64_t kLatency_ns = 3 * kMs;
constexpr std::int64_t kOffset_ns = -86'400 * kSecond; // device minus host: switched on a day late
constexpr double kDrift = 50e-6;

class Samples : public testing::Test {
protected:
  // Sends `count` samples of a device with clock offset and drift, with an exponential delay.
  void send(int count) {
    for (int i = 0; i < count; ++i, ++number_) {
      const std::int64_t exposed_ns = kStart_ns + number_ * kPeriod_ns;
      const std::int64_t arrival_ns =
          exposed_ns + kLatency_ns + std::llround(std::exponential_distribution(1.0 / 3e5)(random_));
      wire::RangeSample sample{};
      sample.frame = static_cast<std::uint64_t>(number_);
      sample.period_ns = kPeriod_ns;
      sample.device_time_ns =
          exposed_ns + offset_ns + std::llround(kDrift * static_cast<double>(exposed_ns - kStart_ns));
      host.now = std::max(host.now, arrival_ns);
      (void)io.publish(sample, arrival_ns);
    }
  }
  [[nodiscard]] double error_ms(const wire::RangeSample &sample) const {
    const std::int64_t exposed_ns = kStart_ns + static_cast<std::int64_t>(sample.frame) * kPeriod_ns;
    return static_cast<double>(sample.device_time_ns - exposed_ns) * 1e-6;
  }

  FakeBus bus;
  FakeHost host;
  Status status;
  Io io{bus, host, status, {.device = "Range", .minimum_latency_ns = kLatency_ns}};
  std::int64_t offset_ns = kOffset_ns;

private:
  std::int64_t number_ = 0;
  std::mt19937_64 random_{7};
};

TEST_F(Samples, CarryTheDevicesNameAndTheHostsTime) {
  send(1);
  ASSERT_EQ(bus.written.size(), 1U);
  EXPECT_EQ(wire::view(bus.written[0].device), "Range");
  EXPECT_EQ(bus.written[0].sent_time_ns, host.now);
  EXPECT_EQ(bus.written[0].boot_id[0], 7);
  EXPECT_EQ(bus.written[0].sent_boot_ns, host.now - kStart_ns + kSecond);
  EXPECT_EQ(bus.written[0].sent_clock_error_ns, 2 * kMs);
  wire::RangeSample named{};
  ASSERT_TRUE(wire::set_name(named.device, "Other"));
  named.device_time_ns = kSecond;
  io.start_connection();
  EXPECT_TRUE(io.publish(named));
  EXPECT_EQ(wire::view(bus.written[1].device), "Other");
}

TEST_F(Samples, AStepOfTheWallClockChangesOnlyTheStatedTimeOfTheWrite) {
  send(2000);
  host.wall_lead_ns = -3600 * kSecond;
  send(100);
  ASSERT_EQ(bus.written.size(), 2100U) << "none is dropped";
  EXPECT_EQ(bus.written.back().sent_time_ns, host.now - 3600 * kSecond);
  EXPECT_EQ(bus.written.back().sent_boot_ns, host.now - kStart_ns + kSecond);
  EXPECT_NEAR(error_ms(bus.written.back()), 0.0, 0.1);
}

TEST_F(Samples, DeviceTimeIsMappedToTheHostsClock) {
  send(4000); // 20 s
  ASSERT_EQ(bus.written.size(), 4000U);
  for (std::size_t i = 1000; i < bus.written.size(); ++i) {
    ASSERT_NEAR(error_ms(bus.written[i]), 0.0, 0.1) << i;
  }
  EXPECT_NEAR(status.values().clock_offset_ms, -1e-6 * static_cast<double>(kOffset_ns), 2.0);
  EXPECT_NEAR(status.values().clock_drift_ppm, -50.0, 10.0);
}

TEST_F(Samples, AfterAClockChangeSamplesAreDroppedAndCountedUntilItIsConfirmed) {
  send(2000);
  offset_ns += 60 * kSecond;
  send(1000);
  const StatusValues values = status.values();
  EXPECT_EQ(values.clock_resyncs, 1U);
  EXPECT_GT(values.out_of_step, 0U);
  EXPECT_LT(values.out_of_step, 100U);
  EXPECT_EQ(values.published + values.out_of_step, 3000U);
  EXPECT_NEAR(error_ms(bus.written.back()), 0.0, 1.0);
}

TEST_F(Samples, ANewConnectionMayHaveANewClock) {
  send(2000);
  offset_ns -= 3600 * kSecond;
  io.start_connection();
  send(10);
  EXPECT_EQ(status.values().out_of_step, 0U);
  EXPECT_NEAR(error_ms(bus.written.back()), 0.0, 2.0);
}

TEST_F(Samples, ArePublishedUnchangedIfTheDriverRequestsIt) {
  Io as_given(bus, host, status, {.device = "Range", .map_device_time = false});
  wire::RangeSample sample{};
  sample.device_time_ns = 42;
  EXPECT_TRUE(as_given.publish(sample));
  sample.device_time_ns = 41; // backwards: checked by the daemon
  EXPECT_TRUE(as_given.publish(sample));
  EXPECT_EQ(bus.written[0].device_time_ns, 42);
  EXPECT_EQ(bus.written[1].device_time_ns, 41);
}

TEST_F(Samples, DroppedSamplesAreReportedInOneLine) {
  const StatusValues before = status.values();
  EXPECT_FALSE(dropped_text(before, status.values()));
  bus.refuses = true;
  send(2);
  io.skipped(3, "wrong checksum");
  wire::RangeSample late{};
  EXPECT_FALSE(io.publish(late));
  EXPECT_EQ(dropped_text(before, status.values()),
            "dropped: 3 unreadable (last: wrong checksum); 1 out of step with the device's clock; 2 refused by DDS");
}

TEST_F(Samples, SubscribedTopicsReachTheDevice) {
  wire::CommandReply reply{};
  reply.id = 7;
  bus.replies = {reply};
  std::vector<std::uint64_t> ids;
  io.take<wire::CommandReply>([&](const wire::CommandReply &taken) { ids.push_back(taken.id); });
  io.take<wire::CommandReply>([&](const wire::CommandReply &taken) { ids.push_back(taken.id); });
  EXPECT_EQ(ids, std::vector<std::uint64_t>{7});
  EXPECT_EQ(io.matched<wire::RangeSample>(), 3U);
}

TEST(Health, PublishesTheCounts) {
  StatusValues values;
  values.state = State::kWaiting;
  values.failures = 3;
  values.failure = std::string(300, 'x');
  const wire::DriverHealth sample = to_wire(values, "Range", 20, 10);
  EXPECT_EQ(wire::view(sample.device), "Range");
  EXPECT_EQ(sample.state, bregma_wire_DRIVER_WAITING);
  EXPECT_EQ(sample.failures, 3U);
  EXPECT_EQ(std::string(sample.failure).size(), sizeof sample.failure - 1);
  EXPECT_TRUE(std::isnan(sample.clock_offset_ms));
}

} // namespace
} // namespace bregma::driver::test
