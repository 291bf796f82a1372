#include <gtest/gtest.h>

#include "tests/unit/cli/run_bregma.hpp"

namespace {

using bregma::test::TemporaryFolder;
using bregma::tests::run_bregma;

TEST(Usage, HelpIsAnAnswerAndNotAnError) {
  const TemporaryFolder folder;
  for (const char *arguments : {"--help",
                                "arm --help",
                                "arm scan --help",
                                "arm move --help",
                                "calibrate --help",
                                "calibrate pivot --help",
                                "calibrate hand-eye --help",
                                "calibrate beam --help",
                                "calibrate range --help",
                                "register --help",
                                "register points --help",
                                "register surface --help",
                                "register scan --help",
                                "register cloud --help",
                                "register curves --help",
                                "register capture --help",
                                "mri --help",
                                "mri points --help",
                                "mri field --help",
                                "mri correct --help",
                                "mri register --help",
                                "mri step --help",
                                "mri acquire --help",
                                "mri report --help",
                                "image --help",
                                "image register --help",
                                "image profile --help",
                                "image features --help",
                                "image add --help",
                                "image list --help",
                                "image remove --help",
                                "status --help",
                                "case --help",
                                "case mesh --help",
                                "tissue --help",
                                "tissue materials --help",
                                "tissue insert --help",
                                "tissue shift --help"}) {
    const auto run = run_bregma(folder, arguments);
    EXPECT_EQ(run.exit_code, 0) << arguments;
    EXPECT_NE(run.out.find("Usage: bregma"), std::string::npos) << arguments << "\n" << run.out;
    EXPECT_EQ(run.err, "") << arguments;
  }
  EXPECT_EQ(run_bregma(folder, "--version").out.rfind("bregma ", 0), 0U);
}

TEST(Usage, HelpShowsExamplesAndExitCodes) {
  const TemporaryFolder folder;
  EXPECT_NE(run_bregma(folder, "--help").out.find("Exit codes: 0 done; 1 negative result"), std::string::npos);
  EXPECT_NE(run_bregma(folder, "calibrate pivot --help").out.find("bregma calibrate pivot poses.tgz"),
            std::string::npos);
  EXPECT_NE(run_bregma(folder, "register --help").out.find("bregma register capture Nasion"), std::string::npos);
}

TEST(Usage, MistakesAreOneSentenceAndExitCode2) {
  const TemporaryFolder folder;
  const auto error_of = [&folder](const char *arguments) {
    const auto run = run_bregma(folder, arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_EQ(run.out, "") << arguments;
    return run.err;
  };
  EXPECT_EQ(error_of(""), "bregma: A subcommand is required (see bregma --help)\n");
  EXPECT_EQ(error_of("navigte"), "bregma: unknown command \"navigte\" (see bregma --help)\n");
  EXPECT_EQ(error_of("nonsense --help"), "bregma: unknown command \"nonsense\" (see bregma --help)\n");
  EXPECT_EQ(error_of("register nonsense --help"),
            "bregma: unknown command \"nonsense\" (see bregma register --help)\n");
  EXPECT_EQ(error_of("register capure F1"), "bregma: unknown command \"capure\" (see bregma register --help)\n");
  EXPECT_EQ(error_of("register points a.csv"), "bregma: target is required (see bregma register points --help)\n");
  EXPECT_EQ(error_of("register trace sideways"),
            "bregma: action: sideways not in {start,stop} (see bregma register trace --help)\n");
  EXPECT_EQ(error_of("calibrate pivot --live Stylus maybe"),
            "bregma: \"maybe\": with --live it must be start or finish\n");
  EXPECT_EQ(error_of("mri register scans.toml --limit-mm nan"),
            "bregma: --limit-mm: nan is not a finite number (see bregma mri register --help)\n");
  EXPECT_EQ(error_of("register start --domain 231"),
            "bregma: --domain: Value 231 not in range 0 to 230 (see bregma register start --help)\n");
}

TEST(Usage, OutputThatCannotBeWrittenIsAnError) {
  const TemporaryFolder folder;
  EXPECT_EQ(run_bregma(folder, "completion bash --json 2>full >/dev/full; exit $?").exit_code, 2);
  EXPECT_EQ(bregma::tests::read_file((folder.path() / "full").string()),
            "bregma: the output could not be written completely\n");
}

TEST(Usage, WithoutADaemonLiveCommandsSaySo) {
  const TemporaryFolder folder;
  const auto run = run_bregma(folder, "register start --domain 219 --wait 0.2");
  EXPECT_EQ(run.exit_code, 2);
  EXPECT_EQ(run.err, "bregma: no bregmad answers on domain 219: is it running?\n");
  EXPECT_EQ(run_bregma(folder, "register capture 'a fiducial with a name too long for it'").exit_code, 2);
}

} // namespace
