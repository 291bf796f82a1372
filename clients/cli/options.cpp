#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_json_flag(CLI::App &command, Context &context) {
  command.add_flag("--json", context.json, "Print JSON on standard output");
}

void add_daemon_options(CLI::App &command, Context &context) {
  command.add_option("--domain", context.domain, "DDS domain of the daemon")
      ->check(CLI::Range(0, 230))
      ->capture_default_str();
  command.add_option("--wait", context.wait_s, "Seconds to wait for a daemon that has not started yet")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
}

} // namespace bregma::cli
