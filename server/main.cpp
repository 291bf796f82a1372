// bregmad: reads its configuration, then runs until it receives a signal to stop.
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/standard_output.hpp"
#include "server/config.hpp"
#include "server/daemon.hpp"
#include "server/runtime/logging.hpp"

namespace {

constexpr int kBadInput = 2;

std::string level_name(bregma::server::LogLevel level) {
  switch (level) {
  case bregma::server::LogLevel::kDebug:
    return "debug";
  case bregma::server::LogLevel::kInfo:
    return "info";
  case bregma::server::LogLevel::kWarning:
    return "warn";
  case bregma::server::LogLevel::kError:
    break;
  }
  return "error";
}

int written(int code = 0) { return bregma::base::end_output("bregmad", code); }

int serve(int argc, char **argv) {
  CLI::App app("bregmad, the real-time core of neurosurgical navigation");
  app.set_version_flag("--version", "bregmad " BREGMA_VERSION " (" BREGMA_BUILD ")");
  std::filesystem::path file;
  std::vector<std::string> assignments;
  bool print_toml = false;
  bool print_markdown = false;
  app.add_option("-c,--config", file, "configuration, TOML")->check(CLI::ExistingFile);
  app.add_option("-s,--set", assignments, "override one parameter: key=value; may be repeated");
  app.add_flag("--print-config", print_toml, "print the complete configuration with its comments, and end");
  app.add_flag("--print-config-table", print_markdown, "print the parameters as a Markdown table, and end");
  app.footer("Examples:\n"
             "  bregmad --print-config > bregmad.toml\n"
             "  bregmad --config bregmad.toml\n"
             "  bregmad --set domain_id=7 --set navigation.floor_rate_hz=100");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return written(app.exit(error) == 0 ? 0 : kBadInput);
  }

  bregma::server::Config config;
  bregma::base::ParameterSet parameters = declare(config);
  bregma::base::Result<void> ok;
  if (!file.empty()) {
    ok = parameters.load(file);
  }
  for (const std::string &assignment : assignments) {
    if (ok) {
      ok = parameters.set_from_string(assignment);
    }
  }
  if (ok) {
    ok = check(config);
  }
  if (!ok) {
    std::fprintf(stderr, "bregmad: %s\n", ok.error().message.c_str());
    return kBadInput;
  }
  if (print_toml || print_markdown) {
    std::cout << (print_toml ? parameters.to_toml() : parameters.to_markdown());
    return written();
  }
  if (const auto logging = bregma::runtime::start_logging({level_name(config.log.level), config.log.file}); !logging) {
    std::fprintf(stderr, "bregmad: %s\n", logging.error().message.c_str());
    return kBadInput;
  }
  bregma::server::Daemon(config, parameters.to_toml()).run();
  bregma::runtime::stop_logging();
  return 0;
}

} // namespace

int main(int argc, char **argv) {
  try {
    return serve(argc, argv);
  } catch (const std::exception &error) {
    std::fprintf(stderr, "bregmad: %s\n", error.what());
    return 1;
  }
}
