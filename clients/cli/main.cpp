// `bregma`: the operator's and engineer's command.
#include <cstdio>
#include <exception>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"

namespace {

using bregma::cli::Context;

constexpr void (*kCommands[])(CLI::App &, Context &) = {
    bregma::cli::add_live_commands,     bregma::cli::add_case_command,   bregma::cli::add_register_command,
    bregma::cli::add_calibrate_command, bregma::cli::add_tissue_command, bregma::cli::add_report_command,
    bregma::cli::add_doctor_command,
};

// One sentence: the error, and the help command that shows the correct form.
std::string explain(const CLI::App &app, const CLI::ParseError &error) {
  const CLI::App *command = &app;
  std::string path = app.get_name();
  while (!command->get_subcommands().empty()) {
    command = command->get_subcommands().back();
    path += " " + command->get_name();
  }
  std::string what = error.what();
  const auto unknown = command->remaining();
  if (!unknown.empty() && !command->get_subcommands({}).empty()) {
    what = "unknown command \"" + unknown.front() + "\"";
  }
  return what + " (see " + path + " --help)";
}

int run(int argc, char **argv) {
  CLI::App app("Bregma: navigation in neurosurgery, from the command line", "bregma");
  app.set_version_flag("--version", std::string("bregma ") + BREGMA_VERSION);
  app.require_subcommand(1);
  app.footer("Every command has --help with examples, and --json.\n"
             "Exit codes: 0 done; 1 negative result (refused, limit exceeded); 2 the command could not run.");
  Context context;
  for (const auto add : kCommands) {
    add(app, context);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success &help) {
    return app.exit(help);
  } catch (const CLI::ParseError &error) {
    return bregma::cli::fail(explain(app, error));
  }
  return context.run();
}

} // namespace

int main(int argc, char **argv) {
  try {
    const int code = run(argc, argv);
    // Before main returns, so that nothing that ends later can cut the output.
    return bregma::cli::flush_output() ? code : bregma::cli::fail("the output could not be written completely");
  } catch (const std::exception &error) {
    return bregma::cli::fail(error.what());
  }
}
