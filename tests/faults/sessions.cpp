#include "tests/faults/sessions.hpp"

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include "server/stages/session/stage.hpp"
#include "tests/faults/faulty_line.hpp"

namespace bregma::faults {
namespace {

// Slower devices than the demo's: the matrix is large. The rule's limit is the same at 30 Hz and more.
constexpr const char *kRoom = R"(
[tracker]
rate_hz = 120.0
[robot]
rate_hz = 50.0
[sensors]
force_rate_hz = 50.0
range_rate_hz = 25.0
)";

constexpr const char *kVerify = R"(
[[steps]]
do = "check_landmarks"
name = "check"
tool = "Stylus"
points = ["L1"]
[[steps]]
do = "confirm_verification"
)";

constexpr const char *kNavigate = R"(
[[steps]]
do = "start_navigation"
tool = "Probe"
trajectory = "Biopsy"
)";

std::string wait(const char *name, double seconds) {
  return "[[steps]]\ndo = \"wait\"\nname = \"" + std::string(name) + "\"\nduration_s = " + std::to_string(seconds) +
         "\n";
}

// What the operator does while the fault begins and ends, as a step of that name.
std::string activity(During session, double seconds) {
  std::string step = "[[steps]]\nname = \"" + std::string(kActivity) + "\"\nmay_fail = true\n";
  switch (session) {
  case During::kIdle:
    return step + "do = \"wait\"\nduration_s = " + std::to_string(seconds) + "\n";
  case During::kCaseLoaded:
    return step + "do = \"pivot\"\ntool = \"Stylus\"\nduration_s = " + std::to_string(seconds) + "\n";
  case During::kRegistering:
    return step + "do = \"touch_fiducials\"\ntool = \"Stylus\"\npoints = [\"F1\", \"F2\", \"F3\"]\n";
  case During::kRegistered:
  case During::kVerified:
    return step + "do = \"check_landmarks\"\ntool = \"Stylus\"\n";
  case During::kNavigating:
  case During::kDegraded:
    return step + "do = \"follow_trajectory\"\ntool = \"Probe\"\ntrajectory = \"Biopsy\"\nduration_s = 4.0\n";
  }
  return step;
}

// The session goes on after the fault.
std::string last_action(During session) {
  switch (session) {
  case During::kIdle:
    return "[[steps]]\ndo = \"load_case\"\nname = \"last\"\n";
  case During::kCaseLoaded:
    return "[[steps]]\ndo = \"start_registration\"\nname = \"last\"\n";
  case During::kRegistering:
    return "[[steps]]\ndo = \"touch_fiducials\"\nname = \"last\"\ntool = \"Stylus\"\npoints = [\"F8\"]\n";
  default:
    return "[[steps]]\ndo = \"check_landmarks\"\nname = \"last\"\ntool = \"Stylus\"\npoints = [\"L2\"]\n";
  }
}

void copy_files(const std::filesystem::path &from, const std::filesystem::path &to) {
  std::filesystem::copy(from, to, std::filesystem::copy_options::recursive);
}

} // namespace

Sessions::Sessions() {
  const auto bring = [this](const std::string &steps, const test::TemporaryFolder &to) {
    server::Config config = daemon_config(to.path());
    test::VirtualOperation operation(loaded(), test::scenario_of(kRoom + steps), kPatientSeed, config);
    if (!operation.run()) {
      throw std::runtime_error("the session cannot be prepared: " + operation.failure());
    }
  };
  bring(test::kCalibrateSteps, calibrated_);
  bring(test::kRegisterSteps, registered_);
}

void Sessions::prepare(During session, const std::filesystem::path &state_directory) const {
  if (session >= During::kRegistered) {
    copy_files(registered_.path(), state_directory);
  } else if (session >= During::kCaseLoaded) {
    copy_files(calibrated_.path(), state_directory);
  }
}

server::Config daemon_config(const std::filesystem::path &state_directory) {
  server::Config config = test::quick_config();
  auto &session = config.stages.of<server::SessionParameters>();
  session.state_directory = state_directory.string();
  session.min_checks = 1;
  return config;
}

const char *tool_of(During session) { return session >= During::kNavigating ? "Probe" : "Stylus"; }

sim::Scenario scenario_of(const Cell &cell, During session) {
  constexpr double kAfter_s = 3.5;    // to be back
  constexpr double kActivity_s = 7.0; // the shortest one
  const double needed_s = 2.0 + cell.lasts_s + kAfter_s;
  std::string text = kRoom;
  if (session == During::kRegistering) {
    text += "[[steps]]\ndo = \"start_registration\"\n";
  }
  if (session >= During::kVerified) {
    text += kVerify;
  }
  if (session >= During::kNavigating) {
    text += kNavigate;
  }
  text += activity(session, needed_s);
  const bool timed = session <= During::kCaseLoaded;
  text += wait("observe", std::max(0.5, timed ? 0.0 : needed_s - kActivity_s));
  if (!cell.expect.idle_after) {
    text += last_action(session) + wait("end", 1.0);
  }
  if (cell.content == Content::kFlood) {
    text += "[[faults]]\nkind = \"flood\"\nstep = \"" + std::string(kActivity) +
            "\"\nafter_s = 2.0\nfactor = 20.0\nduration_s = " + std::to_string(cell.lasts_s) + "\n";
    std::string device = name_of(cell.subject);
    device[0] = static_cast<char>(std::toupper(device[0]));
    text += "device = \"" + device + "\"\n";
  }
  return test::scenario_of(text);
}

} // namespace bregma::faults
