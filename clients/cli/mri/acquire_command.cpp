// `bregma mri acquire`: orders a series from a scanner.
#include <chrono>
#include <cmath>
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>

#include "clients/cli/command_reply.hpp"
#include "clients/cli/mri/mri_commands.hpp"
#include "clients/cli/output.hpp"
#include "idl/names.hpp"

namespace bregma::cli {

namespace {

struct AcquireArguments {
  std::string protocol, scanner = "Scanner";
  int slices = 0;
  double timeout_s = 600.0;
};

int run_acquire(const AcquireArguments &arguments, const Context &context) {
  auto command = live::make_command(bregma_wire_COMMAND_ACQUIRE_SERIES,
                                    {arguments.scanner, arguments.protocol, std::to_string(arguments.slices)});
  if (command && !wire::set_name(command->receiver, arguments.scanner)) {
    return fail("\"" + arguments.scanner + "\" is too long for a device's name");
  }
  return send_and_show(command, context, std::chrono::milliseconds(std::llround(1e3 * arguments.timeout_s)));
}

} // namespace

void add_mri_acquire(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("acquire", "Orders a series from a scanner, and waits until it is acquired");
  auto arguments = std::make_shared<AcquireArguments>();
  command->add_option("protocol", arguments->protocol, "Protocol, as the scanner knows it")->required();
  command->add_option("--slices", arguments->slices, "Number of slices; 0: as the protocol has it")
      ->check(CLI::Range(0, 512))
      ->capture_default_str();
  command->add_option("--scanner", arguments->scanner, "Name of the scanner's device")->capture_default_str();
  command->add_option("--timeout-s", arguments->timeout_s, "Wait at most this long for the end of the series")
      ->check(CLI::Range(0.1, 7200.0))
      ->capture_default_str();
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  command->footer("Example:\n  bregma mri acquire tree-coronal --slices 24");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_acquire(*arguments, context); }; });
}

} // namespace bregma::cli
