// Standard output that takes nothing, like a full disk: no command may say that all went well.
#include <algorithm>
#include <regex>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/unit/casefile/sample_case.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::kFullDisk;
using bregma::tests::kOutputLost;
using bregma::tests::read_file;
using bregma::tests::run_bregma;

// The command table, as the program's completion lists it: "case", "case create", ...
std::vector<std::string> commands() {
  const TemporaryFolder folder;
  const std::string script = run_bregma(folder, "completion bash").out;
  std::vector<std::string> out;
  const std::regex row("\n    '(/[^']*)'\\) words=");
  for (std::sregex_iterator at(script.begin(), script.end(), row), end; at != end; ++at) {
    std::string path = (*at)[1].str().substr(1);
    std::replace(path.begin(), path.end(), '/', ' ');
    out.push_back(path);
  }
  return out;
}

TEST(FullOutput, EveryCommandSaysThatItsHelpWasLost) {
  const TemporaryFolder folder;
  const auto all = commands();
  ASSERT_GT(all.size(), 40U);
  for (const std::string &command : all) {
    const auto run = run_bregma(folder, command + " --help", kFullDisk);
    EXPECT_EQ(run.exit_code, 2) << command;
    EXPECT_EQ(run.err, kOutputLost) << command;
  }
  EXPECT_EQ(run_bregma(folder, "--help", kFullDisk).exit_code, 2);
  EXPECT_EQ(run_bregma(folder, "--version", kFullDisk).exit_code, 2);
}

// Commands that need no daemon, as text and as JSON. What they write to files is whole.
TEST(FullOutput, AResultThatWasLostIsNoSuccess) {
  const TemporaryFolder folder;
  folder.write("ball/image.nii.gz", "not read here");
  ASSERT_TRUE(bregma::casefile::save_case(bregma::tests::sample_case(folder.path() / "ball")));
  folder.write("a.csv", "name,x,y,z\nA,0,0,0\nB,100,0,0\nC,0,80,0\nD,0,0,60\nE,70,60,50\n");
  folder.write("b.csv", "name,x,y,z\nA,5,0,0\nB,105,0,0\nC,5,80,0\nD,5,0,60\nE,75,60,50\n");
  const std::vector<std::string> rows{"case show ball",
                                      "case check ball",
                                      "case picture ball ball.png --size 64",
                                      "case export ball scalp.stl --surface scalp --force",
                                      "case mesh ball --elements 10000 --out ball.vtu",
                                      "register points a.csv b.csv",
                                      "register points a.csv b.csv --tfm a_to_b.tfm",
                                      "tissue materials",
                                      "completion bash",
                                      "completion zsh"};
  for (const std::string &row : rows) {
    for (const std::string &format :
         row.starts_with("completion") ? std::vector<std::string>{""} : std::vector<std::string>{"", " --json"}) {
      SCOPED_TRACE(row + format);
      const auto shown = run_bregma(folder, row + format);
      ASSERT_NE(shown.exit_code, 2) << shown.err;
      ASSERT_FALSE(shown.out.empty());
      const auto run = run_bregma(folder, row + format, kFullDisk);
      EXPECT_EQ(run.exit_code, 2);
      EXPECT_TRUE(run.err.ends_with(kOutputLost)) << run.err;
    }
  }
  EXPECT_FALSE(read_file(folder / "a_to_b.tfm").empty());
}

} // namespace
