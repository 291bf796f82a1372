#include <atomic>
#include <chrono>
#include <future>
#include <thread>

#include <gtest/gtest.h>

#include "idl/names.hpp"
#include "server/runtime/clock.hpp"
#include "server/runtime/loop.hpp"
#include "tests/support/allocation_counter.hpp"

namespace bregma::runtime {
namespace {

using std::chrono::milliseconds;

TEST(DeadlineTicker, KeepsItsGridAndSkipsMissedDeadlines) {
  DeadlineTicker ticker(10);
  ticker.start(1000);
  EXPECT_FALSE(ticker.due(1009));
  EXPECT_TRUE(ticker.due(1010));
  EXPECT_EQ(ticker.advance(1013), 0U); // a step of 3 ns: no deadline missed
  EXPECT_EQ(ticker.next_ns(), 1020);   // and no drift
  EXPECT_EQ(ticker.advance(1057), 3U); // 1030, 1040 and 1050 are missed
  EXPECT_EQ(ticker.next_ns(), 1060);   // one step next, not four
  EXPECT_EQ(ticker.advance(1055), 0U); // not due yet: no change
  EXPECT_EQ(ticker.next_ns(), 1060);
  EXPECT_EQ(ticker.advance(1060), 0U); // a deadline equal to now counts as past
  EXPECT_EQ(ticker.next_ns(), 1070);
}

TEST(PeriodicLoop, ATooLongStepIsCountedWithoutABurstOfSteps) {
  std::atomic<int> steps{0};
  std::atomic<std::int64_t> first_ns{0};
  std::atomic<std::int64_t> last_ns{0};
  std::promise<void> enough;
  const SystemClock clock;
  constexpr std::int64_t kPeriod_ns = 5'000'000;
  PeriodicLoop loop({.thread = {.name = "stalling"}, .period_ns = kPeriod_ns}, [&]() noexcept {
    const int step = ++steps;
    (step == 1 ? first_ns : last_ns) = clock.monotonic_ns();
    if (step == 3) {
      std::this_thread::sleep_for(milliseconds(41)); // eight deadlines pass meanwhile
    }
    if (step == 8) {
      enough.set_value();
    }
  });
  loop.start();
  enough.get_future().wait();
  loop.stop();
  const auto &statistics = loop.statistics();
  EXPECT_EQ(statistics.steps(), static_cast<std::uint64_t>(steps.load()));
  EXPECT_GE(statistics.overruns(), 7U);
  // Every deadline between the first and the last step was met or counted, and each step had its own deadline.
  const auto deadlines = static_cast<std::uint64_t>((last_ns - first_ns) / kPeriod_ns) + 2;
  EXPECT_LE(statistics.steps(), deadlines - 7);
  EXPECT_GE(loop.health().step_max_us, 41'000.0);
}

TEST(PeriodicLoop, StopsAndStartsAgain) {
  std::atomic<int> steps{0};
  PeriodicLoop loop({.thread = {.name = "again"}, .period_ns = 1'000'000}, [&]() noexcept { ++steps; });
  for (int round = 0; round < 3; ++round) {
    const int before = steps;
    EXPECT_TRUE(loop.start().empty());
    EXPECT_TRUE(loop.start().empty()); // no effect on a running loop
    while (steps < before + 3) {
      std::this_thread::sleep_for(milliseconds(1));
    }
    loop.stop();
    loop.stop();
    const int stopped = steps;
    std::this_thread::sleep_for(milliseconds(5));
    EXPECT_EQ(steps, stopped);
  }
  EXPECT_EQ(loop.statistics().steps(), static_cast<std::uint64_t>(steps.load()));
}

TEST(PeriodicLoop, ASlowLoopStopsLongBeforeItsNextStep) {
  std::atomic<int> steps{0};
  PeriodicLoop loop({.thread = {.name = "slow"}, .period_ns = 3'600'000'000'000}, [&]() noexcept { ++steps; });
  loop.start();
  loop.stop(); // the step period is one hour
  EXPECT_EQ(steps, 0);
}

TEST(PeriodicLoop, RunsInANamedThreadAndReportsFailedSettings) {
  std::promise<std::string> name;
  std::atomic<bool> said{false};
  PeriodicLoop loop({.thread = {.name = "navigation"}, .period_ns = 1'000'000}, [&]() noexcept {
    if (!said.exchange(true)) {
      char text[16] = {};
      pthread_getname_np(pthread_self(), text, sizeof text);
      name.set_value(text);
    }
  });
  EXPECT_TRUE(loop.start().empty());
  EXPECT_EQ(name.get_future().get(), "navigation");
  EXPECT_EQ(wire::text(loop.health().loop), "navigation");
  EXPECT_DOUBLE_EQ(loop.health().rate_hz, 1000.0);

  PeriodicLoop other({.thread = {.name = "a name that is too long", .cpu = 1000}, .period_ns = 1'000'000},
                     []() noexcept {});
  const auto problems = other.start();
  ASSERT_EQ(problems.size(), 2U);
  EXPECT_EQ(problems[0], "thread name 'a name that is too long' not set: Numerical result out of range");
  EXPECT_EQ(problems[1], "thread a name that is too long not pinned to core 1000: Invalid argument");
}

TEST(LoopStatistics, StepsAreTimedWithoutAllocation) {
  LoopStatistics statistics;
  const test::AllocationScope scope;
  for (int i = 0; i < 100; ++i) {
    const TimedStep timed(statistics);
  }
  statistics.count_overruns(2);
  const auto health = statistics.health("loop", 0.0);
  if (test::AllocationScope::available()) {
    EXPECT_EQ(scope.count(), 0U);
  }
  EXPECT_EQ(health.steps, 100U);
  EXPECT_EQ(health.overruns, 2U);
  EXPECT_LE(health.step_p50_us, health.step_p99_us);
  EXPECT_LE(health.step_p99_us, health.step_max_us);
}

TEST(SystemClock, BootTimeContinuesWithMonotonicTimeAndIdentifiesTheBoot) {
  const SystemClock clock;
  EXPECT_GE(clock.boot_ns(), clock.monotonic_ns() - 1'000'000'000) << "it counts suspend too";
  EXPECT_NE(wire::boot_id(), wire::BootIdentity{});
  EXPECT_EQ(wire::boot_id(), wire::boot_id());
}

TEST(SystemClock, SteadyUtcIsTheWallClockThatWasNotSteppedSinceTheStart) {
  const SystemClock clock;
  const std::int64_t lead_ns = clock.wall_minus_boot_ns() - clock.utc_minus_boot_ns();
  EXPECT_LT(std::abs(lead_ns), 1'000'000) << "the two clocks are read together";
  EXPECT_GE(clock.wall_error_ns(), 0);
}

TEST(ManualClock, AStepOfTheWallClockAffectsNoOtherTime) {
  ManualClock clock(1'000);
  clock.advance(5);
  clock.step_wall_clock(-100);
  EXPECT_EQ(clock.now_ns(), 1'005);
  EXPECT_EQ(clock.monotonic_ns(), 5);
  EXPECT_EQ(clock.boot_ns(), 5);
  EXPECT_EQ(clock.wall_minus_boot_ns(), 900);
}

} // namespace
} // namespace bregma::runtime
