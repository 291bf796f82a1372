// The threads of the daemon: one per stage, according to its schedule.
//
// Deadlines of a rate are absolute. A deadline missed by a period or more is counted as an overrun and skipped, so that
// there are no bursts of steps (server/runtime/loop.hpp). A triggered stage is also stepped when a sample arrives, and
// at its wake_ns().
//
// Threads: the main thread constructs, starts and stops; any thread may read.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/dds_topics.hpp"
#include "server/process_alarms.hpp"
#include "server/runtime/clock.hpp"
#include "server/runtime/loop.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

// The present, a step that is due.
[[nodiscard]] Moment moment_of(const runtime::Clock &clock) noexcept;

class Loops {
public:
  // The stages, and the topics with their links. All must outlive the loops.
  Loops(const std::vector<Stage *> &stages, const DdsTopics &topics, const runtime::Clock &clock);
  ~Loops() { stop(); }
  Loops(const Loops &) = delete;
  Loops &operator=(const Loops &) = delete;

  // Blocks until every triggered stage, including the session, has made its first step.
  void start();
  // Blocks until all current steps are done.
  void stop();

  [[nodiscard]] std::vector<LoopOverruns> overruns() const; // of every stage
  void add_health(wire::SystemHealth &health) const;
  // Name and number of steps of the stages that must advance by themselves, for a watchdog.
  [[nodiscard]] std::vector<std::pair<std::string, std::function<std::uint64_t()>>> heartbeats() const;

private:
  // A stage with its thread: periodic, or triggered and run by run().
  struct Loop {
    Stage *stage = nullptr;
    const DdsLink *link = nullptr;
    std::unique_ptr<runtime::PeriodicLoop> periodic; // null: triggered
    runtime::LoopStatistics triggered;
    std::thread thread;
    [[nodiscard]] const runtime::LoopStatistics &statistics() const {
      return periodic ? periodic->statistics() : triggered;
    }
  };
  void run(Loop &loop) noexcept;
  void step(Loop &loop, bool tick) noexcept;

  const runtime::Clock &clock_;
  std::deque<Loop> loops_; // in the order of the stages
  std::atomic<bool> stopping_{false};
};

} // namespace bregma::server
