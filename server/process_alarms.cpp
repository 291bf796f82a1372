#include "server/process_alarms.hpp"

#include <utility>

namespace bregma::server {
namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;
// A refused daemon is a single event. The operator must have time to read it.
constexpr std::int64_t kRefusedShown_ns = 10 * kSecond_ns;
// One alarm for all overruns of a loop that come within this time of each other.
constexpr std::int64_t kOverrunShown_ns = 60 * kSecond_ns;

} // namespace

void ProcessAlarms::update(const ProcessFacts &facts, std::int64_t now_ns) {
  alarms_.update({alarm::kOtherDaemon, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kNone, 0, kSecond_ns}, "",
                 !facts.other_daemons.empty(),
                 "another daemon serves this domain: " + facts.other_daemons +
                     ". Both carry out every command: stop one of them",
                 now_ns);
  alarms_.update({alarm::kStateUser, bregma_wire_SEVERITY_CRITICAL, SessionEffect::kNone, 0, kRefusedShown_ns}, "",
                 !facts.refused_process.empty(),
                 "another bregmad (" + facts.refused_process +
                     ") was started on the state directory of this one, and was refused",
                 now_ns);
  for (const LoopOverruns &loop : facts.loops) {
    const bool overran = loop.overruns != std::exchange(overruns_[loop.loop], loop.overruns);
    alarms_.update({alarm::kOverrun, bregma_wire_SEVERITY_INFO, SessionEffect::kNone, 0, kOverrunShown_ns}, loop.loop,
                   overran, "the " + loop.loop + " loop took longer than its period: see bregma status", now_ns);
  }
}

} // namespace bregma::server
