// `bregma-sim-coils`: a simulated coil controller behind a pseudo-terminal. Prints the address for the driver, then
// every change of its coils.
#include <chrono>
#include <cinttypes>
#include <csignal>
#include <cstdio>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "base/standard_output.hpp"
#include "drivers/sim/coils/simulated_controller.hpp"
#include "drivers/sim/terminal/pseudo_terminal.hpp"

namespace {

volatile std::sig_atomic_t stop_requested = 0;

std::int64_t now_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

int run(const bregma::sim::CoilFaults &faults, std::uint64_t seed) {
  using namespace std::chrono_literals;
  auto terminal = bregma::sim::PseudoTerminal::open();
  if (!terminal) {
    std::fprintf(stderr, "bregma-sim-coils: %s\n", terminal.error().message.c_str());
    return 2;
  }
  std::printf("%s\n", terminal->address().c_str());
  std::fflush(stdout);
  bregma::sim::SimulatedController controller(faults, seed);
  std::uint64_t shown = 0;
  while (stop_requested == 0) {
    terminal->write(controller.receive(terminal->read(20ms), now_ms()));
    controller.advance(now_ms());
    if (controller.on() != shown) {
      shown = controller.on();
      std::printf("coils %" PRIX64 " %.1f mA\n", shown, shown == 0 ? 0.0 : controller.current_mA());
      std::fflush(stdout);
    }
  }
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  CLI::App app("Simulated coil controller on a pseudo-terminal", "bregma-sim-coils");
  bregma::sim::CoilFaults faults;
  std::uint64_t seed = 1;
  app.add_option("--open", faults.open, "Coils with an open cable, as bits")->capture_default_str();
  app.add_option("--gain", faults.gain, "Of the amplifier")->check(CLI::Range(0.0, 2.0))->capture_default_str();
  app.add_option("--seed", seed, "Of the measurements' noise")->capture_default_str();
  app.footer("Example:\n  bregma-sim-coils\n  bregma-coils --set address=serial:///dev/pts/7 --set frame=frame.toml");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return bregma::base::end_output("bregma-sim-coils", app.exit(error) == 0 ? 0 : 2);
  }
  std::signal(SIGINT, [](int) { stop_requested = 1; });
  std::signal(SIGTERM, [](int) { stop_requested = 1; });
  return run(faults, seed);
}
