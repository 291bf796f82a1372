// The driver of a range sensor against a simulated one on a pseudo-terminal: every reading, lost and damaged lines,
// unplugging, and another sensor on the same line.
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "drivers/frame/system_host.hpp"
#include "drivers/range/range_sensor.hpp"
#include "drivers/sim/range_line/simulated_line.hpp"
#include "drivers/sim/terminal/pseudo_terminal.hpp"

namespace bregma::range {
namespace {

using namespace std::chrono_literals;

class SampleBus final : public driver::Bus {
public:
  bool write(std::string_view topic, const void *sample) override {
    if (topic == wire::Topic<wire::RangeSample>::kName) {
      samples.push_back(*static_cast<const wire::RangeSample *>(sample));
    }
    return true;
  }
  void take(std::string_view /*topic*/, const std::function<void(const void *)> & /*visit*/) override {}
  [[nodiscard]] std::uint32_t matched(std::string_view /*topic*/) const override { return 1; }

  std::vector<wire::RangeSample> samples;
};

// A simulated sensor on a line until it is unplugged. Its time is that of the test.
class PluggedSensor {
public:
  PluggedSensor(const std::string &link, const std::string &serial, const sim::RangeLineFaults &faults = {})
      : terminal_(sim::PseudoTerminal::open(link).value()),
        sensor_(
            {"GP2Y0A21", serial, 12, 5000}, faults, [](std::uint64_t) { return 1.3; }, 5) {}

  // Another sensor answers from now on, and the line stays open.
  void swap_for(const std::string &serial) {
    sensor_ = sim::SimulatedRangeLine(
        {"GP2Y0A21", serial, 12, 5000}, {}, [](std::uint64_t) { return 2.0; }, 6);
  }
  // Answers, and sends the readings of 5 ms.
  void serve() {
    terminal_.write(sensor_.receive(terminal_.read(0ms)));
    time_us_ += 5'000;
    terminal_.write(sensor_.advance(time_us_));
  }

private:
  sim::PseudoTerminal terminal_;
  sim::SimulatedRangeLine sensor_;
  std::uint64_t time_us_ = 1'000'000;
};

class Sensor : public testing::Test {
protected:
  void plug(const std::string &serial, const sim::RangeLineFaults &faults = {}) {
    plugged.reset();
    plugged = std::make_unique<PluggedSensor>(link, serial, faults);
  }
  void prepare(const std::string &serial) {
    base::ParameterSet parameters("bregma-range");
    device.declare(parameters);
    ASSERT_TRUE(parameters.set_from_string("address=serial://" + link));
    ASSERT_TRUE(parameters.set_from_string("serial_number=" + serial));
    ASSERT_TRUE(device.prepare({}));
  }
  // Reads until there are so many samples, or an error, which is returned.
  std::string read_until(std::size_t samples) {
    for (int i = 0; i < 2000 && bus.samples.size() < samples; ++i) {
      if (plugged) {
        plugged->serve();
      }
      if (const auto progress = device.read(io); !progress) {
        return progress.error().message;
      }
    }
    return bus.samples.size() < samples ? "too few samples" : "";
  }
  [[nodiscard]] std::size_t count(wire::RangeStatus expected) const {
    std::size_t out = 0;
    for (const auto &sample : bus.samples) {
      out += sample.status == expected ? 1 : 0;
    }
    return out;
  }

  std::string link = testing::TempDir() + "/range_" + std::to_string(getpid());
  std::unique_ptr<PluggedSensor> plugged;
  SampleBus bus;
  driver::SystemHost host;
  driver::Status status;
  driver::Io io{bus, host, status, {.device = "Range", .map_device_time = false}}; // the sensor's time is not real
  RangeSensor device;
};

TEST(PowerCurve, HasItsDistancesErrorsAndLimits) {
  const Identity sensor{"GP2Y0A21", "A4", 12, 5000};
  const PowerCurve curve{.law = {269.0, -1.19}, .noise_mV = 10.0, .sigma_mm = 0.0};
  const auto at = [&](double volts) {
    return measured(curve, sensor, static_cast<std::uint32_t>(std::lround(volts / 5.0 * 4095.0)));
  };
  const Measured middle = at(1.3);
  ASSERT_EQ(middle.status, bregma_wire_RANGE_VALID);
  EXPECT_NEAR(middle.range_mm, 269.0 * std::pow(1.3, -1.19), 0.1);
  // The distance changes by 180 mm/V here, so 10 mV are 1.8 mm.
  EXPECT_NEAR(middle.sigma_mm, 1.8, 0.02);
  EXPECT_EQ(at(3.0).status, bregma_wire_RANGE_TOO_NEAR);
  EXPECT_EQ(at(0.2).status, bregma_wire_RANGE_TOO_FAR);
  EXPECT_EQ(at(0.0).status, bregma_wire_RANGE_TOO_FAR);
  EXPECT_TRUE(std::isnan(at(0.2).range_mm) && std::isnan(at(0.2).sigma_mm));
}

TEST_F(Sensor, EveryReadingBecomesASample) {
  plug("A4");
  prepare("A4");
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(read_until(500), "");
  for (std::size_t i = 1; i < bus.samples.size(); ++i) {
    ASSERT_EQ(bus.samples[i].frame, bus.samples[i - 1].frame + 1);
    ASSERT_GT(bus.samples[i].device_time_ns, bus.samples[i - 1].device_time_ns);
  }
  EXPECT_EQ(count(bregma_wire_RANGE_VALID), bus.samples.size());
  EXPECT_NEAR(bus.samples.back().range_mm, 269.0 * std::pow(1.3, -1.19), 0.2);
  EXPECT_EQ(bus.samples.back().period_ns, 1'000'000);
  EXPECT_EQ(status.values().skipped, 0U);
}

TEST_F(Sensor, MissingLostAndDamagedReadingsAreSamplesWithThatStatus) {
  plug("A4", {.missing_every = 10, .lost_every = 35, .garbled_every = 49});
  prepare("A4");
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(read_until(1000), "");
  for (std::size_t i = 1; i < bus.samples.size(); ++i) {
    ASSERT_EQ(bus.samples[i].frame, bus.samples[i - 1].frame + 1) << "no number is missing";
  }
  for (const auto &sample : bus.samples) {
    const bool lost = sample.frame % 35 == 0;
    const bool damaged = !lost && sample.frame % 49 == 0;
    const bool missing = lost || (!damaged && sample.frame % 10 == 0);
    ASSERT_EQ(sample.status, damaged   ? bregma_wire_RANGE_GARBLED
                             : missing ? bregma_wire_RANGE_MISSING
                                       : bregma_wire_RANGE_VALID)
        << sample.frame;
  }
  EXPECT_GT(status.values().skipped, 30U);
  for (const auto &sample : bus.samples) {
    ASSERT_EQ(sample.status == bregma_wire_RANGE_VALID, std::isfinite(sample.range_mm));
  }
}

TEST_F(Sensor, AnUnpluggedOneIsAnErrorAndComesBack) {
  plug("A4");
  prepare("A4");
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(read_until(100), "");
  plugged.reset();
  EXPECT_NE(read_until(100'000).find("serial://" + link), std::string::npos);
  device.disconnect();
  EXPECT_FALSE(device.connect(io)) << "there is no line";
  device.disconnect();
  plug("A4");
  io.start_connection();
  ASSERT_TRUE(device.connect(io));
  const std::size_t before = bus.samples.size();
  EXPECT_EQ(read_until(before + 100), "");
}

TEST_F(Sensor, AnotherSensorIsNotUsed) {
  plug("B7");
  prepare("A4");
  ASSERT_TRUE(device.connect(io));
  EXPECT_EQ(read_until(1), "serial://" + link +
                               ": sensor GP2Y0A21 B7 instead of A4 is not used: plug in the right one, or set "
                               "serial_number and its curve");
  EXPECT_TRUE(bus.samples.empty());
}

TEST_F(Sensor, WithoutASerialNumberNoSensorIsUsed) {
  plug("B7");
  prepare("");
  ASSERT_TRUE(device.connect(io));
  EXPECT_EQ(read_until(1), "serial://" + link +
                               ": sensor GP2Y0A21 B7 is not used before a person has checked its curve: set "
                               "serial_number = B7");
  EXPECT_TRUE(bus.samples.empty());
}

TEST_F(Sensor, OneThatIsSwappedOnAnOpenLineIsNoticed) {
  plug("A4");
  prepare("A4");
  ASSERT_TRUE(device.connect(io));
  ASSERT_EQ(read_until(200), "");
  plugged->swap_for("B7"); // its counter begins anew
  const double before_mm = bus.samples.back().range_mm;
  EXPECT_NE(read_until(100'000).find("sensor GP2Y0A21 B7 instead of A4"), std::string::npos);
  for (const auto &sample : bus.samples) {
    ASSERT_NEAR(sample.range_mm, before_mm, 1.0) << "no reading of the other sensor was published";
  }
}

} // namespace
} // namespace bregma::range
