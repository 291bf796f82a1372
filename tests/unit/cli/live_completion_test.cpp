// Completion scripts, run by their shells.
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <gtest/gtest.h>

#include "clients/cli/completion.hpp"
#include "tests/support/temporary_folder.hpp"

namespace {

using namespace bregma;

void make_program(CLI::App &app, cli::Context &context) {
  cli::add_live_commands(app, context);
  cli::add_completion_command(app, context);
}

// Standard output of a shell that has sourced the script.
std::string run_shell(const std::string &shell, const std::string &script, const std::string &then) {
  const test::TemporaryFolder folder;
  const auto file = folder / "script";
  std::ofstream(file) << script << then << "\n";
  const std::string command = shell + " " + file.string() + " 2>&1";
  FILE *pipe = popen(command.c_str(), "r"); // NOLINT(cert-env33-c): the shell is what is tested
  std::string out;
  std::array<char, 256> buffer{};
  while (pipe != nullptr && fgets(buffer.data(), buffer.size(), pipe) != nullptr) {
    out += buffer.data();
  }
  if (pipe != nullptr) {
    pclose(pipe);
  }
  return out;
}

std::string completed_by_bash(const std::string &words) {
  CLI::App app("test", "bregma");
  cli::Context context;
  make_program(app, context);
  return run_shell("bash", cli::bash_completion(app),
                   "COMP_WORDS=(" + words +
                       "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _bregma; echo \"${COMPREPLY[@]}\"");
}

TEST(Completion, BashOffersCommandsOfThePlace) {
  EXPECT_EQ(completed_by_bash("bregma al"), "alarms\n");
  EXPECT_EQ(completed_by_bash("bregma alarms ''"), "list ack --help --json --domain --wait\n");
  EXPECT_EQ(completed_by_bash("bregma target na"), "navigate\n");
  EXPECT_EQ(completed_by_bash("bregma watch --to"), "--tool\n");
  EXPECT_EQ(completed_by_bash("bregma watch --json --un"), "--until-end\n");
}

TEST(Completion, BashLeavesTheValueOfAnOptionToTheShell) {
  EXPECT_EQ(completed_by_bash("bregma watch --rate ''"), "\n");
}

TEST(Completion, ZshScriptNamesEveryCommandWithItsText) {
  CLI::App app("test", "bregma");
  cli::Context context;
  make_program(app, context);
  const std::string script = cli::zsh_completion(app);
  EXPECT_EQ(script.rfind("#compdef bregma", 0), 0U);
  for (const char *word : {"'status:Prints the state", "'ack:Acknowledges", "/target/navigate", "'--until-end:"}) {
    EXPECT_NE(script.find(word), std::string::npos) << word;
  }
  if (std::system("command -v zsh > /dev/null") != 0) { // NOLINT(cert-env33-c,concurrency-mt-unsafe)
    GTEST_SKIP() << "zsh is not installed: its script was not run";
  }
  EXPECT_EQ(run_shell("zsh -n", script, ""), "") << "zsh finds an error in it";
}

} // namespace
