// A driver's main function: command line, parameters, DDS, log, signals, exit code.
//
//   int main(int argc, char **argv) {
//     RangeSensor sensor;
//     return bregma::driver::run(argc, argv,
//                                {.name = "my-range", .description = "an infrared range sensor on a serial line",
//                                 .examples = "my-range --set address=serial:///dev/ttyUSB0?baud=115200",
//                                 .defaults = {.device = "Range"}},
//                                sensor);
//   }
//
// Options of every driver: --config FILE, --set key=value, --domain N, --print-config, --print-config-table, --help.
// Precedence, lowest first: defaults, --config, --domain, --set. Exit codes: supervisor.hpp.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "drivers/frame/dds_bus.hpp"
#include "drivers/frame/settings.hpp"

namespace CLI {
class App;
}

namespace bregma::driver {

struct Program {
  std::string name;        // name of the executable
  std::string description; // the device, in a line
  std::string examples;    // command lines for --help, one per line
  Settings defaults;
  std::function<void(CLI::App &)> add_options = {}; // additional options
};

using MakeBus = std::function<std::unique_ptr<Bus>(std::uint32_t domain)>;

// The part that does not depend on the device's topics. make_bus may throw dds::Error.
[[nodiscard]] int run_on_bus(int argc, char **argv, const Program &program, Device &device, const MakeBus &make_bus);

template <class D> [[nodiscard]] int run(int argc, char **argv, const Program &program, D &device) {
  return run_on_bus(argc, argv, program, device, [](std::uint32_t domain) -> std::unique_ptr<Bus> {
    return std::make_unique<DdsBus<typename D::Writes, typename D::Reads>>(domain);
  });
}

} // namespace bregma::driver
