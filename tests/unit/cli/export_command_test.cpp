// `bregma export` as a program: the CSV files of a session.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/commands.hpp"
#include "tests/unit/cli/report_session_maker.hpp"
#include "tests/unit/cli/run_bregma.hpp"

namespace {

using namespace bregma;

class ExportCommand : public testing::Test {
protected:
  void SetUp() override {
    auto writer = casefile::SessionWriter::create(folder_ / "run.db");
    ASSERT_TRUE(writer.has_value());
    test::write_run(*writer, {.frames = 20, .first_at_target = 10});
    wire::Alarm alarm{};
    ASSERT_TRUE(wire::set_name(alarm.kind, "drift"));
    alarm.state = bregma_wire_ALARM_RAISED;
    alarm.severity = bregma_wire_SEVERITY_CRITICAL;
    wire::ScannerRegistration scanner{};
    scanner.step = bregma_wire_SCANNER_STEP_DONE;
    scanner.activity = bregma_wire_SCANNER_WAITS;
    scanner.validity = bregma_wire_SCANNER_VALID;
    scanner.fre_mm = 0.31;
    wire::set_text(scanner.text, "the robot is registered to the scanner");
    for (int i = 0; i < 3; ++i) {
      test::put(*writer, test::kStart_ns + i, scanner);
    }
    wire::RobotTool tool{};
    ASSERT_TRUE(wire::set_name(tool.device, "Robot"));
    ASSERT_TRUE(wire::set_name(tool.tool, "Guide"));
    tool.status = bregma_wire_POSE_LIVE;
    tool.T_base_tip = {{1, 0, 0, 0}, {0, 580, 260}};
    tool.scanner_status = bregma_wire_POSE_NOT_REGISTERED;
    tool.T_scanner_tip = wire::unknown_pose();
    tool.scanner_error_95_mm = wire::kUnknown;
    test::put(*writer, test::kStart_ns, tool);
    wire::set_text(alarm.text, "moved by 2 mm, \"Reference\"");
    test::put(*writer, test::kStart_ns + 1'234'567'000, alarm);
  }
  struct Outcome {
    int code = -1;
    std::string out, error;
  };
  Outcome run() const {
    CLI::App app("test", "bregma");
    cli::Context context;
    cli::add_export_command(app, context);
    app.parse("export " + (folder_ / "run.db").string() + " --to " + (folder_ / "csv").string());
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    Outcome outcome;
    outcome.code = context.run();
    outcome.out = testing::internal::GetCapturedStdout();
    outcome.error = testing::internal::GetCapturedStderr();
    return outcome;
  }
  [[nodiscard]] std::vector<std::string> lines(const char *name) const {
    std::ifstream in(folder_ / "csv" / name);
    std::vector<std::string> out;
    for (std::string line; std::getline(in, line);) {
      out.push_back(line);
    }
    return out;
  }

  test::TemporaryFolder folder_;
};

TEST_F(ExportCommand, EveryPoseIsARowWithTheColumnsOfTheHeader) {
  const auto done = run();
  ASSERT_EQ(done.code, cli::kOk) << done.error;
  const auto poses = lines("poses.csv");
  ASSERT_EQ(poses.size(), 21U);
  const auto commas = [](const std::string &line) { return std::count(line.begin(), line.end(), ','); };
  for (const std::string &line : poses) {
    EXPECT_EQ(commas(line), commas(poses.front())) << line;
  }
  EXPECT_NE(poses[1].find(",Probe,1,live,"), std::string::npos) << poses[1];
  EXPECT_NE(poses[1].find(",20.5,5,-3,1,0,0,0,0.9,1,Biopsy,"), std::string::npos) << poses[1];
  EXPECT_NE(done.out.find("poses.csv: 20 rows"), std::string::npos) << done.out;
}

TEST_F(ExportCommand, TextsAreQuotedAndTimesAreUtc) {
  ASSERT_EQ(run().code, cli::kOk);
  EXPECT_EQ(lines("events.csv").at(1), "1700000001234567000,2023-11-14T22:13:21.234567Z,alarm,drift,,raised,critical,"
                                       ",,,\"moved by 2 mm, \"\"Reference\"\"\"");
}

TEST_F(ExportCommand, StatesAreChangesOnly) {
  ASSERT_EQ(run().code, cli::kOk);
  const auto states = lines("states.csv");
  ASSERT_EQ(states.size(), 3U);
  EXPECT_NE(states[1].find(",registration,accepted,8,300,0.61,"), std::string::npos) << states[1];
  EXPECT_NE(states[2].find(",scanner,\"done: waits for you, registration valid\",,,0.31,the robot is registered"),
            std::string::npos)
      << states[2];
}

TEST_F(ExportCommand, ToolsOfRobotsHaveARowEachAndNoUnknownPose) {
  ASSERT_EQ(run().code, cli::kOk);
  const auto tools = lines("robot_tools.csv");
  ASSERT_EQ(tools.size(), 2U);
  EXPECT_NE(tools[1].find(",Robot,Guide,0,live,,0,580,260,1,0,0,0,not registered,,,,,,,,,"), std::string::npos)
      << tools[1];
}

TEST_F(ExportCommand, ExistingFilesAreNeverReplaced) {
  ASSERT_EQ(run().code, cli::kOk);
  const auto again = run();
  EXPECT_EQ(again.code, cli::kBadInput);
  EXPECT_NE(again.error.find("poses.csv: exists already"), std::string::npos) << again.error;
}

using FullOutput = ExportCommand;

TEST_F(FullOutput, ALostReportIsNoSuccess) {
  tests::expect_lost_output_is_said(folder_, "report run.db");
  tests::expect_lost_output_is_said(folder_, "report run.db --html report.html");
  const auto lost = tests::run_bregma(folder_, "export run.db --to lost", tests::kFullDisk);
  EXPECT_EQ(lost.exit_code, 2);
  EXPECT_TRUE(lost.err.ends_with(tests::kOutputLost)) << lost.err;
}

} // namespace
