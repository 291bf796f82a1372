// The program: messages and exit codes for missing or invalid input. With a daemon: tests/component.
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <thread>

#include <unistd.h>

#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/sim/room_fixture.hpp"

namespace bregma::sim::test {

namespace {

class Program : public testing::Test {
protected:
  Program() {
    std::filesystem::create_directories(folder_ / "case");
    casefile::Case a_case = make_case();
    a_case.folder = folder_ / "case";
    a_case.brain = {"brain", a_case.scalp.mesh};
    a_case.image = a_case.folder / "image.nii.gz";
    std::ofstream(a_case.image) << "not looked at here\n";
    if (const auto saved = casefile::save_case(a_case); !saved) {
      throw std::runtime_error(saved.error().message);
    }
    write("scenario.toml", "[[steps]]\ndo = \"load_case\"\n");
  }

  [[nodiscard]] std::string path(const std::string &name) const { return (folder_ / name).string(); }
  void write(const std::string &name, const std::string &text) const { std::ofstream(folder_ / name) << text; }
  [[nodiscard]] std::unique_ptr<bregma::test::Process> start(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), BREGMA_SIM_ROOM);
    return std::make_unique<bregma::test::Process>(arguments, path("log"));
  }
  [[nodiscard]] std::vector<std::string> room(std::vector<std::string> more = {}) const {
    std::vector<std::string> out{"--case",     path("case"),
                                 "--scenario", path("scenario.toml"),
                                 "--domain",   std::to_string(100 + getpid() % 100)}; // not used by others
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }

private:
  bregma::test::TemporaryFolder folder_;
};

} // namespace

TEST_F(Program, WithoutADaemonItEndsWithExitCodeOne) {
  const auto process = start(room({"--timeout", "0.2"}));
  EXPECT_EQ(process->wait(60.0), 1) << process->log();
  EXPECT_NE(process->log().find("waiting for bregmad on domain"), std::string::npos) << process->log();
  EXPECT_NE(process->log().find("no bregmad on domain"), std::string::npos) << process->log();
}

TEST_F(Program, EndsCleanlyByASignalWhileItWaits) {
  const auto process = start(room({"--timeout", "600"}));
  while (process->runs() && process->log().find("waiting") == std::string::npos) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  process->signal(SIGTERM);
  EXPECT_EQ(process->wait(60.0), 0) << process->log();
}

TEST_F(Program, InvalidInputGivesExitCodeTwoAndAReason) {
  write("scenario.toml", "[tracker]\nrate_hz = 5\n[[steps]]\ndo = \"load_case\"\n");
  auto process = start(room());
  EXPECT_EQ(process->wait(60.0), 2);
  EXPECT_NE(process->log().find("scenario.toml:2: tracker.rate_hz = 5: must be between 20 and 1000 Hz"),
            std::string::npos)
      << process->log();

  write("scenario.toml", "[[steps]]\ndo = \"pivot\"\ntool = \"Pointer\"\n");
  process = start(room());
  EXPECT_EQ(process->wait(60.0), 2);
  EXPECT_NE(process->log().find("step pivot: case ellipsoid has no tool 'Pointer'"), std::string::npos)
      << process->log();

  process = start(room({"--live"}));
  EXPECT_EQ(process->wait(60.0), 2);
  EXPECT_NE(process->log().find("--live needs a step start_navigation"), std::string::npos) << process->log();

  process = start({"--case", path("nowhere"), "--scenario", path("scenario.toml")});
  EXPECT_EQ(process->wait(60.0), 2);
  EXPECT_NE(process->log().find("nowhere"), std::string::npos) << process->log();

  process = start(room({"--rate", "5000"}));
  EXPECT_EQ(process->wait(60.0), 2);
  EXPECT_NE(process->log().find("--rate"), std::string::npos) << process->log();
}

} // namespace bregma::sim::test
