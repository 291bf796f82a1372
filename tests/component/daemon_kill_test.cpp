// The real daemon is killed again and again while two programs keep the cores busy: how much of its recording is lost,
// and how soon it is registered again. BREGMA_KILLS: number of kills; 5 by default.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include <csignal>
#include <gtest/gtest.h>

#include "casefile/session_file/session_file.hpp"
#include "idl/names.hpp"
#include "tests/component/operation_fixture.hpp"

namespace bregma::test {
namespace {

int kills() {
  const char *number = std::getenv("BREGMA_KILLS");
  return number != nullptr ? std::max(1, std::atoi(number)) : 5;
}

// Keeps two cores busy while it exists.
class Load {
public:
  Load() {
    for (std::thread &thread : threads_) {
      thread = std::thread([this] {
        while (!ended_.load(std::memory_order_relaxed)) {
        }
      });
    }
  }
  ~Load() {
    ended_ = true;
    for (std::thread &thread : threads_) {
      thread.join();
    }
  }
  Load(const Load &) = delete;
  Load &operator=(const Load &) = delete;

private:
  std::atomic<bool> ended_{false};
  std::array<std::thread, 2> threads_;
};

std::filesystem::path newest_session(const std::filesystem::path &case_folder) {
  std::filesystem::path newest;
  for (const auto &entry : std::filesystem::directory_iterator(case_folder / "sessions")) {
    const bool session = entry.path().extension() == ".db";
    if (session && (newest.empty() || entry.last_write_time() > std::filesystem::last_write_time(newest))) {
      newest = entry.path();
    }
  }
  return newest;
}

// From the last record to the kill, in ms.
double lost_ms(const std::filesystem::path &session, std::int64_t killed_utc_ns) {
  const auto reader = casefile::SessionReader::open(session);
  EXPECT_TRUE(reader) << reader.error().message;
  std::int64_t last_ns = 0;
  const auto read = reader->each<wire::TrackerFrame>(
      [&](const wire::TrackerFrame &, std::int64_t time_ns) { last_ns = std::max(last_ns, time_ns); });
  EXPECT_TRUE(read && *read > 0) << session;
  return static_cast<double>(killed_utc_ns - last_ns) * 1e-6;
}

TEST(Daemon, AKillUnderLoadLosesLittleOfTheRecordingAndTheSessionIsSoonBack) {
  Operation operation;
  register_in_virtual_time(operation.case_folder(), operation.state_folder().string());
  operation.start_room("[[steps]]\ndo = \"wait\"\nduration_s = 3600.0\n");
  operation.start_daemon();
  const Load load;
  double worst_lost_ms = 0.0;
  double worst_back_s = 0.0;
  int above_100_ms = 0;
  const int number = kills();
  for (int i = 0; i < number; ++i) {
    ASSERT_TRUE(operation.observe_until([&] {
      return operation.health.session == bregma_wire_SESSION_REGISTERED && operation.health.recorded > 500;
    })) << operation.logs();
    operation.observe_for(0.05 + 0.037 * (i % 7)); // at another phase of the commits each time
    const std::int64_t killed_utc_ns =
        std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
            .count();
    operation.daemon().signal(SIGKILL);
    ASSERT_EQ(operation.daemon().wait(10.0), 128 + SIGKILL);
    const double lost = lost_ms(newest_session(operation.case_folder().loaded().folder), killed_utc_ns);
    worst_lost_ms = std::max(worst_lost_ms, lost);
    above_100_ms += lost > 100.0 ? 1 : 0;

    operation.observe_for(0.01);
    operation.health = {};
    const auto began = std::chrono::steady_clock::now();
    operation.start_daemon();
    ASSERT_TRUE(operation.observe_until([&] { return operation.health.session == bregma_wire_SESSION_REGISTERED; }))
        << operation.logs();
    worst_back_s =
        std::max(worst_back_s, std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count());
  }
  std::printf("%d kills: at most %.0f ms of the recording lost (%d above 100 ms), registered again within %.2f s\n",
              number, worst_lost_ms, above_100_ms, worst_back_s);
  if (!kSanitized) {
    EXPECT_LT(worst_lost_ms, 100.0);
    EXPECT_LT(worst_back_s, 2.0);
  }
}

} // namespace
} // namespace bregma::test
