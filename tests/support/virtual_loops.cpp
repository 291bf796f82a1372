#include "tests/support/virtual_loops.hpp"

#include <algorithm>

#include "server/stages/schedules.hpp"
#include "tests/support/virtual_link.hpp"

namespace bregma::test {

VirtualLoops::VirtualLoops(const std::vector<server::Stage *> &stages, MemoryTopics &topics, std::int64_t start_utc_ns)
    : topics_(topics), start_utc_ns_(start_utc_ns), now_utc_ns_(start_utc_ns) {
  take(stages);
}

void VirtualLoops::take(const std::vector<server::Stage *> &stages) {
  loops_.clear();
  const std::int64_t now_ns = moment(now_utc_ns_).monotonic_ns;
  for (server::Stage *stage : stages) {
    const std::int64_t period_ns = server::period_ns(stage->schedule().rate_hz);
    loops_.push_back({stage, period_ns, now_ns + period_ns});
  }
}

void VirtualLoops::begin() {
  for (const Loop &loop : loops_) {
    loop.stage->begin(moment(now_utc_ns_));
  }
  topics_.deliver();
}

void VirtualLoops::restart(const std::vector<server::Stage *> &stages, std::int64_t utc_ns) {
  now_utc_ns_ = utc_ns;
  take(stages);
  begin();
}

server::Moment VirtualLoops::moment(std::int64_t utc_ns) const {
  return {.utc_ns = utc_ns,
          .monotonic_ns = utc_ns - start_utc_ns_,
          .boot_ns = VirtualLink::kBootAtStart_ns + utc_ns - start_utc_ns_,
          .wall_minus_boot_ns = start_utc_ns_ - VirtualLink::kBootAtStart_ns + wall_lead_ns_,
          .wall_error_ns = wall_error_ns_,
          .tick = false};
}

void VirtualLoops::advance(std::int64_t utc_ns) {
  now_utc_ns_ = utc_ns;
  for (Loop &loop : loops_) {
    server::Moment now = moment(utc_ns);
    now.tick = now.monotonic_ns >= loop.next_ns;
    const bool asked = loop.stage->schedule().triggered && (!loop.stepped || topics_.waiting(loop.stage->name()) ||
                                                            loop.stage->wake_ns(now) <= now.monotonic_ns);
    if (now.tick || asked) {
      step(loop, now);
    }
  }
}

void VirtualLoops::step(Loop &loop, const server::Moment &now) {
  loop.stepped = true;
  while (now.tick && loop.next_ns <= now.monotonic_ns) {
    loop.next_ns += loop.period_ns; // missed deadlines are skipped, as in bregmad
  }
  if (around_) {
    around_(*loop.stage, [&] { loop.stage->step(now); });
  } else {
    loop.stage->step(now);
  }
  topics_.deliver();
}

std::int64_t VirtualLoops::next_due_ns() const {
  const server::Moment now = moment(now_utc_ns_);
  std::int64_t next_ns = server::Stage::kNever;
  for (const Loop &loop : loops_) {
    next_ns = std::min(next_ns, loop.next_ns);
    if (loop.stage->schedule().triggered) {
      next_ns = std::min(next_ns, loop.stage->wake_ns(now));
    }
  }
  return start_utc_ns_ + next_ns;
}

} // namespace bregma::test
