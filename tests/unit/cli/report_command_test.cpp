// `bregma report` as a program: messages, exit codes, written files.
#include <fstream>
#include <sstream>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <nlohmann/json.hpp>

#include "clients/cli/commands.hpp"
#include "tests/unit/cli/report_session_maker.hpp"

namespace {

using namespace bregma;

std::string bytes_of(const std::filesystem::path &file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

class ReportCommand : public testing::Test {
protected:
  struct Outcome {
    int code = -1;
    std::string out;
    std::string error;
  };
  static Outcome run(const std::string &words) {
    CLI::App app("test", "bregma");
    cli::Context context;
    cli::add_report_command(app, context);
    app.parse("report " + words);
    testing::internal::CaptureStdout();
    testing::internal::CaptureStderr();
    Outcome outcome;
    outcome.code = context.run();
    outcome.out = testing::internal::GetCapturedStdout();
    outcome.error = testing::internal::GetCapturedStderr();
    return outcome;
  }
  [[nodiscard]] std::string path(const char *name) const { return (folder_ / name).string(); }
  void write(const char *name, const std::string &text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }
  void record(const char *name) const {
    auto writer = casefile::SessionWriter::create(folder_ / name);
    ASSERT_TRUE(writer.has_value());
    test::write_run(*writer, {});
  }

  test::TemporaryFolder folder_;
};

TEST_F(ReportCommand, LimitsDecideTheExitCode) {
  record("run.db");
  write("kind.toml", "[limits]\nmax_tip_error_at_target_mm = 0.8\nmax_fre_mm = 1.0\n");
  write("strict.toml", "[limits]\nmax_tip_error_at_target_mm = 0.8\nmax_fre_mm = 0.6\n");
  EXPECT_EQ(run(path("run.db")).code, cli::kOk);
  const auto kind = run(path("run.db") + " --scenario " + path("kind.toml"));
  EXPECT_EQ(kind.code, cli::kOk) << kind.error;
  EXPECT_NE(kind.out.find("All limits were kept."), std::string::npos) << kind.out;
  const auto strict = run(path("run.db") + " --json --scenario " + path("strict.toml"));
  EXPECT_EQ(strict.code, cli::kRefused);
  const auto json = nlohmann::json::parse(strict.out);
  EXPECT_EQ(json["all_limits_hold"], false);
  EXPECT_EQ(json["limits"][0]["holds"], true);
  EXPECT_EQ(json["limits"][1]["name"], "max_fre_mm");
  EXPECT_EQ(json["limits"][1]["holds"], false);
  EXPECT_NEAR(json["at_target"]["true_error_mm"]["p50"].get<double>(), 0.5, 1e-9);
}

TEST_F(ReportCommand, PageIsWritten) {
  record("run.db");
  const auto made = run(path("run.db") + " --html " + path("report.html"));
  EXPECT_EQ(made.code, cli::kOk) << made.error;
  EXPECT_EQ(bytes_of(folder_ / "report.html").rfind("<!doctype html>", 0), 0U);
}

TEST_F(ReportCommand, TheFilesOfAnOperationWithARestartAreOneReport) {
  const auto part = [&](const char *name, const char *a_case, const char *started, std::int64_t daemon_ns) {
    auto writer = casefile::SessionWriter::create(folder_ / name);
    ASSERT_TRUE(writer.has_value());
    ASSERT_TRUE(writer->set_meta("case", a_case) && writer->set_meta("started", started));
    wire::SystemHealth health{};
    health.started_time_ns = daemon_ns;
    health.device_count = 1;
    ASSERT_TRUE(wire::set_name(health.devices[0].device, "Tracker"));
    for (const std::uint64_t lost : {0U, 7U}) {
      health.time_ns = daemon_ns + static_cast<std::int64_t>(lost + 1) * 100 * test::kMs;
      health.devices[0].lost = lost;
      health.devices[0].taken = 100 * (lost + 1);
      test::put(*writer, health.time_ns, health);
    }
  };
  ASSERT_NO_FATAL_FAILURE(part("first.db", "ball", "2026-11-29T10:00:00Z", test::kStart_ns));
  ASSERT_NO_FATAL_FAILURE(part("second.db", "ball", "2026-11-29T10:01:00Z", test::kStart_ns + 60'000 * test::kMs));
  ASSERT_NO_FATAL_FAILURE(part("foreign.db", "cube", "2026-11-29T10:02:00Z", test::kStart_ns));

  const auto made = run(path("second.db") + " " + path("first.db") + " --json"); // in any order
  ASSERT_EQ(made.code, cli::kOk) << made.error;
  const auto json = nlohmann::json::parse(made.out);
  EXPECT_EQ(json["devices"][0]["taken"], 1600);
  EXPECT_EQ(json["devices"][0]["lost"], 14);
  const auto refused = run(path("first.db") + " " + path("foreign.db"));
  EXPECT_EQ(refused.code, cli::kBadInput);
  EXPECT_EQ(refused.error, "bregma: " + path("foreign.db") + ": is of case cube, " + path("first.db") +
                               " is of case ball: only files of one operation are read together\n");
}

TEST_F(ReportCommand, FileThatIsNotASessionIsNamed) {
  write("notes.db", "these are notes, and by far not a database of anything at all; they only go on for a while ...");
  const auto refused = run(path("notes.db"));
  EXPECT_EQ(refused.code, cli::kBadInput);
  EXPECT_NE(refused.error.find(path("notes.db")), std::string::npos) << refused.error;
  EXPECT_NE(refused.error.find("session file"), std::string::npos) << refused.error;
  const auto absent = run(path("absent.db"));
  EXPECT_EQ(absent.code, cli::kBadInput);
  EXPECT_EQ(absent.error, "bregma: " + path("absent.db") + ": there is no such file\n");
}

TEST_F(ReportCommand, TruncatedFileIsAnErrorAndNotAShorterSession) {
  record("run.db");
  const std::string whole = bytes_of(folder_ / "run.db");
  ASSERT_GT(whole.size(), 100'000U);
  write("half.db", whole.substr(0, whole.size() / 2));
  const auto refused = run(path("half.db"));
  EXPECT_EQ(refused.code, cli::kBadInput) << refused.out;
  EXPECT_NE(refused.error.find(path("half.db")), std::string::npos) << refused.error;
  EXPECT_NE(refused.error.find("malformed"), std::string::npos) << refused.error;
}

TEST_F(ReportCommand, EmptySessionIsNamed) {
  ASSERT_TRUE(casefile::SessionWriter::create(folder_ / "empty.db").has_value());
  const auto refused = run(path("empty.db"));
  EXPECT_EQ(refused.code, cli::kBadInput);
  EXPECT_NE(refused.error.find(path("empty.db") + ": the session file holds no records"), std::string::npos)
      << refused.error;
}

TEST_F(ReportCommand, ScenarioThatIsWrongIsRefusedBeforeAnythingElse) {
  record("run.db");
  write("wrong.toml", "[limits]\nmax_fre = 1.0\n");
  const auto refused = run(path("run.db") + " --scenario " + path("wrong.toml"));
  EXPECT_EQ(refused.code, cli::kBadInput);
  EXPECT_NE(refused.error.find("max_fre"), std::string::npos) << refused.error;
  EXPECT_NE(refused.error.find(path("wrong.toml")), std::string::npos) << refused.error;
}

TEST_F(ReportCommand, PageThatCannotBeWrittenIsNamed) {
  record("run.db");
  const auto refused = run(path("run.db") + " --html /proc/report.html");
  EXPECT_EQ(refused.code, cli::kBadInput);
  EXPECT_EQ(refused.error, "bregma: /proc/report.html: cannot be written: No such file or directory\n");
}

} // namespace
