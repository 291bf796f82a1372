// `bregma-sim-range`: a simulated range sensor behind a pseudo-terminal. Prints the address for the driver.
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "base/standard_output.hpp"
#include "base/write_file.hpp"
#include "drivers/sim/range/sharp_sensor.hpp"
#include "drivers/sim/range_line/simulated_line.hpp"
#include "drivers/sim/terminal/pseudo_terminal.hpp"

namespace {

volatile std::sig_atomic_t stop_requested = 0;

struct Options {
  bregma::range::Identity identity{.model = "GP2Y0A21", .serial = "A4"};
  bregma::sim::RangeLineFaults faults;
  std::string link;
  bregma::sim::SharpOptions sensor;
  double distance_mm = 200.0, tilt_deg = 0.0;
  bool moving = false;
  std::uint64_t seed = 1;
  std::string table;
};

// The mean voltage at rest over the distances for which a curve is fitted, as a person measures it on a bench.
int write_table(const Options &options) {
  constexpr double kFrom_mm = 110.0, kTo_mm = 205.0, kStep_mm = 2.5;
  constexpr int kReadings = 1000;
  std::string rows = "reading,distance_mm\n";
  for (double mm = kFrom_mm; mm <= kTo_mm; mm += kStep_mm) {
    bregma::sim::SharpSensor sensor(
        options.sensor,
        [mm](std::int64_t) {
          return bregma::sim::BeamTarget{mm, 0.0, std::nan("")};
        },
        options.seed + static_cast<std::uint64_t>(mm));
    double volts = 0.0;
    for (int i = 0; i < kReadings; ++i) {
      volts += sensor.read_volts(std::int64_t{i} * 1'000'000, false) / kReadings;
    }
    rows += std::to_string(volts) + "," + std::to_string(mm) + "\n";
  }
  if (const auto written = bregma::base::write_file(options.table, rows); !written) {
    std::fprintf(stderr, "bregma-sim-range: %s\n", written.error().message.c_str());
    return 2;
  }
  return 0;
}

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
  const bregma::sim::BeamTarget target{options.distance_mm, options.tilt_deg * static_cast<double>(EIGEN_PI) / 180.0,
                                       std::nan("")};
  bregma::sim::SharpSensor analogue(
      options.sensor, [&](std::int64_t /*time_ns*/) { return target; }, options.seed);
  bregma::sim::SimulatedRangeLine sensor(
      options.identity, options.faults,
      [&](std::uint64_t time_us) {
        return analogue.read_volts(static_cast<std::int64_t>(time_us) * 1'000, options.moving);
      },
      options.seed);
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
  app.add_option("--distance-mm", options.distance_mm, "Of the surface")
      ->check(CLI::Range(1.0, 5000.0))
      ->capture_default_str();
  app.add_option("--tilt-deg", options.tilt_deg, "Of the surface")->check(CLI::Range(0.0, 89.0))->capture_default_str();
  app.add_flag("--moving", options.moving, "With the noise of a moving robot");
  app.add_option("--noise-mV", options.sensor.noise_mV, "Of each of the sensor's values, 1 sigma")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_option("--missing-every", options.faults.missing_every, "Every n-th reading is missing; 0: none")
      ->capture_default_str();
  app.add_option("--lost-every", options.faults.lost_every, "Every n-th line is lost; 0: none")->capture_default_str();
  app.add_option("--garbled-every", options.faults.garbled_every, "Every n-th line is damaged; 0: none")
      ->capture_default_str();
  app.add_option("--link", options.link, "Path at which the line appears, as udev names a device");
  app.add_option("--table", options.table,
                 "Writes voltage and distance from 110 to 205 mm, for bregma calibrate range, and ends");
  app.add_option("--seed", options.seed, "Of noise and damage")->capture_default_str();
  app.footer("Example:\n  bregma-sim-range --link /tmp/range\n"
             "  bregma-range --set address=serial:///tmp/range --set serial_number=A4");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return bregma::base::end_output("bregma-sim-range", app.exit(error) == 0 ? 0 : 2);
  }
  std::signal(SIGINT, [](int) { stop_requested = 1; });
  std::signal(SIGTERM, [](int) { stop_requested = 1; });
  return options.table.empty() ? run(options) : write_table(options);
}
