// `bregma status | watch | alarms | target` as programs, with a small daemon.
#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <sys/wait.h>

#include "clients/cli/commands.hpp"
#include "tests/unit/live/fake_daemon.hpp"

namespace {

using namespace bregma;
using namespace std::chrono_literals;

struct Outcome {
  int code = -1;
  std::string out;
  std::string error;
};

Outcome run(const std::string &words) {
  CLI::App app("test", "bregma");
  cli::Context context;
  cli::add_live_commands(app, context);
  app.parse(words + " --domain " + std::to_string(test::own_domain()));
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  Outcome outcome;
  outcome.code = context.run();
  outcome.out = testing::internal::GetCapturedStdout();
  outcome.error = testing::internal::GetCapturedStderr();
  return outcome;
}

TEST(LiveCommands, StatusWithoutADaemonIsAnErrorSentence) {
  const auto status = run("status");
  EXPECT_EQ(status.code, cli::kBadInput);
  EXPECT_EQ(status.error,
            "bregma: no bregmad answers on domain " + std::to_string(test::own_domain()) + ": is it running?\n");
  EXPECT_EQ(status.out, "");
}

TEST(LiveCommands, StatusShowsTheDaemonsState) {
  const test::FakeDaemon daemon;
  const auto text = run("status");
  EXPECT_EQ(text.code, cli::kOk) << text.error;
  EXPECT_NE(text.out.find(": verified, no case loaded"), std::string::npos) << text.out;
  const auto json = nlohmann::json::parse(run("status --json").out);
  EXPECT_EQ(json["session"], "verified");
  EXPECT_EQ(json["tools"].size(), 2U);
}

TEST(LiveCommands, AlarmsAreListedAndAcknowledged) {
  const test::FakeDaemon daemon([](const wire::Command &command) {
    EXPECT_EQ(command.kind, bregma_wire_COMMAND_ACKNOWLEDGE_ALARM);
    const bool known = wire::view(command.body._u.alarm.kind) == "drift";
    return test::reply_to(command, known ? bregma_wire_COMMAND_DONE : bregma_wire_COMMAND_REFUSED,
                          known ? "acknowledged" : "there is no such alarm");
  });
  EXPECT_NE(run("alarms").out.find("drift (raised"), std::string::npos);
  EXPECT_EQ(nlohmann::json::parse(run("alarms list --json").out)[0]["kind"], "drift");
  EXPECT_EQ(run("alarms ack drift").code, cli::kOk);
  const auto refused = run("alarms ack nonsense");
  EXPECT_EQ(refused.code, cli::kRefused);
  EXPECT_EQ(refused.error, "bregma: refused: there is no such alarm\n");
}

TEST(LiveCommands, NavigationIsRequestedAndTargetsNeedACase) {
  const test::FakeDaemon daemon(
      [](const wire::Command &command) { return test::reply_to(command, bregma_wire_COMMAND_DONE, "navigating"); });
  const auto reply = nlohmann::json::parse(run("target navigate Probe Biopsy --json").out);
  EXPECT_EQ(reply["result"], "done");
  EXPECT_TRUE(reply["value_mm"].is_null());
  const auto list = run("target list");
  EXPECT_EQ(list.code, cli::kBadInput);
  EXPECT_EQ(list.error, "bregma: no case is loaded: there are no targets\n");
}

TEST(LiveCommands, WatchEndsWithTheDaemonWhenAsked) {
  std::thread ends;
  {
    auto daemon = std::make_unique<test::FakeDaemon>();
    ends = std::thread([gone = std::move(daemon)]() mutable {
      std::this_thread::sleep_for(600ms);
      gone.reset();
    });
  }
  const auto watched = run("watch --json --rate 20 --until-end");
  ends.join();
  EXPECT_EQ(watched.code, cli::kOk);
  std::istringstream lines(watched.out);
  std::size_t alive = 0;
  nlohmann::json last;
  for (std::string line; std::getline(lines, line);) {
    last = nlohmann::json::parse(line);
    alive += last["daemon_alive"].get<bool>() ? 1 : 0;
  }
  EXPECT_GT(alive, 5U);
  EXPECT_GE(last["silent_s"].get<double>(), 1.5) << "it continued until the silence was certain";
}

TEST(LiveCommands, WatchEndsWithAProcess) {
  const test::FakeDaemon daemon;
  const pid_t child = fork();
  if (child == 0) {
    execlp("sleep", "sleep", "0.5", nullptr);
    _exit(1);
  }
  const auto watched =
      run("watch --json --rate 20 --while-pid " + std::to_string(child)); // the parent has not waited for it yet
  EXPECT_EQ(watched.code, cli::kOk);
  EXPECT_EQ(waitpid(child, nullptr, WNOHANG), child) << "it had ended";
}

} // namespace
