#include "server/loops.hpp"

#include <algorithm>
#include <chrono>

#include <spdlog/spdlog.h>

#include "server/stages/schedules.hpp"

namespace bregma::server {
namespace {

constexpr std::chrono::milliseconds kStartPoll{1};

runtime::ThreadOptions thread_options(const Stage &stage) {
  const Schedule &schedule = stage.schedule();
  runtime::ThreadOptions options{.name = stage.name(), .fifo_priority = schedule.fifo_priority};
  options.batch = schedule.thread == ThreadClass::kBatch || schedule.long_work;
  return options;
}

void log_limits(const Stage &stage, const std::vector<std::string> &limits) {
  for (const std::string &limit : limits) {
    spdlog::warn("{} loop: {}", stage.name(), limit);
  }
}

} // namespace

Moment moment_of(const runtime::Clock &clock) noexcept {
  const std::int64_t boot_ns = clock.boot_ns();
  return {.utc_ns = boot_ns + clock.utc_minus_boot_ns(),
          .monotonic_ns = clock.monotonic_ns(),
          .boot_ns = boot_ns,
          .wall_minus_boot_ns = clock.wall_minus_boot_ns(),
          .wall_error_ns = clock.wall_error_ns()};
}

Loops::Loops(const std::vector<Stage *> &stages, const DdsTopics &topics, const runtime::Clock &clock) : clock_(clock) {
  for (Stage *stage : stages) {
    const auto link = std::find_if(topics.links().begin(), topics.links().end(),
                                   [stage](const DdsLink &one) { return one.stage() == stage->name(); });
    Loop &loop = loops_.emplace_back();
    loop.stage = stage;
    loop.link = &*link; // the wiring has created one for every stage
    const Schedule &schedule = stage->schedule();
    if (!schedule.triggered) {
      loop.periodic = std::make_unique<runtime::PeriodicLoop>(
          runtime::LoopOptions{thread_options(*stage), period_ns(schedule.rate_hz), !schedule.long_work},
          [this, &loop]() noexcept { step(loop, true); });
    }
  }
}

void Loops::start() {
  for (const Loop &loop : loops_) {
    loop.stage->begin(moment_of(clock_));
  }
  for (Loop &loop : loops_) {
    if (loop.periodic) {
      log_limits(*loop.stage, loop.periodic->start());
    } else {
      loop.thread = std::thread([this, &loop] { run(loop); });
    }
  }
  for (const Loop &loop : loops_) {
    while (!loop.periodic && loop.triggered.steps() == 0) {
      std::this_thread::sleep_for(kStartPoll);
    }
  }
}

void Loops::stop() {
  stopping_.store(true, std::memory_order_relaxed);
  for (Loop &loop : loops_) {
    loop.link->wake();
  }
  for (Loop &loop : loops_) {
    if (loop.periodic) {
      loop.periodic->stop();
    } else if (loop.thread.joinable()) {
      loop.thread.join();
    }
  }
}

void Loops::step(Loop &loop, bool tick) noexcept {
  Moment moment = moment_of(clock_);
  moment.tick = tick;
  loop.stage->step(moment);
}

void Loops::run(Loop &loop) noexcept {
  Stage &stage = *loop.stage;
  log_limits(stage, runtime::set_up_thread(thread_options(stage)));
  runtime::DeadlineTicker ticker(period_ns(stage.schedule().rate_hz));
  ticker.start(clock_.monotonic_ns());
  while (!stopping_.load(std::memory_order_relaxed)) {
    const std::int64_t began_ns = clock_.monotonic_ns();
    const bool tick = ticker.due(began_ns);
    {
      const runtime::TimedStep timed(loop.triggered);
      step(loop, tick);
    }
    const std::int64_t ended_ns = clock_.monotonic_ns();
    const bool too_long = stage.budget_ns() > 0 && ended_ns - began_ns > stage.budget_ns();
    const std::uint64_t missed = tick ? ticker.advance(ended_ns) : 0;
    loop.triggered.count_overruns(std::max<std::uint64_t>(missed, too_long ? 1 : 0));

    const Moment present = moment_of(clock_);
    const std::int64_t deadline_ns = std::min(ticker.next_ns(), stage.wake_ns(present));
    // A wait that ends early costs a step in which nothing is due.
    (void)loop.link->wait(std::chrono::nanoseconds(deadline_ns - present.monotonic_ns));
  }
}

std::vector<LoopOverruns> Loops::overruns() const {
  std::vector<LoopOverruns> out;
  for (const Loop &loop : loops_) {
    out.push_back({loop.stage->name(), loop.statistics().overruns()});
  }
  return out;
}

void Loops::add_health(wire::SystemHealth &health) const {
  for (const Loop &loop : loops_) { // the wiring limits the number of loops
    const Schedule &schedule = loop.stage->schedule();
    health.loops[health.loop_count++] =
        loop.statistics().health(loop.stage->name(), schedule.triggered ? 0.0 : schedule.rate_hz);
  }
}

std::vector<std::pair<std::string, std::function<std::uint64_t()>>> Loops::heartbeats() const {
  std::vector<std::pair<std::string, std::function<std::uint64_t()>>> out;
  for (const Loop &loop : loops_) {
    if (!loop.stage->schedule().long_work) {
      out.emplace_back(loop.stage->name(), [&loop] { return loop.statistics().steps(); });
    }
  }
  return out;
}

} // namespace bregma::server
