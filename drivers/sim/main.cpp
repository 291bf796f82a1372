// bregma-sim-room: the simulated operating room as a separate process.
#include <cstdio>
#include <map>
#include <string>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <CLI/Validators.hpp>
#include <nlohmann/json.hpp>

#include "base/standard_output.hpp"
#include "drivers/frame/program.hpp"
#include "drivers/sim/room_on_the_wire.hpp"

namespace {

using namespace bregma;

struct Options {
  sim::RoomOptions room;
  bool json = false;
};

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

// Prints one line per event and flushes it, because a script may read it.
class Narrator {
public:
  explicit Narrator(const bool &json) : json_(&json) {}
  void tell(const sim::StepEvent &event) {
    start_ns_ = start_ns_ == 0 ? event.time_ns : start_ns_;
    const double at_s = static_cast<double>(event.time_ns - start_ns_) * 1e-9;
    if (*json_) {
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

  // At the end: published samples per device.
  void account(const std::map<std::string, sim::RoomOnTheWire::Sent> &sent) const {
    for (const auto &[device, s] : sent) {
      if (*json_) {
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
  const bool *json_; // valid after the command line was parsed
  std::int64_t start_ns_ = 0;
};

void add_options(CLI::App &app, Options &options) {
  sim::RoomOptions &room = options.room;
  app.add_option("--case", room.case_folder, "folder of the case")->required()->check(CLI::ExistingDirectory);
  app.add_option("--scenario", room.scenario, "what happens, TOML")->required()->check(CLI::ExistingFile);
  app.add_option("--seed", room.seed, "of all that is random")->capture_default_str();
  app.add_option("--rate", room.rate_hz, "tracker frames/s, instead of the scenario's")
      ->check(CLI::Range(20.0, 1000.0));
  app.add_option("--timeout", room.timeout_s, "s to wait for a daemon")
      ->check(CLI::Range(0.0, 86400.0))
      ->capture_default_str();
  app.add_flag("--live", room.live, "repeat the navigation until Ctrl-C");
  app.add_flag("--hands", room.hands_only,
               "only move the tools: the commands are given by you, and the next one is shown");
  app.add_flag("--json", options.json, "print one JSON object per line");
}

driver::Program program(Options &options) {
  driver::Settings defaults;
  defaults.device = "Room";
  defaults.silence_s = 0.0;         // the script may pause
  defaults.map_device_time = false; // the simulated clocks have errors, which bregmad must receive
  defaults.log_level = driver::LogLevel::kWarning;
  return {"bregma-sim-room", "a simulated operating room: optical tracker, robot, sensors and an operator",
          "bregma-sim-room --case case/colin27 --scenario demo/colin27/scenario.toml\n"
          "bregma-sim-room --case case/colin27 --scenario demo/colin27/scenario.toml --seed 7 --rate 1000 --live\n"
          "bregma-sim-room --case case/colin27 --scenario demo/colin27/scenario.toml --hands",
          defaults, [&options](CLI::App &app) { add_options(app, options); }};
}

} // namespace

int main(int argc, char **argv) {
  Options options;
  Narrator narrator(options.json);
  sim::RoomOnTheWire room(options.room, [&narrator](const sim::StepEvent &event) { narrator.tell(event); });
  const int code = driver::run(argc, argv, program(options), room);
  narrator.account(room.sent());
  if (room.dropped() > 0) {
    std::fprintf(stderr, "bregma-sim-room: %llu samples were not written in time\n",
                 static_cast<unsigned long long>(room.dropped()));
  }
  return code == 0 ? base::end_output("bregma-sim-room", 0) : code;
}
