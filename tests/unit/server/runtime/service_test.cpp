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

#include "server/runtime/logging.hpp"
#include "server/runtime/realtime.hpp"
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
