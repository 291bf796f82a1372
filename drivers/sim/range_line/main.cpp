// `bregma-sim-range`: a simulated range sensor behind a pseudo-terminal. Prints the address for the driver.
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "drivers/sim/range_line/simulated_line.hpp"
#include "drivers/sim/terminal/pseudo_terminal.hpp"

namespace {

volatile std::sig_atomic_t stop_requested = 0;

struct Options {
  bregma::range::Identity identity{.model = "GP2Y0A21", .serial = "A4"};
  bregma::sim::RangeLineFaults faults;
  std::string link;
  double volts = 1.3, noise_mV = 5.0;
  std::uint64_t seed = 1;
};

std::uint64_t now_us() {
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now().time_since_epoch())
          .count());
}

int run(const Options &options) {
  using namespace std::chrono_literals;
  auto terminal = bregma::sim::PseudoTerminal::open(options.link);
  if (!terminal) {
    std::fprintf(stderr, "bregma-sim-range: %s\n", terminal.error().message.c_str());
    return 2;
  }
  std::printf("%s\n", terminal->address().c_str());
  std::fflush(stdout);
  bregma::sim::Random noise(options.seed, "range voltage");
  bregma::sim::SimulatedRangeLine sensor(
      options.identity, options.faults,
      [&](std::uint64_t /*time_us*/) { return options.volts + 1e-3 * noise.normal(options.noise_mV); }, options.seed);
  terminal->write(sensor.start());
  while (stop_requested == 0) {
    terminal->write(sensor.receive(terminal->read(1ms)));
    terminal->write(sensor.advance(now_us()));
  }
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  CLI::App app("Simulated range sensor on a pseudo-terminal", "bregma-sim-range");
  Options options;
  app.add_option("--serial", options.identity.serial, "Serial number")->capture_default_str();
  app.add_option("--volts", options.volts, "Voltage of the analogue sensor")
      ->check(CLI::Range(0.0, 5.0))
      ->capture_default_str();
  app.add_option("--noise-mV", options.noise_mV, "Of the voltage, 1 sigma")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--missing-every", options.faults.missing_every, "Every n-th reading is missing; 0: none")
      ->capture_default_str();
  app.add_option("--lost-every", options.faults.lost_every, "Every n-th line is lost; 0: none")->capture_default_str();
  app.add_option("--garbled-every", options.faults.garbled_every, "Every n-th line is damaged; 0: none")
      ->capture_default_str();
  app.add_option("--link", options.link, "Path at which the line appears, as udev names a device");
  app.add_option("--seed", options.seed, "Of noise and damage")->capture_default_str();
  app.footer("Example:\n  bregma-sim-range --link /tmp/range\n"
             "  bregma-range --set address=serial:///tmp/range --set serial_number=A4");
  CLI11_PARSE(app, argc, argv);
  std::signal(SIGINT, [](int) { stop_requested = 1; });
  std::signal(SIGTERM, [](int) { stop_requested = 1; });
  return run(options);
}
