// Runs the program `bregma`.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <sstream>
#include <string>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "tests/unit/casefile/files.hpp"

namespace bregma::tests {

struct Outcome {
  int exit_code = -1;
  std::string out;
  std::string err;   // without its notes
  std::string notes; // lines "note: ..." of standard error
  [[nodiscard]] nlohmann::json json() const { return nlohmann::json::parse(out, nullptr, false); }
};

inline constexpr const char *kFullDisk = "/dev/full";
inline constexpr const char *kOutputLost = "bregma: the output could not be written completely\n";

// arguments as in a shell; the working folder is the given one. to: takes standard output instead of the outcome.
inline Outcome run_bregma(const test::TemporaryFolder &folder, const std::string &arguments,
                          const std::string &to = {}) {
  const std::string out = to.empty() ? (folder.path() / ".out").string() : to;
  const std::string err = (folder.path() / ".err").string();
  const std::string command = "cd '" + folder.path().string() + "' && '" BREGMA_PROGRAM "' " + arguments + " >'" + out +
                              "' 2>'" + err + "' </dev/null";
  const int status =
      std::system(command.c_str()); // NOLINT(bugprone-command-processor,cert-env33-c): a test's own words
  Outcome outcome{WIFEXITED(status) ? WEXITSTATUS(status) : -1, to.empty() ? read_file(out) : "", {}, {}};
  std::istringstream lines(read_file(err));
  for (std::string line; std::getline(lines, line);) {
    (line.starts_with("note: ") ? outcome.notes : outcome.err) += line + "\n";
  }
  return outcome;
}

// The command, as text and as JSON, has a result; where standard output takes nothing, that is no success, and it is
// said.
inline void expect_lost_output_is_said(const test::TemporaryFolder &folder, const std::string &command) {
  for (const char *format : {"", " --json"}) {
    SCOPED_TRACE(command + format);
    const auto shown = run_bregma(folder, command + format);
    ASSERT_NE(shown.exit_code, 2) << shown.err;
    ASSERT_FALSE(shown.out.empty());
    const auto lost = run_bregma(folder, command + format, kFullDisk);
    EXPECT_EQ(lost.exit_code, 2);
    EXPECT_TRUE(lost.err.ends_with(kOutputLost)) << lost.err;
  }
}

} // namespace bregma::tests
