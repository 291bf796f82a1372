// Latency from the write of a tracker frame to a client's take of the resulting navigation state. Measured through
// bregmad with all its loops active, and through a bare relay that takes a frame and writes states of the same size
// with the same DDS settings. In both cases the simulated operating room and each client are separate processes.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>

#include "bench/record.hpp"
#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "server/stages/session/stage.hpp"
#include "tests/support/process.hpp"
#include "tests/support/virtual_operation.hpp"

namespace {

using namespace bregma;
using Clock = std::chrono::system_clock;

constexpr std::uint64_t kSeed = 1;
constexpr const char *kTool = "Probe";
constexpr int kClients = 20;
constexpr double kWarmUp_s = 2.0;
constexpr double kAtTarget_mm = 3.0;
constexpr int kElements = 20000; // size of the tissue model

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
}

std::atomic<bool> stopping{false};

// Two hops without processing: one state for each tool that the daemon would publish.
int relay(std::uint32_t domain) {
  std::signal(SIGTERM, [](int) { stopping = true; });
  const dds::Participant participant(domain);
  const dds::Writer<wire::NavigationState> states(participant);
  const dds::Reader<wire::Command> commands(participant); // the room waits for a reader of commands
  const dds::Writer<wire::CommandReply> replies(participant);
  const dds::Writer<wire::SystemHealth> health(participant);
  dds::Reader<wire::TrackerFrame> frames(participant);
  dds::WaitSet wait(participant);
  wait.attach(frames);
  wire::NavigationState state{};
  while (!stopping) {
    wait.wait(std::chrono::milliseconds(100));
    const std::size_t taken = frames.take_each([&](const wire::TrackerFrame &frame, const auto &) {
      for (const char *tool : {"Stylus", kTool}) {
        (void)wire::set_name(state.tool, tool);
        state.frame = frame.frame;
        state.frame_sent_time_ns = frame.sent_time_ns;
        (void)states.write(state);
      }
    });
    if (taken == 0) {
      (void)frames.status(); // clears the status after a missed deadline
    }
  }
  return 0;
}

// Writes one latency (int64, ns) per frame to the file.
int client(std::uint32_t domain, double seconds, const std::string &file) {
  const dds::Participant participant(domain);
  dds::Reader<wire::NavigationState> states(participant);
  dds::WaitSet wait(participant);
  wait.attach(states);
  std::vector<std::int64_t> latencies;
  latencies.reserve(1 << 20);
  std::uint64_t last_frame = 0;
  const std::int64_t begin_ns = now_ns() + static_cast<std::int64_t>(kWarmUp_s * 1e9);
  const std::int64_t end_ns = begin_ns + static_cast<std::int64_t>(seconds * 1e9);
  while (now_ns() < end_ns) {
    wait.wait(std::chrono::milliseconds(100));
    const std::size_t taken = states.take_each([&](const wire::NavigationState &state, const auto &) {
      const std::int64_t taken_ns = now_ns();
      // A state that is published again without a new frame is not a sample of the latency.
      if (wire::view(state.tool) == kTool && state.frame != last_frame && taken_ns >= begin_ns) {
        latencies.push_back(taken_ns - state.frame_sent_time_ns);
      }
      last_frame = wire::view(state.tool) == kTool ? state.frame : last_frame;
    });
    if (taken == 0) {
      (void)states.status();
    }
  }
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char *>(latencies.data()),
            static_cast<std::streamsize>(latencies.size() * sizeof latencies[0]));
  return out.good() ? 0 : 1;
}

std::vector<double> microseconds_in(const std::string &file) {
  std::ifstream in(file, std::ios::binary);
  std::vector<double> out;
  std::int64_t value = 0;
  while (in.read(reinterpret_cast<char *>(&value), sizeof value)) {
    out.push_back(1e-3 * static_cast<double>(value));
  }
  return out;
}

class Bench {
public:
  Bench(std::string self, std::string case_folder, std::string scenario_file, std::uint32_t domain, double seconds)
      : self_(std::move(self)), bin_(std::filesystem::path(self_).parent_path()), case_folder_(std::move(case_folder)),
        scenario_file_(std::move(scenario_file)), domain_(domain), seconds_(seconds) {}

  std::vector<double> through_relay(double rate_hz) {
    operation_room_.reset();
    operation_daemon_.reset();
    const test::Process relaying({self_, "--relay", "--domain", domain_text()}, log("relay"));
    const std::string waiting = (folder_.path() / "wait.toml").string();
    std::ofstream(waiting) << "[[steps]]\ndo = \"wait\"\nduration_s = 3600.0\n";
    const auto room = start_room(waiting, rate_hz);
    return measure(1, -1);
  }

  // On return the probe is navigated with its tip at the target. The processes run until the next call. elements: size
  // of the tissue model that follows the probe; 0 for no model.
  void start_operation(double rate_hz, int elements) {
    operation_room_.reset();
    operation_daemon_.reset();
    const auto a_case = casefile::load_case(case_folder_);
    auto scenario = sim::load_scenario(scenario_file_);
    if (!a_case || !scenario) {
      throw std::runtime_error(a_case ? scenario.error().message : a_case.error().message);
    }
    const auto accepted = std::find_if(scenario->steps.begin(), scenario->steps.end(), [](const sim::Step &step) {
      return step.kind == sim::StepKind::kAcceptRegistration;
    });
    scenario->steps.erase(std::next(accepted), scenario->steps.end());
    const std::string state_directory = (folder_.path() / "state").string();
    std::filesystem::remove_all(state_directory); // else the operation would begin with the last one, restored
    server::Config config = test::quick_config();
    config.stages.of<server::SessionParameters>().state_directory = state_directory;
    test::VirtualOperation registering(*a_case, *scenario, kSeed, config);
    if (!registering.run()) {
      throw std::runtime_error(registering.failure());
    }
    const std::string navigating = (folder_.path() / "navigate.toml").string();
    std::ofstream(navigating) << "[[steps]]\ndo = \"check_landmarks\"\ntool = \"Stylus\"\n"
                                 "[[steps]]\ndo = \"confirm_verification\"\n"
                                 "[[steps]]\ndo = \"start_navigation\"\ntool = \"Probe\"\ntrajectory = \""
                              << a_case->trajectories.front().name
                              << "\"\n[[steps]]\ndo = \"follow_trajectory\"\ntool = \"Probe\"\nduration_s = 3600.0\n"
                                 "trajectory = \""
                              << a_case->trajectories.front().name << "\"\n";
    operation_daemon_ = std::make_unique<test::Process>(
        std::vector<std::string>{(bin_ / "bregmad").string(), "--set", "domain_id=" + domain_text(), "--set",
                                 "state.directory=" + state_directory, "--set",
                                 "deformation.elements=" + std::to_string(elements)},
        log("bregmad"));
    operation_room_ = start_room(navigating, rate_hz);
    wait_until_at_target();
  }

  // Latencies of all clients but the stopped one (-1: none is stopped).
  std::vector<double> measure(int clients, int stopped) {
    std::vector<std::unique_ptr<test::Process>> running;
    running.reserve(static_cast<std::size_t>(clients));
    for (int i = 0; i < clients; ++i) {
      running.push_back(std::make_unique<test::Process>(std::vector<std::string>{self_, "--client", latencies(i),
                                                                                 "--domain", domain_text(), "--seconds",
                                                                                 std::to_string(seconds_)},
                                                        log("client")));
    }
    if (stopped >= 0) {
      std::this_thread::sleep_for(std::chrono::duration<double>(0.5 * kWarmUp_s)); // the client has joined by then
      running[static_cast<std::size_t>(stopped)]->signal(SIGSTOP);
    }
    std::vector<double> out;
    for (int i = 0; i < clients; ++i) {
      if (i == stopped) {
        continue;
      }
      if (running[static_cast<std::size_t>(i)]->wait(seconds_ + 60.0) != 0) {
        throw std::runtime_error("a client failed: " + running[static_cast<std::size_t>(i)]->log());
      }
      const auto one = microseconds_in(latencies(i));
      out.insert(out.end(), one.begin(), one.end());
    }
    if (out.empty()) {
      throw std::runtime_error("no state reached the clients");
    }
    return out;
  }

  // Updates of the tissue model per second, and the percentage of valid ones, measured over `seconds`.
  struct TissueRate {
    double updates_hz = 0.0;
    double valid_percent = 0.0;
  };
  [[nodiscard]] TissueRate watch_tissue(double seconds) const {
    const dds::Participant participant(domain_);
    dds::Reader<wire::DeformationState> states(participant);
    int valid = 0;
    std::int64_t first_ns = 0;
    std::int64_t last_ns = 0;
    int updates = 0;
    const std::int64_t end_ns = now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (now_ns() < end_ns) {
      states.take_each([&](const wire::DeformationState &state, const auto &) {
        if (state.time_ns == last_ns) {
          return; // another target of the same update
        }
        first_ns = first_ns == 0 ? state.time_ns : first_ns;
        last_ns = state.time_ns;
        ++updates;
        valid += state.status == bregma_wire_DEFORMATION_VALID ? 1 : 0;
      });
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return updates < 2
               ? TissueRate{}
               : TissueRate{1e9 * (updates - 1) / static_cast<double>(last_ns - first_ns), 100.0 * valid / updates};
  }

private:
  [[nodiscard]] std::string domain_text() const { return std::to_string(domain_); }
  [[nodiscard]] std::string log(const std::string &who) const { return (folder_.path() / (who + ".log")).string(); }
  [[nodiscard]] std::string latencies(int i) const {
    return (folder_.path() / ("client-" + std::to_string(i))).string();
  }

  std::unique_ptr<test::Process> start_room(const std::string &scenario, double rate_hz) const {
    return std::make_unique<test::Process>(std::vector<std::string>{(bin_ / "bregma-sim-room").string(), "--case",
                                                                    case_folder_, "--scenario", scenario, "--seed",
                                                                    std::to_string(kSeed), "--domain", domain_text(),
                                                                    "--rate", std::to_string(rate_hz)},
                                           log("room"));
  }

  void wait_until_at_target() {
    const dds::Participant participant(domain_);
    dds::Reader<wire::NavigationState> states(participant);
    bool there = false;
    for (int i = 0; i < 9000 && !there; ++i) {
      states.take_each([&](const wire::NavigationState &state, const auto &) {
        there =
            there || (wire::view(state.tool) == kTool && state.status == bregma_wire_POSE_LIVE &&
                      state.session == bregma_wire_SESSION_NAVIGATING && state.distance_to_target_mm < kAtTarget_mm);
      });
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    if (!there) {
      throw std::runtime_error("the probe did not come to its target\n" + operation_daemon_->log() +
                               operation_room_->log());
    }
  }

  std::string self_;
  std::filesystem::path bin_;
  std::string case_folder_;
  std::string scenario_file_;
  std::uint32_t domain_;
  double seconds_;
  test::TemporaryFolder folder_;
  std::unique_ptr<test::Process> operation_daemon_;
  std::unique_ptr<test::Process> operation_room_;
};

double quantile(std::vector<double> &values, double p) { return bench::percentile(values, p); }

// Navigation with and without a running tissue model. The two alternate, and the medians of the runs are compared,
// because other load on the machine changes within minutes by more than the effect of the model.
void run_beside_tissue(Bench &bench, bench::Report &report, int turns) {
  constexpr double kRate_hz = 250.0;
  std::vector<double> p50[2];
  std::vector<double> p999[2];
  std::vector<double> updates_hz;
  std::vector<double> valid_percent;
  for (int turn = 0; turn < turns; ++turn) {
    for (const int with : {0, 1}) {
      bench.start_operation(kRate_hz, with * kElements);
      auto latencies = bench.measure(1, -1);
      p50[with].push_back(quantile(latencies, 0.5));
      p999[with].push_back(quantile(latencies, 0.999));
      if (with == 1) {
        const Bench::TissueRate tissue = bench.watch_tissue(3.0);
        updates_hz.push_back(tissue.updates_hz);
        valid_percent.push_back(tissue.valid_percent);
      }
    }
    char text[160];
    std::snprintf(text, sizeof text,
                  "turn %d: median %.0f us with the tissue model, %.0f us without; 99.9 %% %.0f, %.0f us", turn + 1,
                  p50[1].back(), p50[0].back(), p999[1].back(), p999[0].back());
    report.note(text);
  }
  const double without = quantile(p50[0], 0.5);
  report.add(bench::with_peer(bench::at_most("latency.beside_tissue.p50", quantile(p50[1], 0.5), "us", 1.2 * without),
                              without, "no tissue model"));
  report.add(bench::with_peer(bench::figure("latency.beside_tissue.p99.9", quantile(p999[1], 0.5), "us"),
                              quantile(p999[0], 0.5), "no tissue model"));
  report.add(bench::at_least("latency.beside_tissue.updates", quantile(updates_hz, 0.5), "Hz", 59.0));
  report.add(bench::figure("latency.beside_tissue.valid", quantile(valid_percent, 0.5), "%"));
}

void run_beside_relay(Bench &bench, bench::Report &report) {
  for (const double rate_hz : {250.0, 1000.0}) {
    auto floor = bench.through_relay(rate_hz);
    bench.start_operation(rate_hz, kElements);
    auto daemon = bench.measure(1, -1);
    const std::string name = "latency." + std::to_string(static_cast<int>(rate_hz)) + "hz";
    report.note(std::to_string(daemon.size()) + " frames through bregmad, " + std::to_string(floor.size()) +
                " through the relay, at " + std::to_string(static_cast<int>(rate_hz)) + " frames/s");
    const double floor_p50 = quantile(floor, 0.5);
    const double floor_p999 = quantile(floor, 0.999);
    report.add(bench::with_peer(bench::at_most(name + ".p50", quantile(daemon, 0.5), "us", 2.0 * floor_p50), floor_p50,
                                "relay"));
    report.add(
        bench::with_peer(bench::figure(name + ".p99", quantile(daemon, 0.99), "us"), quantile(floor, 0.99), "relay"));
    report.add(bench::with_peer(bench::at_most(name + ".p99.9", quantile(daemon, 0.999), "us", 4.0 * floor_p999),
                                floor_p999, "relay"));
  }
}

void run_many_clients(Bench &bench, bench::Report &report) {
  bench.start_operation(250.0, kElements);
  auto all = bench.measure(kClients, -1);
  auto others = bench.measure(kClients, 0);
  const double before = quantile(all, 0.99);
  report.add(
      bench::with_peer(bench::at_most("latency.20_clients.one_stopped.p99", quantile(others, 0.99), "us", 1.2 * before),
                       before, "none stopped"));
}

int serve(int argc, char **argv) {
  bench::Options options;
  std::string case_folder = "out/cases/colin27";
  std::string scenario = "demo/colin27/scenario.toml";
  std::uint32_t domain = 90;
  double seconds = 0.0;
  std::string client_file;
  bool relaying = false;
  CLI::App app("Latency from the write of a tracker frame to a client's take, compared with a bare relay");
  bench::add_options(app, options, {"relay", "clients", "tissue"});
  app.add_option("--case", case_folder, "case folder")->capture_default_str();
  app.add_option("--scenario", scenario, "scenario that registers the patient")->capture_default_str();
  app.add_option("--domain", domain, "DDS domain")->capture_default_str();
  app.add_option("--seconds", seconds, "length of each measurement; default 30, with --quick 4");
  // Roles of the child processes, which are copies of this program.
  app.add_flag("--relay", relaying)->group("");
  app.add_option("--client", client_file)->group("");
  CLI11_PARSE(app, argc, argv);
  if (relaying) {
    return relay(domain);
  }
  if (!client_file.empty()) {
    return client(domain, seconds, client_file);
  }
  const double length = seconds > 0.0 ? seconds : (options.quick ? 4.0 : 30.0);
  Bench measuring(std::filesystem::canonical("/proc/self/exe").string(), case_folder, scenario, domain, length);
  bench::Report report(options.json);
  if (options.wants("relay")) {
    run_beside_relay(measuring, report);
  }
  if (options.wants("clients")) {
    run_many_clients(measuring, report);
  }
  if (options.wants("tissue")) {
    run_beside_tissue(measuring, report, options.quick ? 1 : 5);
  }
  return report.all_hold() ? 0 : 1;
}

} // namespace

int main(int argc, char **argv) {
  try {
    return serve(argc, argv);
  } catch (const std::exception &error) {
    std::fprintf(stderr, "bench_latency: %s\n", error.what());
    return 2;
  }
}
