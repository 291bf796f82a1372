// docs/first-case.md, sections 5 and 6: what is typed with the simulated room, as it is printed.
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/component/operation_fixture.hpp"
#include "tests/unit/cli/page_commands.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace bregma::test {
namespace {

// The page's case: with its names, in the folder "first" beside the demo's scenario.
class FirstCaseWithDevices : public ::testing::Test {
protected:
  FirstCaseWithDevices() {
    std::filesystem::create_directory_symlink(BREGMA_SOURCE_DIR "/demo", folder / "demo");
    casefile::Case a_case = made.loaded();
    a_case.folder = folder / "first";
    a_case.image = folder / "first/image.nii.gz";
    a_case.trajectories.front().name = "Frontal right";
    folder.write("first/image.nii.gz", "");
    EXPECT_TRUE(casefile::save_case(a_case));
  }
  [[nodiscard]] std::string in_domain() const { return std::to_string(domain); }

  const CaseFolder made;
  const std::uint32_t domain = operation_domain();
  TemporaryFolder folder;
};

TEST_F(FirstCaseWithDevices, TheRehearsalIsReported) {
  std::string script = "set -e\nPATH='" BREGMA_PROGRAMS_FOLDER "':$PATH\n";
  for (std::string line : tests::lines_of_section("first-case.md", "5.")) {
    if (const auto at = line.find("domain_id=7"); at != std::string::npos) {
      line.replace(at, 11, "domain_id=" + in_domain());
    }
    if (const auto at = line.find("--domain 7"); at != std::string::npos) {
      line.replace(at, 10, "--domain " + in_domain());
    }
    script += line + "\n";
  }
  ASSERT_NE(script.find("bregma report"), std::string::npos);
  folder.write("script", script);
  Process shell({"/bin/bash", "-mc", "cd '" + folder.path().string() + "' && . ./script"}, (folder / "log").string());
  const auto ended = shell.wait(300.0);
  ASSERT_EQ(ended, 0) << shell.log();
  EXPECT_NE(shell.log().find("states/s while navigating"), std::string::npos) << shell.log();
  EXPECT_FALSE(tests::read_file(folder / "report.html").empty());
}

// The page has one line for several tools or points.
std::string as_on_the_page(std::string command, const casefile::Case &c) {
  const auto replace = [&command](const std::string &name, const std::string &by) {
    if (const auto at = command.find(" " + name + " "); at != std::string::npos) {
      command.replace(at, name.size() + 2, " " + by + " ");
    }
  };
  for (const auto &point : c.fiducials) {
    replace(point.name, "F1");
  }
  for (const auto &point : c.landmarks) {
    replace(point.name, "L1");
  }
  if (command.starts_with("calibrate")) {
    replace("Probe", "Stylus");
  }
  return command;
}

TEST_F(FirstCaseWithDevices, TheCommandsThatArePrintedNavigate) {
  std::set<std::string> page;
  for (const std::string &line : tests::lines_of_section("first-case.md", "6.")) {
    if (line.starts_with("bregma ")) {
      page.insert(line.substr(7));
    }
  }
  const auto type = [&](const std::string &command) {
    const bool live = !command.starts_with("report") && !command.starts_with("doctor");
    return tests::run_bregma(folder, command + (live ? " --wait 30 --domain " + in_domain() : std::string()));
  };
  const std::string programs = BREGMA_PROGRAMS_FOLDER;
  Process daemon({programs + "/bregmad", "--set", "domain_id=" + in_domain(), "--set",
                  "state.directory=" + (folder / "state").string()},
                 (folder / "daemon.log").string());
  Process room({programs + "/bregma-sim-room", "--case", (folder / "first").string(), "--scenario",
                (folder / "demo/colin27/scenario.toml").string(), "--domain", in_domain(), "--hands"},
               (folder / "room.log").string());
  EXPECT_LE(type("doctor --quick").exit_code, 1) << "the machine may be unfit";
  page.erase("doctor");
  EXPECT_EQ(type("status").exit_code, 0);
  page.erase("status");

  // The room shows the command that it waits for.
  std::set<std::string> typed;
  std::size_t seen = 0;
  for (const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(400);
       room.runs() && std::chrono::steady_clock::now() < end;) {
    const std::string log = room.log();
    const auto at = log.find("now: bregma ", seen);
    const auto line_end = log.find('\n', at);
    if (at == std::string::npos || line_end == std::string::npos) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      continue;
    }
    seen = line_end;
    std::string command = log.substr(at + 12, line_end - at - 12);
    if (command.starts_with("case load ")) {
      command = "case load first";
    }
    const std::string on_page = as_on_the_page(command, made.loaded());
    EXPECT_TRUE(page.contains(on_page)) << command << " is not on the page";
    typed.insert(on_page);
    tests::Outcome run;
    for (int attempt = 0; attempt < 3 && run.exit_code != 0; ++attempt) { // a touch that moved is repeated
      run = type(command);
    }
    ASSERT_EQ(run.exit_code, 0) << command << ": " << run.err << room.log();
  }
  EXPECT_EQ(room.wait(10.0), 0) << room.log();
  page.erase("report first/sessions/*.db --html report.html");
  EXPECT_EQ(typed, page);
  const auto report = type("report first/sessions/*.db --html report.html");
  EXPECT_EQ(report.exit_code, 0) << report.err;
  EXPECT_FALSE(tests::read_file(folder / "report.html").empty());
}

} // namespace
} // namespace bregma::test
