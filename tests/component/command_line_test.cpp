// The program bregma with the real daemon and the simulated room's devices.
#include <cstdlib>
#include <string>

#include <gtest/gtest.h>

#include "idl/dds.hpp"
#include "idl/names.hpp"
#include "idl/version.hpp"
#include "tests/component/operation_fixture.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace bregma::test {
namespace {

const std::string kOwnWire = wire::text_of(wire::kWireVersion);

constexpr int kRefused = 1;

class CommandLine : public ::testing::Test {
protected:
  void SetUp() override {
    operation.start_daemon();
    ASSERT_TRUE(operation.observe_until([this] { return operation.health.time_ns != 0; })) << operation.logs();
  }
  tests::Outcome bregma(const std::string &words, const std::string &to = {}) {
    return tests::run_bregma(folder, words + " --wait 30 --domain " + std::to_string(operation.domain()), to);
  }
  // SystemHealth contains it a moment later.
  bool comes_to(wire::SessionState state) {
    return operation.observe_until([this, state] { return operation.health.session == state; });
  }

  Operation operation;
  test::TemporaryFolder folder;
};

TEST_F(CommandLine, AParticipantOfAnotherWireIsCountedLoggedAndNamed) {
  EXPECT_EQ(operation.health.wire_generation, wire::kWireVersion.generation);
  EXPECT_EQ(operation.health.other_wire, 0U);
  EXPECT_NE(bregma("status").out.find("\nWire " + kOwnWire + "\n"), std::string::npos);
  const dds::Participant future(operation.domain(), {{3, 0}, "future-driver"});
  const dds::Writer<wire::RangeSample> samples(future);
  ASSERT_TRUE(operation.observe_until([this] { return operation.health.other_wire == 1; })) << operation.logs();
  const std::string text =
      "future-driver speaks wire 3.0, this program speaks wire " + kOwnWire + ": install one release on both";
  EXPECT_NE(operation.logs().find("wire: " + text), std::string::npos) << operation.logs();
  const auto status = bregma("status");
  EXPECT_EQ(status.exit_code, 0) << "the daemon itself is understood";
  EXPECT_NE(status.out.find("Wire " + kOwnWire + ", participants of another wire: 1; " + text), std::string::npos)
      << status.out;
  EXPECT_EQ(bregma("status --json").json()["other_wire"], text);
}

TEST_F(CommandLine, ACaseIsLoadedAndClosed) {
  const auto missing = bregma("case load nowhere");
  EXPECT_EQ(missing.exit_code, kRefused);
  EXPECT_NE(missing.err.find("nowhere"), std::string::npos) << missing.err;
  EXPECT_TRUE(comes_to(bregma_wire_SESSION_IDLE));

  const auto loaded = bregma("case load " + operation.case_folder().loaded().folder.string() + " --json");
  EXPECT_EQ(loaded.exit_code, 0) << loaded.err;
  EXPECT_EQ(loaded.json()["session"], "case loaded");
  EXPECT_TRUE(comes_to(bregma_wire_SESSION_CASE_LOADED));
  EXPECT_EQ(bregma("status --json").json()["session"], "case loaded");
  EXPECT_TRUE(operation.observe_until([this] { return operation.health.recording_bytes_per_s > 0.0; }));
  EXPECT_GT(bregma("status --json").json()["recorder"]["hours_left"], 0.0) << "the disk of the recording";
  const auto targets = bregma("target list --json");
  EXPECT_EQ(targets.json()["targets"][0]["target"], "Deep") << targets.out;

  EXPECT_EQ(bregma("case close").exit_code, 0);
  EXPECT_TRUE(comes_to(bregma_wire_SESSION_IDLE));
}

// What was lost is no success, also of a command that goes on.
TEST_F(CommandLine, AnOutputThatTakesNothingEndsTheCommand) {
  for (const char *words :
       {"status", "status --json", "watch --json --rate 20", "watch", "alarms", "register status"}) {
    const auto run = bregma(words, tests::kFullDisk);
    EXPECT_EQ(run.exit_code, 2) << words;
    EXPECT_TRUE(run.err.ends_with(tests::kOutputLost)) << words << ": " << run.err;
  }
}

TEST_F(CommandLine, ASupportBundleHasNoNameOfTheCase) {
  const auto secret = folder.path() / "Doe_Jane_P47110815";
  const auto copy = [&](casefile::Case c) {
    c.folder = secret;
    c.id = "Doe_Jane_P47110815";
    c.fiducials[0].name = "Janes mole";
    c.targets[0].name = "Tumour of Jane";
    c.image = secret / "image.nii.gz";
    folder.write("Doe_Jane_P47110815/image.nii.gz", "");
    return casefile::save_case(c);
  };
  ASSERT_TRUE(copy(operation.case_folder().loaded()));
  ASSERT_EQ(bregma("case load Doe_Jane_P47110815").exit_code, 0) << operation.logs();
  EXPECT_EQ(bregma("register capture Nose --tool Stylus").exit_code, kRefused);
  folder.write("bregmad.toml",
               "# of Jane's room\n[state]\ndirectory = \"/home/jane/P47110815\"\n[log]\nlevel = \"info\"\n");
  folder.write("bregmad.log", operation.daemon().log());
  EXPECT_NE(operation.daemon().log().find("Doe_Jane_P47110815"), std::string::npos) << "or the test shows nothing";

  const auto made = bregma("doctor --quick --bundle b.tar.gz --config bregmad.toml --log bregmad.log");
  EXPECT_LE(made.exit_code, kRefused) << made.err; // the machine may be unfit
  const std::string unpack = "cd '" + folder.path().string() + "' && mkdir out && tar -xzf b.tar.gz -C out";
  ASSERT_EQ(std::system(unpack.c_str()), 0) << made.err; // NOLINT(bugprone-command-processor,cert-env33-c)
  std::string all;
  for (const char *part :
       {"README.txt", "versions.txt", "machine.txt", "doctor.json", "health.json", "configuration.toml", "log.txt"}) {
    const std::string content = tests::read_file(folder.path() / "out" / part);
    EXPECT_FALSE(content.empty()) << part;
    all += content;
  }
  for (const char *name : {"Doe", "Jane", "jane", "P47110815", "mole", "Tumour", "Deep", "/tmp", "image.nii"}) {
    EXPECT_EQ(all.find(name), std::string::npos) << name << "\n" << all;
  }
  for (const char *fact : {"\"session\": \"case loaded\"", "level = \"info\"", "command LOAD_CASE: done",
                           "command CAPTURE_FIDUCIAL: refused", "serves DDS domain"}) {
    EXPECT_NE(all.find(fact), std::string::npos) << fact << "\n" << all;
  }
  EXPECT_EQ(bregma("doctor --quick --bundle b.tar.gz").err, "bregma: b.tar.gz: exists already\n");
}

TEST_F(CommandLine, UnsupportedCommandsAreRefusedWithAText) {
  operation.start_room("[[steps]]\ndo = \"wait\"\nduration_s = 120.0\n");
  ASSERT_EQ(bregma("case load " + operation.case_folder().loaded().folder.string()).exit_code, 0) << operation.logs();
  ASSERT_TRUE(operation.observe_until([this] {
    return operation.device("Tracker") != nullptr && operation.device("Tracker")->status == bregma_wire_DEVICE_LIVE;
  })) << operation.logs();
  ASSERT_EQ(bregma("register start").exit_code, 0);

  const auto touch = bregma("register capture F1 --tool Stylus");
  EXPECT_EQ(touch.exit_code, kRefused);
  EXPECT_NE(touch.err.find("Stylus"), std::string::npos) << touch.err;
  EXPECT_NE(touch.err.find("calibrat"), std::string::npos) << touch.err;
  const auto stranger = bregma("register capture F1 --tool Nobody");
  EXPECT_EQ(stranger.exit_code, kRefused);
  EXPECT_NE(stranger.err.find("Nobody"), std::string::npos) << stranger.err;
  const auto accept = bregma("register accept --json");
  EXPECT_EQ(accept.exit_code, kRefused);
  EXPECT_EQ(accept.json()["result"], "refused");
  const auto navigate = bregma("target navigate Probe Biopsy");
  EXPECT_EQ(navigate.exit_code, kRefused);

  // The tool does not move: the daemon collects its poses and therefore refuses the calibration.
  ASSERT_EQ(bregma("calibrate pivot --live Stylus start").exit_code, 0);
  operation.observe_for(2.0);
  const auto pivot = bregma("calibrate pivot --live Stylus finish");
  EXPECT_EQ(pivot.exit_code, kRefused);
  EXPECT_NE(pivot.err.find("was not moved"), std::string::npos) << pivot.err;
}

} // namespace
} // namespace bregma::test
