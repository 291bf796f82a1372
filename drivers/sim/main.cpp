// bregma-sim-room: the simulated operating room as a process beside the daemon.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <map>
#include <string>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "casefile/case.hpp"
#include "drivers/sim/room_on_the_wire.hpp"
#include "drivers/sim/scenario.hpp"

namespace {

using namespace bregma;

constexpr int kDone = 0;
constexpr int kFailed = 1;
constexpr int kBadInput = 2;

std::atomic<bool> stop_requested{false}; // lock-free: a signal handler may set it

struct Options {
  std::filesystem::path case_folder;
  std::filesystem::path scenario;
  std::uint64_t seed = 1;
  std::uint32_t domain = 0;
  double rate_hz = 0.0; // 0: the scenario's
  double timeout_s = 30.0;
  bool live = false;
  bool json = false;
};

int complain(const std::string &message) {
  std::fprintf(stderr, "bregma-sim-room: %s\n", message.c_str());
  return kBadInput;
}

const char *name_of(sim::StepEvent::Kind kind) {
  switch (kind) {
  case sim::StepEvent::Kind::kStarted:
    return "started";
  case sim::StepEvent::Kind::kNote:
    return "note";
  case sim::StepEvent::Kind::kDone:
    return "done";
  case sim::StepEvent::Kind::kFailed:
    break;
  }
  return "failed";
}

// One line an event, at once: somebody watches.
class Narrator {
public:
  explicit Narrator(bool json) : json_(json) {}
  void tell(const sim::StepEvent &event) {
    start_ns_ = start_ns_ == 0 ? event.time_ns : start_ns_;
    const double at_s = static_cast<double>(event.time_ns - start_ns_) * 1e-9;
    if (json_) {
      const nlohmann::json line{
          {"time_ns", event.time_ns}, {"step", event.step}, {"event", name_of(event.kind)}, {"text", event.text}};
      std::printf("%s\n", line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
    } else if (event.kind == sim::StepEvent::Kind::kStarted) {
      std::printf("%6.1f s  %s\n", at_s, event.step.c_str());
    } else if (event.kind == sim::StepEvent::Kind::kNote && !event.text.empty()) {
      std::printf("            %s\n", event.text.c_str());
    } else if (event.kind == sim::StepEvent::Kind::kFailed) {
      std::printf("%6.1f s  %s FAILED: %s\n", at_s, event.step.c_str(), event.text.c_str());
    }
    std::fflush(stdout);
  }

  // At the end: what each device has given to the wire.
  void account(const std::map<std::string, sim::RoomOnTheWire::Sent> &sent) const {
    for (const auto &[device, s] : sent) {
      if (json_) {
        const nlohmann::json line{
            {"event", "sent"}, {"device", device}, {"written", s.written}, {"last_number", s.last_number}};
        std::printf("%s\n", line.dump().c_str());
      } else {
        std::printf("  %-8s %llu samples sent, numbers up to %llu\n", device.c_str(),
                    static_cast<unsigned long long>(s.written), static_cast<unsigned long long>(s.last_number));
      }
    }
    std::fflush(stdout);
  }

private:
  bool json_;
  std::int64_t start_ns_ = 0;
};

// What --live repeats: the script from the first start of navigation on.
std::vector<sim::Step> live_part(const sim::Scenario &scenario) {
  const auto first = std::find_if(scenario.steps.begin(), scenario.steps.end(),
                                  [](const sim::Step &step) { return step.kind == sim::StepKind::kStartNavigation; });
  std::vector<sim::Step> out(first, scenario.steps.end());
  std::erase_if(out, [](const sim::Step &step) { return step.kind == sim::StepKind::kCloseCase; });
  // A navigation that was never stopped would refuse to be started again.
  if (!out.empty() && out.back().kind != sim::StepKind::kStopNavigation) {
    out.push_back({sim::StepKind::kStopNavigation, "stop_navigation", {}, {}, {}});
  }
  return out;
}

int run(const Options &options) {
  auto scenario = sim::load_scenario(options.scenario);
  if (!scenario) {
    return complain(scenario.error().message);
  }
  if (options.rate_hz > 0.0) {
    scenario->tracker.rate_hz = options.rate_hz;
  }
  const auto repeated = live_part(*scenario);
  if (options.live) {
    if (repeated.empty()) {
      return complain(options.scenario.string() + ": --live needs a step start_navigation to repeat");
    }
    std::erase_if(scenario->steps, [](const sim::Step &step) { return step.kind == sim::StepKind::kCloseCase; });
    if (scenario->steps.back().kind != sim::StepKind::kStopNavigation) {
      scenario->steps.push_back(repeated.back());
    }
  }
  const auto loaded = casefile::load_case(std::filesystem::absolute(options.case_folder));
  if (!loaded) {
    return complain(loaded.error().message);
  }
  sim::SimulatedRoom room(*loaded, *scenario, options.seed);
  sim::RoomOnTheWire wire(room, options.domain);
  if (!wire.wait_for_daemon(std::chrono::milliseconds(300), stop_requested) && !stop_requested) {
    std::fprintf(stderr, "bregma-sim-room: waiting for bregmad on domain %u ...\n", options.domain);
    const auto timeout =
        std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(options.timeout_s));
    if (!wire.wait_for_daemon(timeout, stop_requested) && !stop_requested) {
      std::fprintf(stderr, "bregma-sim-room: no bregmad on domain %u within %.0f s\n", options.domain,
                   options.timeout_s);
      return kFailed;
    }
  }
  Narrator narrator(options.json);
  const auto tell = [&narrator](const sim::StepEvent &event) { narrator.tell(event); };
  wire.run(stop_requested, tell);
  while (options.live && !stop_requested && !room.failed()) {
    room.continue_with(repeated);
    wire.run(stop_requested, tell);
  }
  narrator.account(wire.sent());
  if (wire.dropped() > 0) {
    std::fprintf(stderr, "bregma-sim-room: %llu samples were not written in time\n",
                 static_cast<unsigned long long>(wire.dropped()));
  }
  if (room.failed()) {
    std::fprintf(stderr, "bregma-sim-room: %s\n", room.failure().c_str());
    return kFailed;
  }
  return kDone;
}

int parse_and_run(int argc, char **argv) {
  Options options;
  CLI::App app("bregma-sim-room, a simulated operating room: optical tracker, robot, sensors and an operator");
  app.add_option("--case", options.case_folder, "folder of the case")->required()->check(CLI::ExistingDirectory);
  app.add_option("--scenario", options.scenario, "what happens, TOML")->required()->check(CLI::ExistingFile);
  app.add_option("--seed", options.seed, "of all that is random")->capture_default_str();
  app.add_option("--domain", options.domain, "DDS domain")->check(CLI::Range(0, 230))->capture_default_str();
  app.add_option("--rate", options.rate_hz, "tracker frames/s, instead of the scenario's")
      ->check(CLI::Range(20.0, 1000.0));
  app.add_option("--timeout", options.timeout_s, "s to wait for a daemon")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  app.add_flag("--live", options.live, "repeat the navigation until Ctrl-C");
  app.add_flag("--json", options.json, "one JSON object a line");
  app.footer("Examples:\n"
             "  bregma-sim-room --case case/colin27 --scenario demo/colin27/scenario.toml\n"
             "  bregma-sim-room --case case/colin27 --scenario demo/colin27/scenario.toml --seed 7 --rate 1000 --live\n"
             "Ends with 0 when the script is done or by Ctrl-C, 1 when a step failed, 2 for bad input.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError &error) {
    return app.exit(error) == 0 ? kDone : kBadInput;
  }
  struct sigaction action {};
  action.sa_handler = [](int) { stop_requested = true; };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  return run(options);
}

} // namespace

int main(int argc, char **argv) {
  try {
    return parse_and_run(argc, argv);
  } catch (const std::exception &error) { // a scenario that does not fit the case, or DDS
    return complain(error.what());
  }
}
