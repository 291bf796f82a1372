// The daemon's stages in virtual time: one thread, the schedule of bregmad's loops (server/loops.hpp), and no waiting.
// Stages that are due at the same time are stepped in the order of the wiring.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "server/stages/stage.hpp"
#include "tests/support/memory_topics.hpp"

namespace bregma::test {

class VirtualLoops {
public:
  // Executes the given step; for tests that measure it.
  using Around = std::function<void(const server::Stage &, const std::function<void()> &step)>;

  VirtualLoops(const std::vector<server::Stage *> &stages, MemoryTopics &topics, std::int64_t start_utc_ns);

  void around(Around around) { around_ = std::move(around); }
  // Once, before the first advance().
  void begin();
  // Another process of the daemon on the same host: its stages begin at this time.
  void restart(const std::vector<server::Stage *> &stages, std::int64_t utc_ns);
  // Steps every stage that is due by now, and delivers what it publishes. Time must not go back.
  void advance(std::int64_t utc_ns);
  [[nodiscard]] std::int64_t next_due_ns() const; // UTC

  // Steps the host's wall clock. The true time, in which advance() counts, stays.
  void step_wall_clock(std::int64_t by_ns) { wall_lead_ns_ += by_ns; }
  // Maximal error that the host's time service states; 0: not synchronised.
  void set_wall_error(std::int64_t error_ns) { wall_error_ns_ = error_ns; }

private:
  struct Loop {
    server::Stage *stage;
    std::int64_t period_ns;
    std::int64_t next_ns; // monotonic, like all times here
    bool stepped = false;
  };
  void take(const std::vector<server::Stage *> &stages);
  [[nodiscard]] server::Moment moment(std::int64_t utc_ns) const;
  void step(Loop &loop, const server::Moment &now);

  MemoryTopics &topics_;
  std::int64_t start_utc_ns_;
  std::int64_t now_utc_ns_;
  std::int64_t wall_lead_ns_ = 0;
  std::int64_t wall_error_ns_ = 0;
  std::vector<Loop> loops_;
  Around around_;
};

} // namespace bregma::test
