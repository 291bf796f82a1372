// `bregma mri step`: the operator's part of the registration of a scanner.
#include <memory>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>

#include "clients/cli/command_reply.hpp"
#include "clients/cli/mri/mri_commands.hpp"

namespace bregma::cli {

namespace {

struct StepArguments {
  std::string step, scanner = "Scanner";
};

int run_step(const StepArguments &arguments, const Context &context) {
  const auto command = [&] {
    if (arguments.step == "start") {
      return live::make_command(bregma_wire_COMMAND_START_SCANNER_REGISTRATION, {arguments.scanner});
    }
    if (arguments.step == "accept") {
      return live::make_command(bregma_wire_COMMAND_ACCEPT_SCANNER_REGISTRATION, {arguments.scanner});
    }
    if (arguments.step == "reset") {
      return live::make_command(bregma_wire_COMMAND_RESET_SCANNER_REGISTRATION, {arguments.scanner});
    }
    return live::make_command(bregma_wire_COMMAND_CONFIRM_SCANNER_STEP, {arguments.scanner, arguments.step});
  };
  return send_and_show(command(), context);
}

} // namespace

void add_mri_step(CLI::App &mri, Context &context) {
  auto *command = mri.add_subcommand("step", "Starts, confirms or accepts a step of a scanner's registration");
  auto arguments = std::make_shared<StepArguments>();
  command->add_option("step", arguments->step, "start, phantom, swap, top, bottom, verify, accept or reset")
      ->required()
      ->check(CLI::IsMember({"start", "phantom", "swap", "top", "bottom", "verify", "accept", "reset"}));
  command->add_option("--scanner", arguments->scanner, "Name of the scanner's device")->capture_default_str();
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  command->footer("The daemon states what to do next: see `bregma mri register --watch`.\n\nExamples:\n"
                  "  bregma mri step start\n  bregma mri step swap\n  bregma mri step accept");
  command->callback(
      [arguments, &context] { context.run = [arguments, &context] { return run_step(*arguments, context); }; });
}

} // namespace bregma::cli
