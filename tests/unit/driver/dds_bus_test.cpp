// The bus over DDS: samples of the device's topics and the driver's health, on a separate domain.
#include <chrono>
#include <thread>

#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/frame/dds_bus.hpp"
#include "idl/names.hpp"

namespace bregma::driver {
namespace {

using namespace std::chrono_literals;

template <class Done> bool comes_true(Done &&done) {
  for (int i = 0; i < 500; ++i) {
    if (done()) {
      return true;
    }
    std::this_thread::sleep_for(10ms);
  }
  return false;
}

TEST(DdsBus, CarriesTheDevicesTopicsAndTheDriversHealth) {
  const std::uint32_t domain = 100 + static_cast<std::uint32_t>(getpid()) % 100;
  DdsBus<Topics<wire::RangeSample>, Topics<wire::Command>> bus(domain);
  const dds::Participant observer(domain);
  dds::Reader<wire::RangeSample> samples(observer);
  dds::Reader<wire::DriverHealth> health(observer);
  const dds::Writer<wire::Command> commands(observer);
  ASSERT_TRUE(comes_true([&] { return bus.matched("RangeSample") == 1 && bus.matched("Command") == 1; }));
  ASSERT_TRUE(comes_true([&] { return samples.matched_writers() == 1 && commands.matched_readers() == 1; }));
  EXPECT_EQ(bus.matched("ForceSample"), 0U);

  wire::RangeSample sample{};
  sample.range_mm = 123.0;
  EXPECT_TRUE(bus.write("RangeSample", &sample));
  EXPECT_FALSE(bus.write("ForceSample", &sample)); // not a topic of this driver
  double range_mm = 0.0;
  EXPECT_TRUE(comes_true([&] {
    samples.take_each([&](const wire::RangeSample &taken, const auto &) { range_mm = taken.range_mm; });
    return range_mm == 123.0;
  }));

  wire::DriverHealth sent{};
  sent.state = bregma_wire_DRIVER_WAITING;
  EXPECT_TRUE(bus.write("DriverHealth", &sent));
  EXPECT_TRUE(comes_true([&] {
    wire::DriverState state = bregma_wire_DRIVER_UNKNOWN;
    health.take_each([&](const wire::DriverHealth &taken, const auto &) { state = taken.state; });
    return state == bregma_wire_DRIVER_WAITING;
  }));

  wire::Command command{};
  command.id = 5;
  EXPECT_TRUE(commands.write(command));
  EXPECT_TRUE(comes_true([&] {
    std::uint64_t id = 0;
    bus.take("Command", [&](const void *taken) { id = static_cast<const wire::Command *>(taken)->id; });
    return id == 5;
  }));
}

} // namespace
} // namespace bregma::driver
