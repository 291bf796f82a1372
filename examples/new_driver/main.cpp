// my-force: a driver for a three-axis force sensor that sends lines of text over TCP or a serial line.
#include <string>

#include "drivers/frame/byte_stream.hpp"
#include "drivers/frame/line_splitter.hpp"
#include "drivers/frame/program.hpp"
#include "force_line.hpp"

namespace {

using namespace bregma;

class ForceSensor final : public driver::Device {
public:
  using Writes = driver::Topics<wire::ForceSample>;
  using Reads = driver::Topics<>;

  void declare(base::ParameterSet &parameters) override {
    parameters.string("address", &address_, "Of the sensor: tcp://HOST:PORT or serial:///DEVICE?baud=N")
        .number("rate_hz", &rate_hz_, "Hz", 1.0, 2000.0, "Readings per second, as set in the sensor");
  }

  base::Result<void> prepare(const driver::Settings & /*settings*/) override {
    return driver::check_address("address", address_);
  }

  driver::Outcome<void> connect(driver::Io &io) override {
    lines_.reset();
    return stream_.open(address_, io);
  }

  driver::Outcome<driver::Progress> read(driver::Io &io) override {
    const auto bytes = stream_.read(io);
    if (!bytes) {
      return tl::unexpected(bytes.error());
    }
    const std::int64_t arrival_ns = io.now_ns();
    const std::size_t too_long = lines_.take(*bytes, [&](std::string_view line) { publish(line, arrival_ns, io); });
    if (too_long > 0) {
      io.skipped(too_long, "line too long");
    }
    return driver::Progress::kContinue;
  }

  void disconnect() noexcept override { stream_.close(); }

private:
  void publish(std::string_view line, std::int64_t arrival_ns, driver::Io &io) const {
    const auto reading = force_line::parse(line);
    if (!reading) {
      io.skipped(1, reading.error());
      return;
    }
    wire::ForceSample sample{};
    sample.frame = reading->counter;
    sample.device_time_ns = reading->time_us * 1000;
    sample.period_ns = static_cast<std::int64_t>(1e9 / rate_hz_);
    for (std::size_t i = 0; i < 3; ++i) {
      sample.force_N[i] = reading->force_N[i];
    }
    (void)io.publish(sample, arrival_ns); // publish() counts dropped samples
  }

  std::string address_ = "tcp://127.0.0.1:4600";
  double rate_hz_ = 200.0;
  driver::ByteStream stream_;
  driver::LineSplitter lines_{force_line::kMaxLength};
};

} // namespace

int main(int argc, char **argv) {
  ForceSensor sensor;
  driver::Settings defaults;
  defaults.device = "Force";
  return driver::run(argc, argv,
                     {"my-force", "a three-axis force sensor",
                      "my-force --set address=serial:///dev/ttyUSB0?baud=115200\n"
                      "my-force --set address=tcp://192.168.7.20:4600 --set rate_hz=500 --domain 7",
                      defaults},
                     sensor);
}
