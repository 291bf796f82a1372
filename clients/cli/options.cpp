#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/commands.hpp"

namespace bregma::cli {

void add_json_flag(CLI::App &command, Context &context) {
  command.add_flag("--json", context.json, "Print JSON on standard output");
}

void add_domain_option(CLI::App &command, Context &context) {
  command.add_option("--domain", context.domain, "DDS domain of the daemon")
      ->check(CLI::Range(0, 230))
      ->capture_default_str();
}

} // namespace bregma::cli
