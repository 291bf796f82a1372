// Service functions of the daemon: systemd messages, the log, and the report of real-time settings.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sched.h>
#include <sstream>
#include <string>
#include <sys/socket.h>
#include <sys/un.h>
#include <thread>
#include <unistd.h>

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include "server/runtime/log_output.hpp"
#include "server/runtime/logging.hpp"
#include "server/runtime/realtime.hpp"
#include "server/runtime/state_lock.hpp"
#include "server/runtime/watchdog.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::runtime {
namespace {

// Replaces systemd: a datagram socket named in the environment.
class ServiceManager {
public:
  ServiceManager() : path_(folder_ / "notify"), socket_(socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path_.string().copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr *>(&address), sizeof address), 0);
    setenv("NOTIFY_SOCKET", path_.c_str(), 1);
    setenv("WATCHDOG_USEC", "3000000", 1);
    unsetenv("WATCHDOG_PID");
  }
  ~ServiceManager() {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
    close(socket_);
  }
  ServiceManager(const ServiceManager &) = delete;
  ServiceManager &operator=(const ServiceManager &) = delete;

  // The next message; empty if there is none.
  std::string receive() const {
    std::array<char, 512> text{};
    const auto size = recv(socket_, text.data(), text.size(), 0);
    return size > 0 ? std::string(text.data(), static_cast<std::size_t>(size)) : std::string();
  }

private:
  test::TemporaryFolder folder_;
  std::filesystem::path path_;
  int socket_;
};

TEST(Watchdog, IsTriggeredOnlyWhileEveryLoopAdvances) {
  const ServiceManager manager;
  Watchdog watchdog;
  ASSERT_TRUE(watchdog.interval().has_value());
  EXPECT_EQ(watchdog.interval()->count(), 1'000'000);
  std::uint64_t navigation = 0;
  std::uint64_t monitoring = 0;
  watchdog.watch("navigation", [&] { return navigation; });
  watchdog.watch("monitoring", [&] { return monitoring; });

  watchdog.ready("waiting for a case");
  EXPECT_EQ(manager.receive(), "READY=1\nSTATUS=waiting for a case");
  ++navigation;
  ++monitoring;
  EXPECT_TRUE(watchdog.feed().empty());
  EXPECT_EQ(manager.receive(), "WATCHDOG=1");
  ++navigation;
  EXPECT_EQ(watchdog.feed(), std::vector<std::string>{"monitoring"});
  EXPECT_EQ(manager.receive(), "");
  ++navigation;
  ++monitoring;
  EXPECT_TRUE(watchdog.feed().empty());
  EXPECT_EQ(manager.receive(), "WATCHDOG=1");
  watchdog.stopping();
  EXPECT_EQ(manager.receive(), "STOPPING=1");
}

TEST(Watchdog, WithoutAServiceManagerItHasNoEffect) {
  unsetenv("NOTIFY_SOCKET");
  unsetenv("WATCHDOG_USEC");
  Watchdog watchdog;
  EXPECT_FALSE(watchdog.interval().has_value());
  watchdog.ready("");
  EXPECT_TRUE(watchdog.feed().empty());
}

TEST(Logging, LinesOfTheLevelAndAboveReachTheFile) {
  const test::TemporaryFolder folder;
  const auto file = folder / "log";
  ASSERT_TRUE(start_logging({.level = "info", .file = file, .console = false}));
  spdlog::debug("not this one");
  spdlog::info("tracker {} is live", "Tracker");
  spdlog::warn("disk full");
  stop_logging();
  std::stringstream text;
  text << std::ifstream(file).rdbuf();
  EXPECT_NE(text.str().find("info tracker Tracker is live\n"), std::string::npos) << text.str();
  EXPECT_NE(text.str().find("warning disk full\n"), std::string::npos) << text.str();
  EXPECT_EQ(text.str().find("not this one"), std::string::npos);
}

TEST(Logging, NamesAndTextsDoNotBreakLinesOrControlTheTerminal) {
  EXPECT_EQ(escaped("Stylus \xc2\xb5m"), "Stylus \xc2\xb5m");
  EXPECT_EQ(escaped("a\nb\x1b[2J\x7f\xc2\x9b"), "a\\x0ab\\x1b[2J\\x7f\\xc2\\x9b");
  EXPECT_EQ(escaped("cut \xe2\x82"), "cut \\xe2\\x82") << "invalid UTF-8";
  const test::TemporaryFolder folder;
  ASSERT_TRUE(start_logging({.level = "info", .file = folder / "log", .console = false}));
  spdlog::info("{}", "tool A\n2026-11-29T00:00:00.000000Z error forged");
  stop_logging();
  std::stringstream text;
  text << std::ifstream(folder / "log").rdbuf();
  EXPECT_NE(text.str().find("info tool A\\x0a2026"), std::string::npos) << text.str();
}

TEST(LogOutput, APipeThatIsNotReadDropsLinesAndStatesTheirNumberAfterwards) {
  std::array<int, 2> ends{};
  ASSERT_EQ(pipe(ends.data()), 0);
  const std::string line = std::string(99, 'x') + "\n";
  {
    LogOutput output(ends[1]);
    std::uint64_t written = 0;
    while (output.write(line)) {
      ++written;
    }
    EXPECT_GT(written, 100U);
    for (int i = 0; i < 9; ++i) { // the statement of the first loss may fit, but no line
      EXPECT_FALSE(output.write(line));
    }
    EXPECT_EQ(output.dropped(), 10U);
    std::string all(1 << 20, '\0');
    all.resize(static_cast<std::size_t>(read(ends[0], all.data(), all.size())));
    EXPECT_TRUE(output.write("the end\n"));
    EXPECT_EQ(output.dropped(), 10U);
    std::string rest(4096, '\0');
    rest.resize(static_cast<std::size_t>(read(ends[0], rest.data(), rest.size())));
    all += rest;
    EXPECT_TRUE(all.ends_with("lines of the log were dropped: they were not read\nthe end\n")) << rest;
    std::uint64_t stated = 0;
    for (std::size_t at = all.find("... "); at != std::string::npos; at = all.find("... ", at + 1)) {
      stated += std::stoull(all.substr(at + 4));
    }
    EXPECT_EQ(stated, 10U);
    EXPECT_EQ(static_cast<std::uint64_t>(std::count(all.begin(), all.end(), 'x')), 99 * written);
  }
  close(ends[0]);
  close(ends[1]);
}

TEST(StateLock, OneProcessPerFolderAndTheOwnerLearnsOfTheOther) {
  const test::TemporaryFolder folder;
  {
    auto owner = StateLock::take(folder / "state");
    ASSERT_TRUE(owner) << owner.error().message;
    EXPECT_FALSE(owner->refused_process());
    const auto second = StateLock::take(folder / "state"); // flock: another open file, as in another process
    ASSERT_FALSE(second);
    const std::string own = "process " + std::to_string(getpid());
    EXPECT_EQ(second.error().message, "state.directory = \"" + (folder / "state").string() +
                                          "\": is in use by another bregmad (" + own +
                                          "): stop it, or use another directory");
    EXPECT_EQ(owner->refused_process(), own);
    EXPECT_FALSE(owner->refused_process()) << "stated once";
  }
  EXPECT_TRUE(StateLock::take(folder / "state")) << "the lock ends with its owner";
}

TEST(Logging, RejectsAnUnknownLevelAndAFileThatCannotBeCreated) {
  const auto level = start_logging({.level = "loud", .file = {}, .console = false});
  ASSERT_FALSE(level);
  EXPECT_EQ(level.error().message, "log level loud: must be trace, debug, info, warn, error, critical or off");
  const auto file = start_logging({.level = "info", .file = "/proc/no/such/log", .console = false});
  ASSERT_FALSE(file);
  EXPECT_EQ(file.error().message.rfind("log file /proc/no/such/log: ", 0), 0U) << file.error().message;
}

TEST(Realtime, EveryCheckHasAFindingAndEveryFailedOneHasAdvice) {
  const auto checks = check_realtime();
  ASSERT_EQ(checks.size(), 9U);
  for (const auto &check : checks) {
    EXPECT_FALSE(check.finding.empty()) << check.name;
    EXPECT_EQ(check.advice.empty(), check.fitness == Fitness::kGood) << check.name;
  }
}

TEST(Realtime, ABatchThreadPassesItsSchedulingToItsHelpers) {
  int own = -1;
  int helpers = -1;
  std::thread([&] {
    EXPECT_TRUE(set_up_thread({.name = "computing", .batch = true}).empty());
    own = sched_getscheduler(0);
    std::thread([&] { helpers = sched_getscheduler(0); }).join();
  }).join();
  EXPECT_EQ(own, SCHED_BATCH);
  EXPECT_EQ(helpers, SCHED_BATCH);
}

TEST(Realtime, TimerQualityIsOrdered) {
  const auto quality = measure_timer(500'000, 50);
  EXPECT_GE(quality.p50_us, 0.0);
  EXPECT_LE(quality.p50_us, quality.p99_us);
  EXPECT_LE(quality.p99_us, quality.max_us);
}

} // namespace
} // namespace bregma::runtime
