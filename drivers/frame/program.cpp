#include "drivers/frame/program.hpp"

#include <cstdio>
#include <exception>
#include <filesystem>
#include <optional>
#include <random>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include "base/standard_output.hpp"
#include "drivers/frame/supervisor.hpp"
#include "drivers/frame/system_host.hpp"

namespace bregma::driver {
namespace {

struct CommandLine {
  std::filesystem::path config;
  std::vector<std::string> assignments;
  std::optional<std::uint32_t> domain;
  bool print_toml = false;
  bool print_table = false;
};

int complain(const Program &program, const std::string &message) {
  std::fprintf(stderr, "%s: %s\n", program.name.c_str(), message.c_str());
  return kExitBadInput;
}

void add_options(CLI::App &app, const Program &program, CommandLine &given) {
  app.add_option("-c,--config", given.config, "parameters, TOML")->check(CLI::ExistingFile);
  app.add_option("-s,--set", given.assignments, "override one parameter: key=value; may be repeated");
  app.add_option("--domain", given.domain, "DDS domain of the daemon, instead of parameter domain_id")
      ->check(CLI::Range(0, 230));
  // These options end the parsing, so that required options are not needed.
  const auto print = [&app](const char *name, bool &flag, const char *text) {
    app.add_flag_callback(
        name,
        [&flag] {
          flag = true;
          throw CLI::Success();
        },
        text);
  };
  print("--print-config", given.print_toml, "print all parameters with their comments, and end");
  print("--print-config-table", given.print_table, "print the parameters as a Markdown table, and end");
  if (program.add_options) {
    program.add_options(app);
  }
  std::string footer = program.examples.empty() ? "" : "Examples:\n";
  std::size_t begin = 0;
  while (begin < program.examples.size()) {
    const std::size_t end = std::min(program.examples.find('\n', begin), program.examples.size());
    footer += "  " + program.examples.substr(begin, end - begin) + "\n";
    begin = end + 1;
  }
  app.footer(footer + "Exit codes: 0 finished or ended by Ctrl-C, 1 the device failed for good, 2 bad input,\n"
                      "3 the device did not return after a signal.");
}

base::Result<void> read_parameters(base::ParameterSet &parameters, Settings &settings, const CommandLine &given) {
  base::Result<void> ok;
  if (!given.config.empty()) {
    ok = parameters.load(given.config);
  }
  if (given.domain) {
    settings.domain_id = *given.domain;
  }
  for (const std::string &assignment : given.assignments) {
    if (ok) {
      ok = parameters.set_from_string(assignment);
    }
  }
  return ok ? check(settings) : ok;
}

// Standard error, with the daemon's pattern.
Log make_log(const std::string &name, LogLevel least) {
  auto logger = std::make_shared<spdlog::logger>(name, std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%fZ %^%l%$ %n: %v", spdlog::pattern_time_type::utc);
  logger->set_level(spdlog::level::debug);
  return [logger, least](LogLevel level, const std::string &text) {
    constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::debug, spdlog::level::info, spdlog::level::warn,
                                                     spdlog::level::err};
    if (level >= least) {
      logger->log(kLevels[static_cast<std::size_t>(level)], text);
    }
  };
}

int serve(const Program &program, const Settings &settings, Device &device, const MakeBus &make_bus) {
  const Signals signals; // before DDS starts its threads
  if (const auto prepared = device.prepare(settings); !prepared) {
    return complain(program, prepared.error().message);
  }
  const std::unique_ptr<Bus> bus = make_bus(static_cast<std::uint32_t>(settings.domain_id));
  const Log log = make_log(program.name, settings.log_level);
  SystemHost host;
  Status status;
  Io io(*bus, host, status, io_options(settings));
  LoopOptions options = loop_options(settings);
  options.backoff_seed = std::random_device{}();
  DriverLoop loop(device, io, status, log, options);
  return supervise(loop, signals, host, status, *bus, log, {.device = settings.device});
}

} // namespace

int run_on_bus(int argc, char **argv, const Program &program, Device &device, const MakeBus &make_bus) {
  try {
    CommandLine given;
    CLI::App app(program.name + ", " + program.description, program.name);
    add_options(app, program, given);
    try {
      app.parse(argc, argv);
    } catch (const CLI::ParseError &error) {
      if (!given.print_toml && !given.print_table) {
        return base::end_output(program.name, app.exit(error) == 0 ? kExitDone : kExitBadInput);
      }
    }
    Settings settings = program.defaults;
    base::ParameterSet parameters(program.name);
    declare(parameters, settings);
    device.declare(parameters);
    if (const auto ok = read_parameters(parameters, settings, given); !ok) {
      return complain(program, ok.error().message);
    }
    if (given.print_toml || given.print_table) {
      std::fputs((given.print_toml ? parameters.to_toml() : parameters.to_markdown()).c_str(), stdout);
      return base::end_output(program.name, kExitDone);
    }
    return serve(program, settings, device, make_bus);
  } catch (const std::exception &error) { // from DDS, or from a device's prepare()
    return complain(program, error.what());
  }
}

} // namespace bregma::driver
