#include "tests/component/operation_fixture.hpp"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <stdexcept>
#include <thread>

#include <unistd.h>

#include "idl/names.hpp"
#include "server/stages/session/stage.hpp"
#include "tests/unit/algorithms/head.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::test {
namespace {

// A scaled copy of the head about a point.
casefile::Surface shrunk_head(const std::string &name, double scale, const Eigen::Vector3d &about) {
  casefile::Surface out{name, make_head(3)};
  for (Eigen::Vector3d &vertex : out.mesh.vertices_mm) {
    vertex = about + scale * (vertex - kHeadCentre);
  }
  return out;
}

casefile::Case checked_case(const std::filesystem::path &folder, const std::function<void(casefile::Case &)> &change) {
  casefile::Case a_case = sim::test::make_case();
  a_case.folder = folder;
  a_case.brain = shrunk_head("brain", 0.85, kHeadCentre);
  a_case.structures = {shrunk_head("Precentral_L", 0.15, kHeadCentre + Eigen::Vector3d(-45, 0, 20))};
  a_case.image = folder / "image.nii.gz";
  std::ofstream(a_case.image) << "only its name matters to the daemon\n";
  if (change) {
    change(a_case);
  }
  if (const auto saved = casefile::save_case(a_case); !saved) {
    throw std::runtime_error(saved.error().message);
  }
  auto loaded = casefile::load_case(folder);
  if (!loaded) {
    throw std::runtime_error(loaded.error().message);
  }
  return *loaded;
}

} // namespace

std::uint32_t operation_domain() { return 20 + static_cast<std::uint32_t>(getpid()) % 80; }

const std::string kCalibrateSteps = R"(
[[steps]]
do = "load_case"
[[steps]]
do = "pivot"
tool = "Stylus"
duration_s = 6.0
[[steps]]
do = "pivot"
tool = "Probe"
duration_s = 6.0
)";

const std::string kRegisterSteps = kCalibrateSteps + R"(
[[steps]]
do = "start_registration"
[[steps]]
do = "touch_fiducials"
tool = "Stylus"
[[steps]]
do = "trace_scalp"
tool = "Stylus"
length_mm = 900.0
[[steps]]
do = "accept_registration"
)";

const std::string kNavigateSteps = R"(
[[steps]]
do = "check_landmarks"
tool = "Stylus"
[[steps]]
do = "confirm_verification"
[[steps]]
do = "start_navigation"
tool = "Probe"
trajectory = "Biopsy"
[[steps]]
do = "follow_trajectory"
tool = "Probe"
trajectory = "Biopsy"
duration_s = 60.0
)";

CaseFolder::CaseFolder(const std::function<void(casefile::Case &)> &change)
    : case_(checked_case(folder_.path(), change)) {}

void CaseFolder::reload() {
  auto loaded = casefile::load_case(folder_.path());
  if (!loaded) {
    throw std::runtime_error(loaded.error().message);
  }
  case_ = std::move(*loaded);
}

sim::Scenario scenario_of(const std::string &toml) { return sim::test::scenario_of(toml); }

void register_in_virtual_time(const CaseFolder &folder, const std::string &state_folder, std::uint64_t seed) {
  server::Config config = quick_config();
  config.stages.of<server::SessionParameters>().state_directory = state_folder;
  VirtualOperation operation(folder.loaded(), scenario_of(kRegisterSteps), seed, config);
  if (!operation.run()) {
    throw std::runtime_error("seed " + std::to_string(seed) + ": " + operation.failure());
  }
}

Operation::Operation(const std::function<void(casefile::Case &)> &change)
    : domain_(operation_domain()), case_(change), participant_(domain_), navigation_(participant_),
      health_(participant_), registration_(participant_), accuracy_(participant_), alarms_(participant_),
      replies_(participant_) {}

void Operation::start_daemon(const std::vector<std::string> &settings, const std::vector<std::string> &before) {
  std::vector<std::string> command = before;
  command.insert(command.end(), {BREGMA_DAEMON, "--set", "domain_id=" + std::to_string(domain_), "--set",
                                 "state.directory=" + state_.path().string()});
  for (const std::string &setting : settings) {
    command.insert(command.end(), {"--set", setting});
  }
  daemon_ = std::make_unique<Process>(command, (logs_.path() / "bregmad.log").string());
}

void Operation::start_room(const std::string &scenario_toml, const std::vector<std::string> &options) {
  const std::string scenario = (logs_.path() / ("scenario-" + std::to_string(++rooms_) + ".toml")).string();
  std::ofstream(scenario) << scenario_toml;
  std::vector<std::string> command{BREGMA_SIM_ROOM,       "--case",   case_.loaded().folder.string(),
                                   "--scenario",          scenario,   "--seed",
                                   std::to_string(kSeed), "--domain", std::to_string(domain_)};
  command.insert(command.end(), options.begin(), options.end());
  room_ = std::make_unique<Process>(command, (logs_.path() / "room.log").string());
}

bool Operation::start_unverified() {
  register_in_virtual_time(case_, state_.path().string());
  start_daemon();
  start_room(R"(
[[steps]]
do = "follow_trajectory"
tool = "Probe"
trajectory = "Biopsy"
duration_s = 300.0
)");
  return observe_until([this] { return probe_is(bregma_wire_POSE_UNVERIFIED); }, 90.0);
}

bool Operation::observe_until(const std::function<bool()> &done, double seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  for (;;) {
    take_all();
    if (done()) {
      return true;
    }
    if (std::chrono::steady_clock::now() >= end) {
      return false;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

void Operation::observe_for(double seconds) {
  (void)observe_until([] { return false; }, seconds);
}

void Operation::take_all() {
  navigation_.take_each([this](const wire::NavigationState &state, const auto &) {
    if (wire::view(state.tool) == "Probe") {
      probe.push_back(state);
    }
  });
  health_.take_each([this](const wire::SystemHealth &sample, const auto &) { health = sample; });
  registration_.take_each([this](const wire::RegistrationState &sample, const auto &) { registration = sample; });
  accuracy_.take_each([this](const wire::AccuracyState &sample, const auto &) { accuracy = sample; });
  alarms_.take_each([this](const wire::Alarm &alarm, const auto &) { alarms.push_back(alarm); });
  replies_.take_each([this](const wire::CommandReply &reply, const auto &) { replies.push_back(reply); });
}

std::string Operation::logs() const {
  return (daemon_ ? "bregmad:\n" + daemon_->log() : std::string()) + (room_ ? "room:\n" + room_->log() : std::string());
}

bool Operation::alarm_raised(std::string_view kind) const {
  return std::any_of(alarms.begin(), alarms.end(), [kind](const wire::Alarm &alarm) {
    return wire::view(alarm.kind) == kind && alarm.state == bregma_wire_ALARM_RAISED;
  });
}

const wire::DeviceHealth *Operation::device(std::string_view name) const {
  for (std::uint32_t i = 0; i < health.device_count; ++i) {
    if (wire::view(health.devices[i].device) == name) {
      return &health.devices[i];
    }
  }
  return nullptr;
}

bool Operation::probe_is(wire::PoseStatus status) const { return !probe.empty() && probe.back().status == status; }

} // namespace bregma::test
