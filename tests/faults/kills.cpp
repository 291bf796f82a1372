#include "tests/faults/kills.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <thread>
#include <vector>

#include "casefile/session_file/session_file.hpp"
#include "drivers/sim/random.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::faults {
namespace {

namespace fs = std::filesystem;

constexpr double kPatience_s = 30.0; // limits a hang
constexpr double kMinRecorded_s = 0.3, kMaxRecorded_s = 1.0;

// The devices measure for a day.
constexpr const char *kMeasure = R"(
[[steps]]
do = "wait"
duration_s = 86400.0
)";

fs::path newest_session(const fs::path &case_folder) {
  fs::path out;
  for (const fs::directory_entry &entry : fs::directory_iterator(case_folder / "sessions")) {
    if (entry.path().extension() == ".db" && (out.empty() || entry.last_write_time() > fs::last_write_time(out))) {
      out = entry.path();
    }
  }
  return out;
}

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

} // namespace

struct Kills::State {
  explicit State(std::uint64_t seed) : random(seed, "kills") {
    test::register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
    operation.start_daemon();
    if (!operation.observe_until([this] { return registered(); }, kPatience_s)) {
      throw std::runtime_error("bregmad does not start:\n" + operation.logs());
    }
    operation.start_room(kMeasure);
    if (!operation.observe_until([this] { return shown(); }, kPatience_s)) {
      throw std::runtime_error("bregma-sim-room does not start:\n" + operation.logs());
    }
    kill();
    for (unsigned i = 0; i < std::max(1U, std::thread::hardware_concurrency()); ++i) {
      load.emplace_back([this] {
        while (!stopping.load(std::memory_order_relaxed)) {
        }
      });
    }
  }
  ~State() {
    stopping = true;
    for (std::thread &thread : load) {
      thread.join();
    }
  }

  [[nodiscard]] bool registered() const {
    return operation.health.session == bregma_wire_SESSION_REGISTERED && operation.registration.accepted_revision != 0;
  }
  [[nodiscard]] bool shown() const {
    return !operation.probe.empty() && operation.probe.back().status == bregma_wire_POSE_UNVERIFIED;
  }
  void kill() {
    operation.daemon().signal(SIGKILL);
    (void)operation.daemon().wait(kPatience_s);
    operation.observe_for(0.05); // what it published before its end
  }

  test::Operation operation;
  sim::Random random;
  std::atomic<bool> stopping{false};
  std::vector<std::thread> load;
};

Kills::Kills(std::uint64_t seed) : state_(std::make_unique<State>(seed)) {}
Kills::~Kills() = default;

Kill Kills::next() {
  test::Operation &operation = state_->operation;
  operation.health = {};
  operation.registration = {};
  operation.probe.clear();
  const auto began = std::chrono::steady_clock::now();
  operation.start_daemon();
  Kill out;
  if (!operation.observe_until([this] { return state_->registered(); }, kPatience_s)) {
    out.failure = "the registration is not back: " + operation.logs();
    return out;
  }
  out.registered_s = seconds_since(began);
  if (!operation.observe_until([this] { return state_->shown(); }, kPatience_s)) {
    out.failure = "no pose is shown";
    return out;
  }
  operation.observe_for(state_->random.uniform(kMinRecorded_s, kMaxRecorded_s));
  state_->kill();
  const auto reader = casefile::SessionReader::open(newest_session(operation.case_folder().loaded().folder));
  if (!reader) {
    char text[96];
    (void)std::snprintf(
        text, sizeof text, " (%.0f ms after its first pose)",
        static_cast<double>(operation.probe.back().published_time_ns - operation.probe.front().published_time_ns) *
            1e-6);
    out.failure = reader.error().message + text;
    return out;
  }
  std::int64_t first_ns = 0, last_ns = 0;
  const auto read = reader->each<wire::NavigationState>([&](const wire::NavigationState &state, std::int64_t) {
    first_ns = first_ns == 0 ? state.published_time_ns : first_ns;
    last_ns = std::max(last_ns, state.published_time_ns);
  });
  if (!read || last_ns == 0) {
    out.failure = read ? "nothing was recorded" : read.error().message;
    return out;
  }
  out.late_ms = static_cast<double>(first_ns - operation.probe.front().published_time_ns) * 1e-6;
  out.lost_ms = static_cast<double>(operation.probe.back().published_time_ns - last_ns) * 1e-6;
  return out;
}

} // namespace bregma::faults
