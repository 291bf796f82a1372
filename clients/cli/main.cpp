// `bregma`: the operator's and engineer's command.
#include <cmath>
#include <cstdio>
#include <exception>
#include <string>
#include <string_view>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Option.hpp>
#include <CLI/Validators.hpp>

#include "base/standard_output.hpp"
#include "base/text.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/output.hpp"

namespace {

using bregma::cli::Context;

constexpr void (*kCommands[])(CLI::App &, Context &) = {
    bregma::cli::add_live_commands,  bregma::cli::add_case_command,      bregma::cli::add_register_command,
    bregma::cli::add_arm_command,    bregma::cli::add_calibrate_command, bregma::cli::add_mri_command,
    bregma::cli::add_image_command,  bregma::cli::add_tissue_command,    bregma::cli::add_report_command,
    bregma::cli::add_export_command, bregma::cli::add_doctor_command,    bregma::cli::add_robot_command,
};

// The first word that names no command where one is expected; empty if there is none.
std::string unknown_command(const CLI::App &app) {
  const CLI::App *command = &app;
  while (!command->get_subcommands().empty()) {
    command = command->get_subcommands().back();
  }
  const auto words = command->remaining();
  return words.empty() || command->get_subcommands({}).empty() ? std::string() : words.front();
}

// One sentence: the error, and the help command that shows the correct form.
std::string explain(const CLI::App &app, std::string what) {
  const CLI::App *command = &app;
  std::string path = app.get_name();
  while (!command->get_subcommands().empty()) {
    command = command->get_subcommands().back();
    path += " " + command->get_name();
  }
  if (const std::string unknown = unknown_command(app); !unknown.empty()) {
    what = "unknown command \"" + unknown + "\"";
  }
  return what + " (see " + path + " --help)";
}

// "nan" passes every range, since no comparison with it holds.
void require_finite_numbers(CLI::App &app) {
  for (CLI::Option *option : app.get_options()) {
    if (option->get_type_name().find("FLOAT") != std::string::npos) {
      option->check(CLI::Validator(
          [](const std::string &text) {
            const std::size_t sign = text.starts_with('+') ? 1 : 0;
            const auto value = bregma::base::parsed_number<double>(std::string_view(text).substr(sign));
            return std::string(value && !std::isfinite(*value) ? text + " is not a finite number" : "");
          },
          ""));
    }
  }
  for (CLI::App *command : app.get_subcommands({})) {
    require_finite_numbers(*command);
  }
}

int run(int argc, char **argv) {
  CLI::App app("Bregma: navigation in neurosurgery, from the command line", "bregma");
  app.set_version_flag("--version", "bregma " BREGMA_VERSION " (" BREGMA_BUILD ")");
  app.require_subcommand(1);
  app.footer("Every command has --help with examples, and --json.\n"
             "Exit codes: 0 done; 1 negative result (refused, limit exceeded); 2 the command could not run.");
  Context context;
  for (const auto add : kCommands) {
    add(app, context);
  }
  require_finite_numbers(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success &help) {
    if (!unknown_command(app).empty()) { // `bregma nonsense --help` has no help to show
      return bregma::cli::fail(explain(app, {}));
    }
    return app.exit(help);
  } catch (const CLI::ParseError &error) {
    return bregma::cli::fail(explain(app, error.what()));
  }
  return context.run();
}

} // namespace

int main(int argc, char **argv) {
  try {
    // Before main returns, so that nothing that ends later can cut the output.
    return bregma::base::end_output("bregma", run(argc, argv));
  } catch (const std::exception &error) {
    return bregma::cli::fail(error.what());
  }
}
