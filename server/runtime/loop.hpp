// Loops with absolute deadlines and statistics of every step. Overruns are counted and skipped.
//
//   PeriodicLoop loop({.thread = {.name = "monitoring", .fifo_priority = 50}, .period_ns = 100'000'000},
//                     [&]() noexcept { monitor.step(clock.now_ns()); });
//   loop.start(); ... loop.stop();
//
// An event-driven loop has its own thread and uses the parts: set_up_thread, DeadlineTicker for its floor tick,
// LoopStatistics around each step.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include "idl/topics.hpp"
#include "server/runtime/histogram.hpp"
#include "server/runtime/realtime.hpp"

namespace bregma::runtime {

// Deadlines at start + n * period. A deadline that was missed by a period or more is skipped, so that there are no
// bursts of steps.
class DeadlineTicker {
public:
  explicit DeadlineTicker(std::int64_t period_ns) : period_ns_(period_ns) {}
  void start(std::int64_t now_ns) noexcept { next_ns_ = now_ns + period_ns_; }
  [[nodiscard]] std::int64_t next_ns() const noexcept { return next_ns_; }
  [[nodiscard]] bool due(std::int64_t now_ns) const noexcept { return now_ns >= next_ns_; }
  // Moves to the first deadline after now. Returns the number of skipped deadlines, not counting the one that was due.
  std::uint64_t advance(std::int64_t now_ns) noexcept;

private:
  std::int64_t period_ns_;
  std::int64_t next_ns_ = 0;
};

// One thread counts, any thread reads.
class LoopStatistics {
public:
  void count_step(std::int64_t duration_ns) noexcept {
    durations_.add(duration_ns);
    steps_.store(steps_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }
  void count_overruns(std::uint64_t number) noexcept {
    overruns_.store(overruns_.load(std::memory_order_relaxed) + number, std::memory_order_relaxed);
  }

  [[nodiscard]] std::uint64_t steps() const noexcept { return steps_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t overruns() const noexcept { return overruns_.load(std::memory_order_relaxed); }
  [[nodiscard]] HistogramSnapshot durations() const noexcept { return durations_.snapshot(); }
  // name: at most 15 bytes, like a loop's. rate_hz: 0 for an event-driven loop.
  [[nodiscard]] wire::LoopHealth health(const char *name, double rate_hz) const noexcept;

private:
  std::atomic<std::uint64_t> steps_{0};
  std::atomic<std::uint64_t> overruns_{0};
  Histogram durations_;
};

// Counts a step from here to the end of the scope.
class TimedStep {
public:
  explicit TimedStep(LoopStatistics &statistics) noexcept;
  ~TimedStep();
  TimedStep(const TimedStep &) = delete;
  TimedStep &operator=(const TimedStep &) = delete;

private:
  LoopStatistics &statistics_;
  std::int64_t began_ns_;
};

struct LoopOptions {
  ThreadOptions thread;
  std::int64_t period_ns = 0; // above 0
  bool count_overruns = true; // false: a step may take as long as it takes
};

// Threads: start, stop and the destructor belong to one thread; the readers to any.
class PeriodicLoop {
public:
  template <class Step>
  PeriodicLoop(LoopOptions options, Step step) : options_(std::move(options)), step_(std::move(step)) {
    static_assert(std::is_nothrow_invocable_v<Step &>, "a loop step must be noexcept");
  }
  ~PeriodicLoop() { stop(); }
  PeriodicLoop(const PeriodicLoop &) = delete;
  PeriodicLoop &operator=(const PeriodicLoop &) = delete;

  // Blocks until the thread is set up. Returns one sentence per setting that failed. Has no effect on a running loop.
  std::vector<std::string> start();
  // Blocks until the current step is done and the thread has ended, which takes at most 50 ms longer than the step. The
  // loop can be started again.
  void stop();

  [[nodiscard]] const LoopStatistics &statistics() const noexcept { return statistics_; }
  [[nodiscard]] wire::LoopHealth health() const noexcept;

private:
  void run() noexcept;

  LoopOptions options_;
  std::function<void()> step_;
  LoopStatistics statistics_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

} // namespace bregma::runtime
