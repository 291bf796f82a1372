// `bregma doctor`: checks whether this machine can keep the rates, and names the settings to change.
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <unistd.h>

#include "base/read_file.hpp"
#include "clients/cli/commands.hpp"
#include "clients/cli/completion.hpp"
#include "clients/cli/doctor_measurements.hpp"
#include "clients/cli/doctor_network.hpp"
#include "clients/cli/live_view.hpp"
#include "clients/cli/output.hpp"
#include "clients/cli/plain_text.hpp"
#include "clients/cli/support_bundle.hpp"
#include "clients/live/daemon_link.hpp"
#include "idl/version.hpp"
#include "server/runtime/realtime.hpp"
#include "server/runtime/state_directory.hpp"

namespace bregma::cli {
namespace {

using namespace std::chrono_literals;
using runtime::Fitness;
using runtime::RealtimeCheck;

struct DoctorOptions {
  bool quick = false;
  std::string state_directory;
  std::string case_folder;
  std::string bundle, configuration, log;
};

// Where an installed daemon has its configuration (deploy/bregmad.service).
constexpr const char *kInstalledConfiguration = "/etc/bregma/bregmad.toml";
constexpr std::size_t kMaxText = std::size_t{64} << 20; // the log is rotated at 10 MB
constexpr const char *kBundleText =
    "A support bundle of Bregma, made by `bregma doctor --bundle`.\n\n"
    "versions.txt        of the program and of the wire\n"
    "machine.txt         kernel, distribution, processor, memory\n"
    "doctor.json         checks and measurements of this machine\n"
    "health.json         counters of the running daemon: devices by their kind, loops, alarms by their kind\n"
    "configuration.toml  parameters; texts that are not ours are replaced by their length\n"
    "log.txt             time, level and our own words of each line; the rest is replaced by its length\n\n"
    "It has no image, no name of a case, patient, point, tool, device, user or machine, and no path. Read it before\n"
    "you send it.\n";

const char *word(Fitness fitness) {
  return fitness == Fitness::kGood ? "good" : fitness == Fitness::kLimited ? "limited" : "bad";
}

RealtimeCheck check_timer(std::chrono::nanoseconds duration) {
  constexpr std::int64_t kPeriod_ns = 1'000'000;
  const auto timer = runtime::measure_timer(kPeriod_ns, static_cast<int>(duration.count() / kPeriod_ns));
  RealtimeCheck out;
  out.name = "timer at 1 kHz";
  out.finding = "wakes late by p50 " + fixed(timer.p50_us, 0) + ", p99 " + fixed(timer.p99_us, 0) + ", max " +
                fixed(timer.max_us, 0, "us") + (timer.fifo ? " with SCHED_FIFO" : " without SCHED_FIFO");
  const bool good = timer.p99_us <= 100.0 && timer.max_us <= 1000.0; // limits: a tenth of the period, and one period
  out.fitness = good ? Fitness::kGood : timer.p99_us <= 500.0 ? Fitness::kLimited : Fitness::kBad;
  if (!good) {
    out.advice = timer.fifo
                     ? "end other load, or keep cores free for the loops (isolcpus=, or CPUAffinity= of the unit)"
                     : "allow SCHED_FIFO (LimitRTPRIO=80 of the unit) and measure again";
  }
  return out;
}

RealtimeCheck check_loopback(EchoProcess &echo, double rate_hz, std::chrono::nanoseconds duration) {
  RealtimeCheck out;
  out.name = "DDS round trip at " + fixed(rate_hz, 0, "Hz");
  const auto measured = echo.measure(rate_hz, duration);
  if (!measured || measured->round_trip_us.count == 0) {
    out.fitness = Fitness::kBad;
    out.finding = measured ? "no frame was returned" : measured.error().message;
    out.advice = "allow UDP on the loopback interface; see CYCLONEDDS_URI";
    return out;
  }
  const Spread &time = measured->round_trip_us;
  const std::size_t lost = measured->sent - std::min(measured->sent, time.count);
  out.finding = "p50 " + fixed(time.p50, 0) + ", p99 " + fixed(time.p99, 0) + ", p99.9 " + fixed(time.p999, 0) +
                ", max " + fixed(time.max, 0, "us") + ", " + std::to_string(lost) + " of " +
                std::to_string(measured->sent) + " lost";
  const double period_us = 1e6 / rate_hz;
  out.fitness = time.p99 <= 0.5 * period_us && lost == 0 ? Fitness::kGood
                : time.p99 <= period_us                  ? Fitness::kLimited
                                                         : Fitness::kBad;
  if (out.fitness != Fitness::kGood) {
    out.advice = lost > 0 ? "raise net.core.rmem_max, or end other load"
                          : "end other load, allow SCHED_FIFO, or run the tracker slower: a round trip takes a large "
                            "part of a frame's period";
  }
  return out;
}

RealtimeCheck check_disk(const std::filesystem::path &wanted, int blocks) {
  const auto directory = existing_part(wanted);
  RealtimeCheck out;
  out.name = "disk of " + directory.string();
  const auto measured = measure_disk(directory, blocks);
  if (!measured) {
    out.fitness = Fitness::kBad;
    out.finding = measured.error().message;
    out.advice = "give the daemon a directory it may write: state.directory, or StateDirectory= of the unit";
    return out;
  }
  out.finding = "write and fsync of 64 KiB p50 " + fixed(measured->p50, 1) + ", p99 " + fixed(measured->p99, 1) +
                ", max " + fixed(measured->max, 1, "ms");
  // By default the daemon commits every 50 ms, and a crash may lose at most the last 100 ms.
  out.fitness = measured->p99 <= 20.0 ? Fitness::kGood : measured->p99 <= 80.0 ? Fitness::kLimited : Fitness::kBad;
  if (out.fitness != Fitness::kGood) {
    out.advice = "put state.directory on a faster disk: more than the last 100 ms could be lost in a power cut";
  }
  return out;
}

RealtimeCheck check_space(const std::filesystem::path &wanted) {
  const auto directory = existing_part(wanted);
  RealtimeCheck out;
  out.name = "space in " + directory.string();
  const auto space = recording_space(directory);
  if (!space) {
    out.fitness = Fitness::kBad;
    out.finding = space.error().message;
    return out;
  }
  out.finding = space_text(*space);
  // An operation lasts some hours, and its recording must not end before it.
  out.fitness = space->hours() >= 8.0 ? Fitness::kGood : space->hours() >= 1.0 ? Fitness::kLimited : Fitness::kBad;
  if (out.fitness != Fitness::kGood) {
    out.advice = "remove or move old recordings (sessions/ of the case folders), or use a larger disk";
  }
  return out;
}

nlohmann::json checks_json(const std::vector<RealtimeCheck> &checks, const char *verdict) {
  nlohmann::json list = nlohmann::json::array();
  for (const auto &check : checks) {
    list.push_back(
        {{"name", check.name}, {"verdict", word(check.fitness)}, {"finding", check.finding}, {"advice", check.advice}});
  }
  return {{"verdict", verdict}, {"checks", std::move(list)}};
}

std::string health_text(const Context &context) {
  try {
    live::DaemonLink link(context.domain, live::DaemonLink::Role::kReads, context.wait_s);
    static_cast<void>(link.wait_for_daemon());
    if (!link.snapshot().health) {
      return json_text({{"daemon", "none answers on domain " + std::to_string(context.domain)}}, 2) + "\n";
    }
    link.settle();
    return json_text(anonymous_health(*link.snapshot().health, standing_alarms(link.snapshot())), 2) + "\n";
  } catch (const dds::Error &error) { // may be the fault that the bundle is for
    return json_text({{"daemon", without_paths(error.what())}}, 2) + "\n";
  }
}

base::Result<void> make_bundle(const DoctorOptions &options, const nlohmann::json &checks, const Context &context) {
  std::error_code ignored;
  std::string configuration = "# Not given: --config FILE\n";
  const bool installed = std::filesystem::exists(kInstalledConfiguration, ignored);
  if (!options.configuration.empty() || installed) {
    const auto text =
        base::read_file(options.configuration.empty() ? kInstalledConfiguration : options.configuration, kMaxText);
    if (!text) {
      return tl::unexpected(text.error());
    }
    configuration = anonymous_configuration(*text);
  }
  std::string log = "Not given: --log FILE, which is log.file of the configuration, or the output of\n"
                    "journalctl -u bregmad -o cat\n";
  if (!options.log.empty()) {
    const auto text = base::read_file(options.log, kMaxText);
    if (!text) {
      return tl::unexpected(text.error());
    }
    log = anonymous_log(*text);
  }
  const BundlePart parts[] = {{"README.txt", kBundleText},
                              {"versions.txt", "bregma " BREGMA_VERSION " (" BREGMA_BUILD ")\nwire " +
                                                   wire::text_of(wire::kWireVersion) + "\n"},
                              {"machine.txt", machine_text()},
                              {"doctor.json", without_paths(json_text(checks, 2)) + "\n"},
                              {"health.json", health_text(context)},
                              {"configuration.toml", configuration},
                              {"log.txt", log}};
  return write_bundle(options.bundle, parts);
}

int run_doctor(const DoctorOptions &options, const Context &context) {
  std::error_code ignored;
  if (!options.bundle.empty() && std::filesystem::exists(options.bundle, ignored)) {
    return fail(options.bundle + ": exists already"); // before the measurements, which take time
  }
  const auto domain =
      200 + static_cast<std::uint32_t>(getpid()) % 30; // a separate domain, so that the check disturbs no daemon
  EchoProcess echo(domain);
  const auto duration = options.quick ? std::chrono::nanoseconds(500ms) : std::chrono::nanoseconds(2s);
  std::vector<RealtimeCheck> checks = runtime::check_realtime();
  checks.push_back(check_timer(options.quick ? duration : 3s));
  checks.push_back(check_loopback(echo, 250.0, duration));
  checks.push_back(check_loopback(echo, 1000.0, duration));
  checks.push_back(check_send_buffer(domain));
  checks.push_back(check_unresolved_queue("/proc/sys/net/ipv4/neigh"));
  checks.push_back(check_disk(runtime::state_directory(options.state_directory), options.quick ? 20 : 100));
  checks.push_back(check_space(options.case_folder.empty()
                                   ? std::filesystem::path(runtime::state_directory(options.state_directory))
                                   : std::filesystem::path(options.case_folder)));

  const bool bad =
      std::any_of(checks.begin(), checks.end(), [](const auto &one) { return one.fitness == Fitness::kBad; });
  const bool limited =
      std::any_of(checks.begin(), checks.end(), [](const auto &one) { return one.fitness == Fitness::kLimited; });
  nlohmann::json report = checks_json(checks, bad ? "bad" : limited ? "limited" : "good");
  if (!options.bundle.empty()) {
    if (const auto made = make_bundle(options, report, context); !made) {
      return fail(made.error());
    }
  }
  if (context.json) {
    report["bundle"] = options.bundle.empty() ? nlohmann::json() : nlohmann::json(options.bundle);
    print_json(report);
    return bad ? kRefused : kOk;
  }
  Table table({"Verdict", "What", "Found"});
  std::string advice;
  for (const auto &check : checks) {
    table.row({word(check.fitness), check.name, check.finding});
    if (!check.advice.empty()) {
      advice += "  " + check.name + ": " + check.advice + "\n";
    }
  }
  print(table.text());
  print(advice.empty() ? std::string() : "\nTo set:\n" + advice);
  if (!options.bundle.empty()) {
    print("\nWritten: " + options.bundle + ". It has no names, images and paths; read it before you send it.\n");
  }
  print(bad       ? "\nThis machine cannot be relied on to keep the rates.\n"
        : limited ? "\nThis machine keeps the rates, with the reservations above.\n"
                  : "\nThis machine keeps the rates.\n");
  return bad ? kRefused : kOk;
}

} // namespace

void add_doctor_command(CLI::App &app, Context &context) {
  auto options = std::make_shared<DoctorOptions>();
  auto *command = app.add_subcommand("doctor", "Checks whether this machine can keep the rates, and what to set");
  command->add_flag("--quick", options->quick, "Measure for half a second each");
  command->add_option("--state", options->state_directory, "Directory whose disk is measured (default: the daemon's)");
  command->add_option(
      "--case", options->case_folder,
      "Case folder: recordings are in it, so its disk's space is stated (default: the state directory's)");
  command->add_option("--bundle", options->bundle,
                      "Write a support bundle (.tar.gz): versions, configuration, health and log,\n"
                      "without names, images and identities");
  command->add_option("--config", options->configuration,
                      "Configuration of the daemon, for the bundle (default: /etc/bregma/bregmad.toml, if it exists)");
  command->add_option("--log", options->log, "Log of the daemon, for the bundle");
  add_json_flag(*command, context);
  add_daemon_options(*command, context);
  command->footer(
      "Run it on the daemon's machine, as its user, without other load. It changes no settings.\n"
      "Exit code 1 when something is bad.\n\nExamples:\n  bregma doctor\n  bregma doctor --quick --json\n"
      "  journalctl -u bregmad -o cat > bregmad.log; bregma doctor --bundle fault.tar.gz --log bregmad.log");
  command->callback(
      [options, &context] { context.run = [options, &context] { return run_doctor(*options, context); }; });
  add_completion_command(app, context);
}

} // namespace bregma::cli
