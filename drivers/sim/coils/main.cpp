// `bregma-sim-coils`: a simulated coil controller behind a pseudo-terminal. Prints the address for the driver, then
// every change of its coils.
#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cinttypes>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "drivers/sim/coils/simulated_controller.hpp"

namespace {

volatile std::sig_atomic_t stop_requested = 0;

std::int64_t now_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

// The controller's end of a new terminal, and a descriptor that keeps the other end open.
int open_terminal(std::string &address) {
  const int controller = posix_openpt(O_RDWR | O_NOCTTY);
  std::array<char, 128> path{};
  if (controller < 0 || grantpt(controller) != 0 || unlockpt(controller) != 0 ||
      ptsname_r(controller, path.data(), path.size()) != 0) {
    return -1;
  }
  const int line = open(path.data(), O_RDWR | O_NOCTTY);
  termios settings{};
  if (line < 0 || tcgetattr(line, &settings) != 0) {
    return -1;
  }
  cfmakeraw(&settings);
  (void)tcsetattr(line, TCSANOW, &settings);
  address = "serial://" + std::string(path.data());
  return controller;
}

int run(const bregma::sim::CoilFaults &faults, std::uint64_t seed) {
  std::string address;
  const int terminal = open_terminal(address);
  if (terminal < 0) {
    std::perror("bregma-sim-coils: pseudo-terminal");
    return 2;
  }
  std::printf("%s\n", address.c_str());
  std::fflush(stdout);
  bregma::sim::SimulatedController controller(faults, seed);
  std::uint64_t shown = 0;
  while (stop_requested == 0) {
    pollfd wait{terminal, POLLIN, 0};
    if (poll(&wait, 1, 20) > 0 && (wait.revents & POLLIN) != 0) {
      std::array<char, 512> bytes{};
      const ssize_t n = ::read(terminal, bytes.data(), bytes.size());
      if (n > 0) {
        const std::string answer = controller.receive({bytes.data(), static_cast<std::size_t>(n)}, now_ms());
        if (!answer.empty() && ::write(terminal, answer.data(), answer.size()) < 0) {
          std::perror("bregma-sim-coils: write");
        }
      }
    }
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
  CLI11_PARSE(app, argc, argv);
  std::signal(SIGINT, [](int) { stop_requested = 1; });
  std::signal(SIGTERM, [](int) { stop_requested = 1; });
  return run(faults, seed);
}
