// The threads of the daemon: one for each stage, by its schedule.
//
// Deadlines of a rate are absolute; what was missed by a period or more is counted as overruns and skipped, never
// caught up in a burst (server/runtime/loop.hpp). A triggered stage is also stepped when a sample arrives, and at its
// wake_ns().
//
// Threads: construct, start and stop on the main thread; the readers from any.
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
#include "server/runtime/clock.hpp"
#include "server/runtime/loop.hpp"
#include "server/stages/stage.hpp"

namespace bregma::server {

class Loops {
public:
  // stages with their links among the topics'; all outlive the loops.
  Loops(const std::vector<Stage *> &stages, const DdsTopics &topics, const runtime::Clock &clock);
  ~Loops() { stop(); }
  Loops(const Loops &) = delete;
  Loops &operator=(const Loops &) = delete;

  // Begins every stage, then starts the threads. Returns when every triggered stage has made its first step.
  void start();
  // Returns when every step under way is done.
  void stop();

  [[nodiscard]] std::uint64_t overruns() const noexcept; // of all stages
  void add_health(wire::SystemHealth &health) const;
  // Of the stages that must advance by themselves, for a watchdog: name and count of steps.
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
  [[nodiscard]] Moment now() const noexcept;

  const runtime::Clock &clock_;
  std::deque<Loop> loops_; // in the order of the stages
  std::atomic<bool> stopping_{false};
};

} // namespace bregma::server
